#include "controller/machine/boot_plan.hpp"

#include <fmt/format.h>

#include <algorithm>

#include "controller/machine/objects.hpp"

namespace meltbench::machine {

namespace {

using canopen::ObjectAddress;
using canopen::SdoStep;

template <class T>
SdoStep write(ObjectAddress address, T value, std::string purpose) {
  return canopen::write_step(address.index, address.sub, value, std::move(purpose));
}

/// The value holds the size that the answer must have.
template <class T>
SdoStep read(ObjectAddress address, std::string purpose) {
  return {SdoStep::Kind::kRead, address, canopen::to_bytes(T{}), std::move(purpose)};
}

std::uint16_t to_whole_ms(Nanos span) {
  return static_cast<std::uint16_t>((span + 1ms - 1ns) / 1ms);
}

/// Who it is, its heartbeat, and its watch over ours.
BootPlan make_common_plan(const ControllerSettings& settings, const BoardSettings& board) {
  const Identity& identity = board.identity;
  BootPlan plan;
  plan.steps = {canopen::expect_step(0x1000, 0, identity.device_type, "identity: device type"),
                canopen::expect_step(0x1018, 1, identity.vendor, "identity: vendor"),
                canopen::expect_step(0x1018, 2, identity.product, "identity: product code"),
                canopen::expect_step(0x1018, 3, identity.revision, "identity: revision")};
  plan.identity_steps = plan.steps.size();
  const auto missed_after_ms = static_cast<std::uint32_t>(to_whole_ms(kHeartbeatsMissed * settings.heartbeat));
  const std::uint32_t consumer = (static_cast<std::uint32_t>(settings.node_id) << 16U) | missed_after_ms;
  plan.steps.push_back(canopen::write_step(0x1017, 0, to_whole_ms(board.heartbeat), "producer heartbeat"));
  plan.steps.push_back(canopen::write_step(0x1016, 1, consumer, "consumer heartbeat"));
  return plan;
}

constexpr std::uint8_t kEverySync = 1;

void append_pdo(BootPlan& plan, std::uint8_t node_id, canopen::PdoDirection direction, unsigned number,
                std::uint8_t type, std::vector<canopen::PdoConfiguration::Item> mapping) {
  const bool transmit = direction == canopen::PdoDirection::kTransmit;
  canopen::PdoConfiguration pdo;
  pdo.direction = direction;
  pdo.number = number;
  pdo.id = transmit ? canopen::cob_id::tpdo(number, node_id) : canopen::cob_id::rpdo(number, node_id);
  pdo.type = type;
  pdo.mapping = std::move(mapping);
  pdo.append_steps(plan.steps);
}

BootPlan make_feeder_plan(const ControllerSettings& settings, double safe_flow_kg_per_h) {
  using namespace feeder_object;
  const BoardSettings& board = settings.board(config::BoardKind::kFeeder);
  BootPlan plan = make_common_plan(settings, board);
  append_pdo(plan, board.node_id, canopen::PdoDirection::kReceive, kSetPointRpdo, canopen::kEventProfile,
             {{kSetPoint, 32}});
  append_pdo(plan, board.node_id, canopen::PdoDirection::kTransmit, kReportTpdo, kEverySync,
             {{kDelivered, 32}, {kDeliveredAge, 16}, {kStatus, 8}, {kChanges, 8}});
  plan.steps.push_back(make_loss_of_master_step(safe_flow_kg_per_h));
  if (settings.feeder_watchdog_ms) {
    plan.steps.push_back(write(kWatchdog, *settings.feeder_watchdog_ms, "watchdog"));
  }
  plan.steps.push_back(read<std::uint32_t>(kLatency, "latency"));
  plan.steps.push_back(read<std::uint32_t>(kControlCycle, "control cycle"));
  return plan;
}

BootPlan make_screw_drive_plan(const ControllerSettings& settings) {
  using namespace drive_object;
  constexpr std::int16_t kNoAction = 0, kQuickStopOption = 3;
  const BoardSettings& board = settings.board(config::BoardKind::kScrewDrive);
  BootPlan plan = make_common_plan(settings, board);
  append_pdo(plan, board.node_id, canopen::PdoDirection::kReceive, kControlwordRpdo, canopen::kEventProfile,
             {{kControlword, 16}});
  if (moves_screw(settings)) {
    append_pdo(plan, board.node_id, canopen::PdoDirection::kReceive, kVelocityRpdo, canopen::kEventProfile,
               {{kControlword, 16}, {kTargetVelocity, 32}});
  }
  append_pdo(plan, board.node_id, canopen::PdoDirection::kTransmit, kMotionTpdo, kEverySync,
             {{kPosition, 32}, {kVelocity, 32}});
  const std::int16_t on_loss = settings.safe_screw == SafeScrew::kStop ? kQuickStopOption : kNoAction;
  plan.steps.push_back(write(kAbortConnectionOption, on_loss, "reaction to loss of master"));
  plan.steps.push_back(read<std::uint32_t>(kEncoderIncrements, "encoder increments"));
  plan.steps.push_back(read<std::uint32_t>(kEncoderRevolutions, "encoder revolutions"));
  plan.screw_rev_per_s = settings.sequence ? 0.0 : settings.run_speed_rev_per_s();
  return plan;
}

BootPlan make_melt_pressure_plan(const ControllerSettings& settings) {
  using namespace pressure_object;
  const BoardSettings& board = settings.board(config::BoardKind::kMeltPressure);
  BootPlan plan = make_common_plan(settings, board);
  append_pdo(plan, board.node_id, canopen::PdoDirection::kTransmit, kSampleTpdo, kEverySync,
             {{kPressure, 32}, {kStatus, 8}, {kAge, 16}});
  if (settings.viscosity.per_K > 0.0) {
    append_pdo(plan, board.node_id, canopen::PdoDirection::kTransmit, kMeltTpdo, kEverySync,
               {{kMeltTemperature, 32}, {kMeltStatus, 8}});
  }
  plan.steps.push_back(canopen::expect_step(kUnit.index, kUnit.sub, kUnitBar, "unit: bar"));
  plan.steps.push_back(read<std::uint8_t>(kDigits, "decimal digits"));
  plan.steps.push_back(read<std::uint32_t>(kSamplePeriod, "sample period"));
  plan.steps.push_back(read<std::uint32_t>(kLatency, "latency"));
  return plan;
}

BootPlan make_melt_camera_plan(const ControllerSettings& settings) {
  using namespace camera_object;
  const BoardSettings& board = settings.board(config::BoardKind::kMeltCamera);
  BootPlan plan = make_common_plan(settings, board);
  append_pdo(plan, board.node_id, canopen::PdoDirection::kTransmit, kFrontTpdo, kEverySync,
             {{kFront, 32}, {kStatus, 8}, {kAge, 16}, {kImage, 8}});
  plan.steps.push_back(canopen::expect_step(kUnit.index, kUnit.sub, kUnitMetre, "unit: metre"));
  plan.steps.push_back(read<std::uint8_t>(kDigits, "decimal digits"));
  plan.steps.push_back(read<std::uint32_t>(kSamplePeriod, "image period"));
  plan.steps.push_back(read<std::uint32_t>(kLatency, "latency"));
  return plan;
}

BootPlan make_preconditioner_plan(const ControllerSettings& settings) {
  using namespace preconditioner_object;
  const BoardSettings& board = settings.board(config::BoardKind::kPreconditioner);
  BootPlan plan = make_common_plan(settings, board);
  append_pdo(plan, board.node_id, canopen::PdoDirection::kReceive, kSetPointRpdo, canopen::kEventProfile,
             {{kSetPoint, 32}, {kFeedforward, 32}});
  append_pdo(plan, board.node_id, canopen::PdoDirection::kReceive, kModeRpdo, canopen::kEventProfile,
             {{kGain, 32}, {kMode, 8}});
  append_pdo(plan, board.node_id, canopen::PdoDirection::kTransmit, kTemperatureTpdo, kEverySync,
             {{kTemperature, 32}, {kAge, 16}, {kStatus, 8}, {kState, 8}});
  append_pdo(plan, board.node_id, canopen::PdoDirection::kTransmit, kFluxTpdo, kEverySync,
             {{kMeanFlux, 32}, {kFlux, 32}});
  plan.steps.push_back(read<std::uint32_t>(kSamplePeriod, "sample period"));
  plan.steps.push_back(read<std::uint32_t>(kLatency, "latency"));
  return plan;
}

BootPlan make_heater_plan(const ControllerSettings& settings) {
  using namespace heater_object;
  const BoardSettings& board = settings.board(config::BoardKind::kHeater);
  const auto channel = [](std::uint16_t index, unsigned number) {
    return ObjectAddress{index, static_cast<std::uint8_t>(number)};
  };
  BootPlan plan = make_common_plan(settings, board);
  append_pdo(plan, board.node_id, canopen::PdoDirection::kReceive, kBarrelRpdo, canopen::kEventProfile,
             {{channel(kSetPoint, 1), 16},
              {channel(kSetPoint, 2), 16},
              {channel(kSetPoint, 3), 16},
              {channel(kSetPoint, 4), 16}});
  append_pdo(plan, board.node_id, canopen::PdoDirection::kReceive, kNozzleRpdo, canopen::kEventProfile,
             {{channel(kSetPoint, kNozzleChannel), 16}, {kRelease, 8}});
  const auto every = static_cast<std::uint8_t>(calc_syncs_per_zone_report(settings.sync_period));
  for (const unsigned pair : {0U, 1U}) {
    const unsigned first = 2 * pair + 1;
    append_pdo(plan, board.node_id, canopen::PdoDirection::kTransmit, kFirstPairTpdo + pair, every,
               {{channel(kTemperature, first), 16},
                {channel(kStatus, first), 8},
                {channel(kZoneState, first), 8},
                {channel(kTemperature, first + 1), 16},
                {channel(kStatus, first + 1), 8},
                {channel(kZoneState, first + 1), 8}});
  }
  append_pdo(
      plan, board.node_id, canopen::PdoDirection::kTransmit, kOutputTpdo, every,
      {{channel(kOutput, 1), 16}, {channel(kOutput, 2), 16}, {channel(kOutput, 3), 16}, {channel(kOutput, 4), 16}});
  append_pdo(plan, board.node_id, canopen::PdoDirection::kTransmit, kNozzleTpdo, every,
             {{channel(kTemperature, kNozzleChannel), 16},
              {channel(kStatus, kNozzleChannel), 8},
              {channel(kZoneState, kNozzleChannel), 8},
              {channel(kOutput, kNozzleChannel), 16},
              {kBoardStatus, 8}});
  for (const ZoneSettings::Zone& zone : settings.zones->zones) {
    constexpr double kTenths = 10.0;
    const auto number = static_cast<unsigned>(zone.channel);
    const auto highest = static_cast<std::int16_t>(kTenths * settings.zones->limits.max_degC);
    plan.steps.push_back(write(channel(kHighAlarm, number), highest, fmt::format("high alarm of zone {}", number)));
  }
  return plan;
}

}  // namespace

BootPlan make_boot_plan(const ControllerSettings& settings, config::BoardKind kind, double safe_flow_kg_per_h) {
  switch (kind) {
    case config::BoardKind::kFeeder:
      return make_feeder_plan(settings, safe_flow_kg_per_h);
    case config::BoardKind::kScrewDrive:
      return make_screw_drive_plan(settings);
    case config::BoardKind::kMeltPressure:
      return make_melt_pressure_plan(settings);
    case config::BoardKind::kHeater:
      return make_heater_plan(settings);
    case config::BoardKind::kPreconditioner:
      return make_preconditioner_plan(settings);
    case config::BoardKind::kMeltCamera:
      return make_melt_camera_plan(settings);
  }
  return {};
}

unsigned calc_syncs_per_zone_report(Nanos sync_period) {
  return static_cast<unsigned>(std::clamp<Nanos::rep>(kZoneReportPeriod / sync_period, 1, 240));
}

bool moves_screw(const ControllerSettings& settings) {
  return settings.sequence || std::any_of(settings.orders.begin(), settings.orders.end(),
                                          [](const Order& order) { return order.kind == Order::Kind::kScrewSpeed; });
}

SdoStep make_loss_of_master_step(double flow_kg_per_h) {
  return write(feeder_object::kLossOfMasterFlow, static_cast<float>(flow_kg_per_h), "flow on loss of master");
}

}  // namespace meltbench::machine
