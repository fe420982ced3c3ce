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

}  // namespace meltbench::machine
