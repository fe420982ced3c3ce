#include "controller/machine/traffic.hpp"

#include <algorithm>
#include <map>

#include "controller/machine/boot_plan.hpp"

namespace meltbench::machine {
namespace {

constexpr std::uint32_t kPdoOff = 0x8000'0000U;
constexpr std::uint16_t kReceiveParameters = 0x1400, kTransmitParameters = 0x1800, kToMapping = 0x0200;
constexpr std::uint16_t kPdosOfOneKind = 0x0200;

std::uint32_t to_number(const std::vector<std::uint8_t>& bytes) {
  std::uint32_t number = 0;
  for (std::size_t i = std::min<std::size_t>(bytes.size(), 4); i-- > 0;) number = number << 8U | bytes[i];
  return number;
}

/// What the writes of a boot leave in the PDO parameters of a board.
struct Pdo {
  std::uint32_t cob_id = kPdoOff;
  std::uint32_t type = 255;
  unsigned bits = 0;
};

/// By the index of their communication parameters.
std::map<std::uint16_t, Pdo> read_pdos(const BootPlan& plan) {
  std::map<std::uint16_t, Pdo> pdos;
  for (const canopen::SdoStep& step : plan.steps) {
    const auto [index, sub] = step.address;
    const std::uint32_t value = to_number(step.value);
    const bool is_pdo = index >= kReceiveParameters && index < kTransmitParameters + 2 * kPdosOfOneKind;
    if (step.kind != canopen::SdoStep::Kind::kWrite || !is_pdo) continue;
    if ((index & kToMapping) == 0) {
      if (sub == 1) pdos[index].cob_id = value;
      if (sub == 2) pdos[index].type = value;
    } else if (sub > 0) {
      pdos[static_cast<std::uint16_t>(index - kToMapping)].bits += value & 0xFFU;
    }
  }
  return pdos;
}

PlannedFrame plan(std::uint32_t id, unsigned length, Nanos period, PlannedFrame::Cause cause) {
  PlannedFrame planned;
  planned.frame.id = id;
  planned.frame.length = static_cast<std::uint8_t>(length);
  planned.period = period;
  planned.cause = cause;
  return planned;
}

}  // namespace

std::vector<PlannedFrame> plan_traffic(const ControllerSettings& settings) {
  using Cause = PlannedFrame::Cause;
  constexpr std::uint32_t kSync = 0x080, kHeartbeat = 0x700;
  std::vector<PlannedFrame> traffic{plan(kSync, 0, settings.sync_period, Cause::kTimer),
                                    plan(kHeartbeat + settings.node_id, 1, settings.heartbeat, Cause::kTimer)};
  for (const BoardSettings& board : settings.boards) {
    if (board.is_on_line()) continue;
    traffic.push_back(plan(kHeartbeat + board.node_id, 1, board.heartbeat, Cause::kTimer));
    for (const auto& [index, pdo] : read_pdos(make_boot_plan(settings, board.kind, 0.0))) {
      if ((pdo.cob_id & kPdoOff) != 0) continue;
      const bool transmit = index >= kTransmitParameters;
      const bool every_nth = transmit && pdo.type >= 1 && pdo.type <= 240;
      const Nanos period = settings.sync_period * (every_nth ? pdo.type : 1U);
      traffic.push_back(
          plan(pdo.cob_id & can::kMaxStandardId, pdo.bits / 8, period, transmit ? Cause::kSync : Cause::kCycle));
    }
  }
  return traffic;
}

}  // namespace meltbench::machine
