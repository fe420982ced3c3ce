#include "controller/machine/objects.hpp"

#include <array>

namespace meltbench::machine {

namespace {

bool carries(const can::CanFrame& frame, std::size_t bytes) {
  return frame.kind == can::FrameKind::kData && frame.length >= bytes;
}

}  // namespace

std::optional<FeederReport> parse_feeder_report(const can::CanFrame& frame) {
  if (!carries(frame, 8)) return {};
  return FeederReport{.flow_kg_per_h = canopen::load<float>(frame.bytes, 0),
                      .age_10us = canopen::load<std::uint16_t>(frame.bytes, 4),
                      .status = frame.bytes[6],
                      .changes = frame.bytes[7]};
}

std::optional<MotionReport> parse_motion_report(const can::CanFrame& frame) {
  if (!carries(frame, 8)) return {};
  return MotionReport{.position_inc = canopen::load<std::int32_t>(frame.bytes, 0),
                      .velocity_inc_per_s = canopen::load<std::int32_t>(frame.bytes, 4)};
}

std::optional<PressureReport> parse_pressure_report(const can::CanFrame& frame) {
  if (!carries(frame, 7)) return {};
  return PressureReport{.pressure_counts = canopen::load<std::int32_t>(frame.bytes, 0),
                        .status = frame.bytes[4],
                        .age_us = canopen::load<std::uint16_t>(frame.bytes, 5)};
}

std::optional<FrontReport> parse_front_report(const can::CanFrame& frame) {
  if (!carries(frame, 7)) return {};
  return FrontReport{.front_counts = canopen::load<std::int32_t>(frame.bytes, 0),
                     .status = frame.bytes[4],
                     .age_10us = canopen::load<std::uint16_t>(frame.bytes, 5)};
}

std::optional<InletReport> parse_inlet_report(const can::CanFrame& frame) {
  if (!carries(frame, 8)) return {};
  return InletReport{.T_degC = canopen::load<float>(frame.bytes, 0),
                     .age_us = canopen::load<std::uint16_t>(frame.bytes, 4),
                     .status = frame.bytes[6],
                     .state = frame.bytes[7]};
}

std::optional<float> parse_flux_report(const can::CanFrame& frame) {
  if (!carries(frame, 4)) return {};
  return canopen::load<float>(frame.bytes, 0);
}

std::optional<ZoneTemperature> parse_melt_temperature(const can::CanFrame& frame) {
  if (!carries(frame, 5)) return {};
  constexpr std::int32_t kAbsurd_0p1degC = 10'000;
  const auto counts = canopen::load<std::int32_t>(frame.bytes, 0);
  if (counts < -kAbsurd_0p1degC || counts > kAbsurd_0p1degC) return {};
  return ZoneTemperature{.T_0p1degC = static_cast<std::int16_t>(counts), .status = frame.bytes[4]};
}

std::optional<ZoneTemperature> parse_zone(const can::CanFrame& frame, bool second) {
  const std::size_t from = second ? 4 : 0;
  if (!carries(frame, from + 4)) return {};
  return ZoneTemperature{.T_0p1degC = canopen::load<std::int16_t>(frame.bytes, from),
                         .status = frame.bytes[from + 2],
                         .state = frame.bytes[from + 3]};
}

std::optional<std::int16_t> parse_output(const can::CanFrame& frame, std::size_t byte) {
  if (!carries(frame, byte + 2)) return {};
  return canopen::load<std::int16_t>(frame.bytes, byte);
}

can::CanFrame make_feed_command(std::uint8_t node_id, float flow_kg_per_h) {
  std::array<std::uint8_t, 4> bytes{};
  canopen::store(std::span{bytes}, 0, flow_kg_per_h);
  return can::make_frame(canopen::cob_id::rpdo(feeder_object::kSetPointRpdo, node_id), bytes);
}

can::CanFrame make_controlword(std::uint8_t node_id, std::uint16_t controlword) {
  std::array<std::uint8_t, 2> bytes{};
  canopen::store(std::span{bytes}, 0, controlword);
  return can::make_frame(canopen::cob_id::rpdo(drive_object::kControlwordRpdo, node_id), bytes);
}

can::CanFrame make_velocity(std::uint8_t node_id, std::uint16_t controlword, std::int32_t inc_per_s) {
  std::array<std::uint8_t, 6> bytes{};
  canopen::store(std::span{bytes}, 0, controlword);
  canopen::store(std::span{bytes}, 2, inc_per_s);
  return can::make_frame(canopen::cob_id::rpdo(drive_object::kVelocityRpdo, node_id), bytes);
}

can::CanFrame make_inlet_set_point(std::uint8_t node_id, float T_degC, float feedforward_W_per_m2) {
  std::array<std::uint8_t, 8> bytes{};
  canopen::store(std::span{bytes}, 0, T_degC);
  canopen::store(std::span{bytes}, 4, feedforward_W_per_m2);
  return can::make_frame(canopen::cob_id::rpdo(preconditioner_object::kSetPointRpdo, node_id), bytes);
}

can::CanFrame make_inlet_mode(std::uint8_t node_id, float gain_W_per_m2K, PreconditionerMode mode) {
  std::array<std::uint8_t, 5> bytes{};
  canopen::store(std::span{bytes}, 0, gain_W_per_m2K);
  bytes[4] = static_cast<std::uint8_t>(mode);
  return can::make_frame(canopen::cob_id::rpdo(preconditioner_object::kModeRpdo, node_id), bytes);
}

can::CanFrame make_zone_set_points(std::uint8_t node_id, std::span<const std::int16_t, 4> T_0p1degC) {
  std::array<std::uint8_t, 8> bytes{};
  for (std::size_t i = 0; i < T_0p1degC.size(); ++i) canopen::store(std::span{bytes}, 2 * i, T_0p1degC[i]);
  return can::make_frame(canopen::cob_id::rpdo(heater_object::kBarrelRpdo, node_id), bytes);
}

can::CanFrame make_zone_release(std::uint8_t node_id, std::int16_t T_0p1degC, std::uint8_t release) {
  std::array<std::uint8_t, 3> bytes{};
  canopen::store(std::span{bytes}, 0, T_0p1degC);
  bytes[2] = release;
  return can::make_frame(canopen::cob_id::rpdo(heater_object::kNozzleRpdo, node_id), bytes);
}

}  // namespace meltbench::machine
