#include "controller/machine/boot_plan.hpp"

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

}  // namespace

SdoStep make_loss_of_master_step(double flow_kg_per_h) {
  return write(feeder_object::kLossOfMasterFlow, static_cast<float>(flow_kg_per_h), "flow on loss of master");
}

BootPlan make_feeder_plan(const ControllerSettings& settings, double safe_flow_kg_per_h) {
  using namespace feeder_object;
  const BoardSettings& board = settings.feeder;
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
  const BoardSettings& board = settings.screw_drive;
  BootPlan plan = make_common_plan(settings, board);
  append_pdo(plan, board.node_id, canopen::PdoDirection::kReceive, kControlwordRpdo, canopen::kEventProfile,
             {{kControlword, 16}});
  append_pdo(plan, board.node_id, canopen::PdoDirection::kTransmit, kMotionTpdo, kEverySync,
             {{kPosition, 32}, {kVelocity, 32}});
  const std::int16_t on_loss = settings.safe_screw == SafeScrew::kStop ? kQuickStopOption : kNoAction;
  plan.steps.push_back(write(kAbortConnectionOption, on_loss, "reaction to loss of master"));
  plan.steps.push_back(read<std::uint32_t>(kEncoderIncrements, "encoder increments"));
  plan.steps.push_back(read<std::uint32_t>(kEncoderRevolutions, "encoder revolutions"));
  plan.screw_rev_per_s = settings.model.speed_m_per_s / settings.pitch_m;
  return plan;
}

BootPlan make_melt_pressure_plan(const ControllerSettings& settings) {
  using namespace pressure_object;
  const BoardSettings& board = settings.melt_pressure;
  BootPlan plan = make_common_plan(settings, board);
  append_pdo(plan, board.node_id, canopen::PdoDirection::kTransmit, kSampleTpdo, kEverySync,
             {{kPressure, 32}, {kStatus, 8}, {kAge, 16}});
  plan.steps.push_back(canopen::expect_step(kUnit.index, kUnit.sub, kUnitBar, "unit: bar"));
  plan.steps.push_back(read<std::uint8_t>(kDigits, "decimal digits"));
  plan.steps.push_back(read<std::uint32_t>(kSamplePeriod, "sample period"));
  plan.steps.push_back(read<std::uint32_t>(kLatency, "latency"));
  return plan;
}

}  // namespace meltbench::machine
