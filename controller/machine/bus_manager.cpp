#include "controller/machine/bus_manager.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <utility>

#include "controller/machine/boot_plan.hpp"
#include "controller/machine/objects.hpp"
#include "controller/safety/interlock.hpp"

namespace meltbench::machine {

namespace {

/// Identifiers of the predefined connection set without their node id.
namespace cob_id_base {
constexpr std::uint32_t kEmcy = 0x080, kSdoResponse = 0x580, kNodeControl = 0x700;
}

constexpr std::uint64_t kMaxEmcyEvents = 100;  // A babbling board is counted further, but not written down.

/// First multiple of the period at or after `now`.
Instant round_up_to_grid(Instant now, Nanos period) {
  const Nanos into = now.since_start % period;
  return into == Nanos{} ? now : now + (period - into);
}

std::vector<BoardSettings> boards_on_can(std::vector<BoardSettings> boards) {
  std::erase_if(boards, [](const BoardSettings& board) { return board.is_on_line(); });
  return boards;
}

bool has_set_point_watchdog(config::BoardKind kind) {
  return kind == config::BoardKind::kFeeder || kind == config::BoardKind::kHeater ||
         kind == config::BoardKind::kPreconditioner;
}

}  // namespace

BusManager::BusManager(const ControllerSettings& settings, double safe_flow_kg_per_h)
    : node_id_{settings.node_id},
      heartbeat_{settings.heartbeat},
      sync_period_{settings.sync_period},
      boards_{boards_on_can(settings.boards)} {
  const BootTimes times{settings.boot_timeout, settings.sdo_timeout};
  boots_.reserve(boards_.size());
  for (std::size_t i = 0; i < boards_.size(); ++i) {
    boots_.emplace_back(label(i), boards_[i].node_id, make_boot_plan(settings, boards_[i].kind, safe_flow_kg_per_h),
                        times);
  }
}

Instant BusManager::next_deadline() const {
  Instant next = std::min({heartbeat_timer_.next_deadline(), sync_timer_.next_deadline(), heartbeats_.next_deadline()});
  if (phase_ == Phase::kBooting || phase_ == Phase::kUp) {
    for (const NodeBoot& boot : boots_) next = std::min(next, boot.next_deadline());
  }
  return next;
}

std::optional<Trouble> BusManager::take_trouble() {
  if (troubles_.empty()) return {};
  Trouble trouble = std::move(troubles_.front());
  troubles_.erase(troubles_.begin());
  return trouble;
}

// --- boot

void BusManager::start(Instant now, Outbox& out) {
  phase_ = Phase::kBooting;
  heartbeats_ = {};
  troubles_.clear();
  sync_timer_.stop();
  heartbeat_timer_.start(now + heartbeat_, heartbeat_);
  out.send(canopen::make_heartbeat(node_id_, canopen::NmtState::kInitialising));
  out.send(canopen::make_nmt_command(canopen::NmtCommand::kResetCommunication, 0));
  for (NodeBoot& boot : boots_) boot.begin(now, out.frame_queue());
}

bool BusManager::on_time(Instant now, bool others_ready, Outbox& out) {
  const bool started = run_boot(now, others_ready, out);
  while (const auto lost = heartbeats_.take_lost(now)) on_heartbeat(now, *lost, out);
  if (!started) run_later_writes(now, out);
  return started;
}

bool BusManager::run_boot(Instant now, bool others_ready, Outbox& out) {
  if (phase_ != Phase::kBooting) return false;
  bool all_done = true;
  for (NodeBoot& boot : boots_) {
    boot.on_time(now, out.frame_queue());
    if (boot.phase() == NodeBoot::Phase::kFailed) {
      phase_ = Phase::kFailed;
      complain(boot.failure_code(), boot.failure());
      return false;
    }
    all_done = all_done && boot.phase() == NodeBoot::Phase::kDone;
  }
  if (!all_done || !others_ready) return false;
  start_nodes(now, out);
  return true;
}

void BusManager::start_nodes(Instant now, Outbox& out) {
  paces_.clear();
  for (const BoardSettings& board : boards_) {
    out.send(canopen::make_nmt_command(canopen::NmtCommand::kStart, board.node_id));
    heartbeats_.watch_from(now, board.node_id, kHeartbeatsMissed * board.heartbeat);
    paces_.emplace_back(board.heartbeat);
  }
  phase_ = Phase::kUp;
  ready_at_ = now;
  sync_timer_.start(round_up_to_grid(now, sync_period_), sync_period_);
}

void BusManager::run_later_writes(Instant now, Outbox& out) {
  if (phase_ != Phase::kUp) return;
  for (NodeBoot& boot : boots_) {
    boot.on_time(now, out.frame_queue());
    if (const auto failure = boot.take_failure()) out.report(Severity::kWarning, now, "configuration-failed", *failure);
  }
}

void BusManager::send_heartbeat_if_due(Instant now, Outbox& out) {
  if (!heartbeat_timer_.take(now)) return;
  const bool up = phase_ == Phase::kUp;
  out.send(
      canopen::make_heartbeat(node_id_, up ? canopen::NmtState::kOperational : canopen::NmtState::kPreOperational));
}

bool BusManager::send_sync_if_due(Instant now, Outbox& out) {
  if (!sync_timer_.take(now)) return false;
  out.send(canopen::make_sync());
  return true;
}

// --- arrivals

void BusManager::on_frame(Instant now, const can::CanFrame& frame, Outbox& out) {
  constexpr std::uint32_t kFunctionMask = 0x780;
  switch (frame.id & kFunctionMask) {
    case cob_id_base::kEmcy:
      if (const auto emcy = canopen::parse_emcy(frame)) on_emcy(now, *emcy, out);
      break;
    case cob_id_base::kSdoResponse:
      if (const std::size_t i = find_node(frame.id & ~kFunctionMask); i < boots_.size()) {
        boots_[i].on_frame(now, frame, out.frame_queue());
      }
      break;
    case cob_id_base::kNodeControl:
      on_node_control(now, frame, out);
      break;
    default:
      break;
  }
}

void BusManager::on_node_control(Instant now, const can::CanFrame& frame, Outbox& out) {
  const std::size_t i = find_node(frame.id - cob_id_base::kNodeControl);
  if (i == boots_.size()) return;
  const bool boot_up =
      frame.length == 1 && frame.bytes[0] == static_cast<std::uint8_t>(canopen::NmtState::kInitialising);
  if (phase_ == Phase::kBooting && boot_up) boots_[i].on_boot_up(now, out.frame_queue());
  if (phase_ == Phase::kUp && paces_[i].add(now)) {
    complain("node-doubled",
             fmt::format("{}: more heartbeats than one device sends every {:.3g} s; has another one the "
                         "same node id?",
                         label(i), to_s(boards_[i].heartbeat)));
  }
  if (const auto event = heartbeats_.on_frame(now, frame)) on_heartbeat(now, *event, out);
}

void BusManager::on_heartbeat(Instant now, const canopen::HeartbeatEvent& event, Outbox& out) {
  const std::size_t i = find_node(event.node);
  switch (event.change) {
    case canopen::HeartbeatChange::kLost:
      ++heartbeats_lost_;
      return complain("heartbeat-lost", fmt::format("{}: no heartbeat for {:.3g} s; has it lost power or its cable?",
                                                    label(i), to_s(kHeartbeatsMissed * boards_[i].heartbeat)));
    case canopen::HeartbeatChange::kBootUp:
      return complain("node-reset", fmt::format("{} was reset and has lost its configuration", label(i)));
    case canopen::HeartbeatChange::kBack:
      out.report(Severity::kInfo, now, "heartbeat-back",
                 fmt::format("{}: heartbeat is back, state {}", label(i), canopen::text(event.state)));
      [[fallthrough]];
    case canopen::HeartbeatChange::kFirst:
    case canopen::HeartbeatChange::kState:
      // A heartbeat from before the start may still be under way.
      if (event.state != canopen::NmtState::kOperational && now > ready_at_ + boards_[i].heartbeat) {
        complain("node-not-operational",
                 fmt::format("{} is {}; who has stopped it?", label(i), canopen::text(event.state)));
      }
  }
}

void BusManager::on_emcy(Instant now, const canopen::ReceivedEmcy& received, Outbox& out) {
  const std::size_t i = find_node(received.node);
  if (i == boots_.size()) return;
  const std::uint16_t code = received.emcy.code;
  if (code != canopen::emcy_code::kNoError) ++emcys_;
  if (emcys_ > kMaxEmcyEvents) return;
  if (code == canopen::emcy_code::kNoError) {
    out.report(Severity::kInfo, now, "emcy-over",
               fmt::format("{}: error over, error register 0x{:02X}", label(i), received.emcy.error_register));
    return;
  }
  std::string what = fmt::format("{}: EMCY {:04X}, {}, error register 0x{:02X}", label(i), code,
                                 canopen::emcy_text(code), received.emcy.error_register);
  const bool own_watchdog = code == kEmcyNoSetPoints && has_set_point_watchdog(boards_[i].kind);
  const bool not_tuned = code == kEmcyAutotune && boards_[i].kind == config::BoardKind::kHeater;
  if (code == kEmcyHopperEmpty && boards_[i].kind == config::BoardKind::kFeeder) {
    complain("feeder-empty", what + "; the hopper is empty");
  } else if (own_watchdog || not_tuned || safety::is_survivable_emcy(code) || phase_ != Phase::kUp) {
    out.report(Severity::kWarning, now, "emcy", std::move(what));
  } else {
    complain("emcy", std::move(what));
  }
}

// --- boards

NodeBoot& BusManager::boot(config::BoardKind kind) {
  return boots_[index_of(kind)];
}

const NodeBoot& BusManager::boot(config::BoardKind kind) const {
  return boots_[index_of(kind)];
}

std::uint64_t BusManager::sdo_timeouts() const {
  std::uint64_t sum = 0;
  for (const NodeBoot& boot : boots_) sum += boot.sdo_timeouts();
  return sum;
}

std::size_t BusManager::index_of(config::BoardKind kind) const {
  std::size_t index = 0;
  while (boards_[index].kind != kind) ++index;
  return index;
}

std::size_t BusManager::find_node(std::uint32_t node_id) const {
  std::size_t index = 0;
  while (index < boards_.size() && boards_[index].node_id != node_id) ++index;
  return index;
}

std::string BusManager::label(std::size_t index) const {
  return fmt::format("{} (node {})", boards_[index].name, boards_[index].node_id);
}

}  // namespace meltbench::machine
