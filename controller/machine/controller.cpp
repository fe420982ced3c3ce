#include "controller/machine/controller.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <utility>

#include "controller/machine/boot_plan.hpp"
#include "controller/machine/drive_402.hpp"
#include "controller/machine/objects.hpp"

namespace meltbench::machine {

namespace {

constexpr double kSecondsPerHour = 3600.0;

/// Identifiers of the predefined connection set without their node id.
namespace cob_id_base {
constexpr std::uint32_t kEmcy = 0x080, kSdoResponse = 0x580, kNodeControl = 0x700;
}

constexpr std::uint64_t kMaxEmcyEvents = 100;  // A babbling board is counted further, but not written down.

std::vector<SignalInfo> make_signals() {
  constexpr SignalKind kError = SignalKind::kErrorCounter;
  return {{"controller.x_m"},
          {"controller.P_m"},
          {"controller.U_command"},
          {"controller.U_applied"},
          {"controller.set_point_m"},
          {"controller.flow_command_kg_per_h"},
          {"controller.pressure_Pa"},
          {"controller.speed_m_per_s"},
          {"controller.measurement_age_s"},
          {"controller.reaction_s"},
          {"controller.state"},
          {"controller.sdo_timeouts", kError},
          {"controller.heartbeats_lost", kError},
          {"controller.tpdos_missed", kError},
          {"controller.emcys", kError},
          {"controller.syncs_missed", kError}};
}

/// First multiple of the period at or after `now`.
Instant round_up_to_grid(Instant now, Nanos period) {
  const Nanos into = now.since_start % period;
  return into == Nanos{} ? now : now + (period - into);
}

std::string_view explain_refusal(law::PredictionStatus status) {
  if (status == law::PredictionStatus::kInfeasible) {
    return "its prediction is not defined here, the speed fluctuates too fast for the delay; exact_predictor has no "
           "such limit";
  }
  return "a measurement or a history is not a number";
}

}  // namespace

std::string_view text(ControllerState state) {
  switch (state) {
    case ControllerState::kOff:
      return "off";
    case ControllerState::kBooting:
      return "booting";
    case ControllerState::kReady:
      return "ready";
    case ControllerState::kRunning:
      return "running";
    case ControllerState::kSafe:
      return "safe";
    case ControllerState::kFault:
      return "fault";
  }
  return "?";
}

Controller::Controller(ControllerSettings settings)
    : settings_{std::move(settings)}, loop_{std::make_unique<LengthLoop>(settings_, BoardFacts{})} {
  const BootTimes times{settings_.boot_timeout, settings_.sdo_timeout};
  boots_.reserve(kBoardCount);
  boots_.emplace_back(label(kFeeder), settings_.feeder.node_id,
                      make_feeder_plan(settings_, safe_flow_kg_per_s() * kSecondsPerHour), times);
  boots_.emplace_back(label(kScrewDrive), settings_.screw_drive.node_id, make_screw_drive_plan(settings_), times);
  boots_.emplace_back(label(kMeltPressure), settings_.melt_pressure.node_id, make_melt_pressure_plan(settings_), times);
}

void Controller::wake(const Wakeup& in, Outbox& out) {
  on_link(in.now, in.link, out);
  if (state_ == ControllerState::kOff) {
    start(in.now, out);  // What has come until now is older than the reset, and would only mislead.
  } else {
    for (const can::StampedFrame& stamped : in.frames) on_frame(in.now, stamped.frame, out);
  }
  run_boot(in.now, out);
  while (const auto lost = heartbeats_.take_lost(in.now)) on_heartbeat(in.now, *lost, out);
  run_set_points(in.now, out);
  run_feeder_writes(in.now, out);
  close_cycle_if_due(in.now, out);
  send_heartbeat_if_due(in.now, out);
  send_sync_if_due(in.now, out);
  out.wake_at(next_deadline());
}

Instant Controller::next_deadline() const {
  Instant next = std::min(
      {heartbeat_timer_.next_deadline(), sync_timer_.next_deadline(), cycle_deadline_, heartbeats_.next_deadline()});
  if (state_ == ControllerState::kBooting) {
    for (const NodeBoot& boot : boots_) next = std::min(next, boot.next_deadline());
  }
  if (is_up()) {
    next = std::min(next, boots_[kFeeder].next_deadline());
    if (set_point_ + 1 < settings_.set_points.size()) next = std::min(next, settings_.set_points[set_point_ + 1].from);
  }
  return next;
}

// --- boot

void Controller::start(Instant now, Outbox& out) {
  state_ = ControllerState::kBooting;
  heartbeat_timer_.start(now + settings_.heartbeat, settings_.heartbeat);
  out.send(canopen::make_heartbeat(settings_.node_id, canopen::NmtState::kInitialising));
  out.send(canopen::make_nmt_command(canopen::NmtCommand::kResetCommunication, 0));
  for (NodeBoot& boot : boots_) boot.begin(now);
}

void Controller::run_boot(Instant now, Outbox& out) {
  if (state_ != ControllerState::kBooting) return;
  bool all_done = true;
  for (NodeBoot& boot : boots_) {
    boot.on_time(now, out.frame_queue());
    if (boot.phase() == NodeBoot::Phase::kFailed) return trip(now, boot.failure_code(), boot.failure(), out);
    all_done = all_done && boot.phase() == NodeBoot::Phase::kDone;
  }
  if (all_done) start_nodes(now, out);
}

BoardFacts Controller::collect_facts() const {
  const NodeBoot& feeder = boots_[kFeeder];
  const NodeBoot& drive = boots_[kScrewDrive];
  const NodeBoot& pressure = boots_[kMeltPressure];
  const auto to_us = [](std::uint32_t us) { return us * 1us; };
  const double increments = drive.value<std::uint32_t>(drive_object::kEncoderIncrements);
  const double revolutions = drive.value<std::uint32_t>(drive_object::kEncoderRevolutions);
  constexpr double kPaPerBar = 1e5;
  BoardFacts facts;
  facts.metres_per_increment = settings_.pitch_m * revolutions / std::max(increments, 1.0);
  facts.Pa_per_count = kPaPerBar * std::pow(10.0, -pressure.value<std::uint8_t>(pressure_object::kDigits));
  facts.feeder_latency = to_us(feeder.value<std::uint32_t>(feeder_object::kLatency));
  facts.feeder_cycle = to_us(feeder.value<std::uint32_t>(feeder_object::kControlCycle));
  facts.pressure_latency = to_us(pressure.value<std::uint32_t>(pressure_object::kLatency));
  facts.pressure_period = to_us(pressure.value<std::uint32_t>(pressure_object::kSamplePeriod));
  return facts;
}

void Controller::start_nodes(Instant now, Outbox& out) {
  loop_ = std::make_unique<LengthLoop>(settings_, collect_facts());
  for (std::size_t i = 0; i < kBoardCount; ++i) {
    out.send(canopen::make_nmt_command(canopen::NmtCommand::kStart, board(i).node_id));
    heartbeats_.watch_from(now, board(i).node_id, kHeartbeatsMissed * board(i).heartbeat);
  }
  state_ = ControllerState::kReady;
  ready_at_ = now;
  sync_timer_.start(round_up_to_grid(now, settings_.sync_period), settings_.sync_period);
  out.report(
      Severity::kInfo, now, "ready",
      fmt::format("{} boards configured and started after {:.4g} s, law {}", boots_.size(), to_s(now), settings_.law));
}

void Controller::send_heartbeat_if_due(Instant now, Outbox& out) {
  if (!heartbeat_timer_.take(now)) return;
  const canopen::NmtState state = is_up() ? canopen::NmtState::kOperational : canopen::NmtState::kPreOperational;
  out.send(canopen::make_heartbeat(settings_.node_id, state));
}

// --- arrivals

void Controller::on_link(Instant now, LinkState link, Outbox& out) {
  if (link == link_) return;
  link_ = link;
  if (link == LinkState::kUp) {
    out.report(Severity::kInfo, now, "link-up", "the CAN link is up again");
  } else if (is_up()) {
    trip(now, "link-down", "the CAN link is down; look at cable, termination and bus-off of the interface", out);
  }
}

void Controller::on_frame(Instant now, const can::CanFrame& frame, Outbox& out) {
  if (frame.extended || frame.kind != can::FrameKind::kData) return;
  if (take_sample(frame)) return;
  constexpr std::uint32_t kFunctionMask = 0x780;
  switch (frame.id & kFunctionMask) {
    case cob_id_base::kEmcy:
      if (const auto emcy = canopen::parse_emcy(frame)) on_emcy(now, *emcy, out);
      break;
    case cob_id_base::kSdoResponse:
      if (const std::size_t i = find_board(frame.id & ~kFunctionMask); i < kBoardCount) {
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

bool Controller::take_sample(const can::CanFrame& frame) {
  using canopen::cob_id::tpdo;
  if (frame.id == tpdo(drive_object::kMotionTpdo, settings_.screw_drive.node_id)) {
    if (const auto report = parse_motion_report(frame)) {
      screw_ = {sync_at_, report->position_inc, report->velocity_inc_per_s};
    }
    return true;
  }
  if (frame.id == tpdo(feeder_object::kReportTpdo, settings_.feeder.node_id)) {
    const auto report = parse_feeder_report(frame);
    if (report && std::isfinite(report->flow_kg_per_h)) {
      std::optional<Nanos> age;
      if (report->age_10us != kAgeSaturated) age = report->age_10us * 10us;
      feed_ = {sync_at_, static_cast<double>(report->flow_kg_per_h) / kSecondsPerHour, age, report->changes};
    }
    return true;
  }
  if (frame.id == tpdo(pressure_object::kSampleTpdo, settings_.melt_pressure.node_id)) {
    if (const auto report = parse_pressure_report(frame)) {
      std::optional<Nanos> age;
      if (report->age_us != kAgeSaturated) age = report->age_us * 1us;
      pressure_ = {sync_at_, report->pressure_counts, age, report->status == 0};
    }
    return true;
  }
  return false;
}

void Controller::on_node_control(Instant now, const can::CanFrame& frame, Outbox& out) {
  const std::size_t i = find_board(frame.id - cob_id_base::kNodeControl);
  if (i == kBoardCount) return;
  const bool boot_up =
      frame.length == 1 && frame.bytes[0] == static_cast<std::uint8_t>(canopen::NmtState::kInitialising);
  if (state_ == ControllerState::kBooting && boot_up) boots_[i].on_boot_up(now, out.frame_queue());
  if (const auto event = heartbeats_.on_frame(now, frame)) on_heartbeat(now, *event, out);
}

void Controller::on_heartbeat(Instant now, const canopen::HeartbeatEvent& event, Outbox& out) {
  const std::size_t i = find_board(event.node);
  switch (event.change) {
    case canopen::HeartbeatChange::kLost:
      ++heartbeats_lost_;
      return trip(now, "heartbeat-lost",
                  fmt::format("{}: no heartbeat for {:.3g} s; has it lost power or its cable?", label(i),
                              to_s(kHeartbeatsMissed * board(i).heartbeat)),
                  out);
    case canopen::HeartbeatChange::kBootUp:
      return trip(now, "node-reset", fmt::format("{} was reset and has lost its configuration", label(i)), out);
    case canopen::HeartbeatChange::kBack:
      out.report(Severity::kInfo, now, "heartbeat-back",
                 fmt::format("{}: heartbeat is back, state {}", label(i), canopen::text(event.state)));
      [[fallthrough]];
    case canopen::HeartbeatChange::kFirst:
    case canopen::HeartbeatChange::kState:
      // A heartbeat from before the start may still be under way.
      if (event.state != canopen::NmtState::kOperational && now > ready_at_ + board(i).heartbeat) {
        trip(now, "node-not-operational",
             fmt::format("{} is {}; who has stopped it?", label(i), canopen::text(event.state)), out);
      }
  }
}

void Controller::on_emcy(Instant now, const canopen::ReceivedEmcy& received, Outbox& out) {
  const std::size_t i = find_board(received.node);
  if (i == kBoardCount) return;
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
  const bool own_watchdog = i == kFeeder && code == feeder_object::kEmcyNoSetPoints;
  if (own_watchdog || safety::is_survivable_emcy(code) || !is_up()) {
    out.report(Severity::kWarning, now, "emcy", std::move(what));
  } else {
    trip(now, "emcy", std::move(what), out);
  }
}

// --- the cycle

void Controller::run_set_points(Instant now, Outbox& out) {
  if (!is_up()) return;
  const std::size_t before = set_point_;
  while (set_point_ + 1 < settings_.set_points.size() && settings_.set_points[set_point_ + 1].from <= now) ++set_point_;
  if (set_point_ == before) return;
  loop_->select_set_point(set_point_);
  boots_[kFeeder].write(now, {make_loss_of_master_step(safe_flow_kg_per_s() * kSecondsPerHour)}, out.frame_queue());
  out.report(Severity::kInfo, now, "set-point", fmt::format("filled length to hold is now {:.4g} m", set_point_m()));
}

void Controller::run_feeder_writes(Instant now, Outbox& out) {
  if (!is_up()) return;
  NodeBoot& feeder = boots_[kFeeder];
  feeder.on_time(now, out.frame_queue());
  if (const auto failure = feeder.take_failure()) out.report(Severity::kWarning, now, "configuration-failed", *failure);
}

void Controller::send_sync_if_due(Instant now, Outbox& out) {
  if (!sync_timer_.take(now)) return;
  sync_at_ = now;
  cycle_deadline_ = now + settings_.sync_period / 2;
  out.send(canopen::make_sync());
}

void Controller::close_cycle_if_due(Instant now, Outbox& out) {
  if (cycle_deadline_ == Instant::never()) return;
  if (now < cycle_deadline_ && !(screw_ && feed_ && pressure_)) return;
  cycle_deadline_ = Instant::never();
  hand_over_samples();
  if (state_ == ControllerState::kSafe) {
    send_flow(now, safe_flow_kg_per_s(), out);
  } else {
    control(now, out);
  }
}

void Controller::hand_over_samples() {
  samples_missed_ += (screw_ ? 0U : 1U) + (feed_ ? 0U : 1U) + (pressure_ ? 0U : 1U);
  if (screw_) loop_->add(*screw_);  // First: feed and pressure are placed by the screw's clock and speed.
  if (feed_) loop_->add(*feed_);
  if (pressure_) loop_->add(*pressure_);
  screw_.reset();
  feed_.reset();
  pressure_.reset();
}

safety::Observation Controller::observe(Instant now) const {
  const auto age = [&](Instant at) { return now - std::max(at, ready_at_); };
  safety::Observation seen;
  seen.pressure_age = age(loop_->measured_at());
  seen.screw_age = age(loop_->screw_at());
  seen.feed_age = age(loop_->feed_at());
  if (const auto since = loop_->implausible_since()) seen.implausible_time = now - *since;
  if (loop_->is_pressure_good()) seen.pressure_Pa = loop_->pressure_Pa();
  if (loop_->has_estimate()) seen.filled_length_m = loop_->x_m();
  return seen;
}

void Controller::control(Instant now, Outbox& out) {
  const safety::Observation seen = observe(now);
  if (const safety::Trip why = safety::judge(settings_.limits, seen); why != safety::Trip::kNone) {
    return trip(now, safety::code_of(why), safety::describe(why, settings_.limits, seen), out);
  }
  if (!loop_->is_ready()) return;
  if (state_ == ControllerState::kReady) {
    state_ = ControllerState::kRunning;
    out.report(Severity::kInfo, now, "running", fmt::format("filled length {:.4f} m", loop_->x_m()));
  }
  command_ = loop_->calc(sync_at_, now);
  const bool refused =
      command_.status == law::PredictionStatus::kInfeasible || command_.status == law::PredictionStatus::kBadInput;
  if (refused || !std::isfinite(command_.flow_kg_per_s)) {
    return trip(now, "law-refused", fmt::format("{} refuses: {}", settings_.law, explain_refusal(command_.status)),
                out);
  }
  if (command_.status == law::PredictionStatus::kHistoryTooShort && !history_warned_) {
    history_warned_ = true;
    out.report(Severity::kWarning, now, "history-too-short",
               "the measurement is older than the feed history that is kept; the oldest feed stands in");
  }
  send_flow(now, command_.flow_kg_per_s, out);
  reaction_s_ = to_s(now - sync_at_);
}

void Controller::send_flow(Instant now, double flow_kg_per_s, Outbox& out) {
  command_.flow_kg_per_s = flow_kg_per_s;
  out.send(make_feed_command(settings_.feeder.node_id, static_cast<float>(flow_kg_per_s * kSecondsPerHour)));
  loop_->note_sent(now, flow_kg_per_s);
}

double Controller::safe_flow_kg_per_s() const {
  if (settings_.safe_feed == SafeFeed::kStop) return 0.0;
  return settings_.model.feed_kg_per_s(settings_.model.holding_ratio(set_point_m()), settings_.model.speed_m_per_s);
}

// --- doubt

void Controller::trip(Instant now, std::string_view code, std::string reason, Outbox& out) {
  const bool was_controlling = state_ == ControllerState::kReady || state_ == ControllerState::kRunning;
  if (state_ == ControllerState::kBooting) {
    state_ = ControllerState::kFault;
    reason += "; no board is started";
  } else if (was_controlling) {
    state_ = ControllerState::kSafe;
    reason += fmt::format("; feed goes to {:.4g} kg/h, the screw {}", safe_flow_kg_per_s() * kSecondsPerHour,
                          settings_.safe_screw == SafeScrew::kStop ? "stops" : "turns on");
  }
  out.report(Severity::kFault, now, std::string{code}, std::move(reason));
  if (!was_controlling) return;
  command_.U = settings_.model.holding_ratio(set_point_m());
  if (settings_.safe_feed == SafeFeed::kStop) command_.U = 0.0;
  send_flow(now, safe_flow_kg_per_s(), out);
  if (settings_.safe_screw == SafeScrew::kStop) {
    out.send(make_controlword(settings_.screw_drive.node_id, kQuickStop));
  }
}

bool Controller::is_up() const {
  return state_ == ControllerState::kReady || state_ == ControllerState::kRunning || state_ == ControllerState::kSafe;
}

const BoardSettings& Controller::board(std::size_t index) const {
  switch (index) {
    case kFeeder:
      return settings_.feeder;
    case kScrewDrive:
      return settings_.screw_drive;
    default:
      return settings_.melt_pressure;
  }
}

std::size_t Controller::find_board(std::uint32_t node_id) const {
  std::size_t index = 0;
  while (index < kBoardCount && board(index).node_id != node_id) ++index;
  return index;
}

std::string Controller::label(std::size_t index) const {
  return fmt::format("{} (node {})", board(index).name, board(index).node_id);
}

// --- the recording

std::span<const SignalInfo> Controller::signals() const {
  static const std::vector<SignalInfo> kSignals = make_signals();
  return kSignals;
}

void Controller::read_signals(std::span<double> values) const {
  std::uint64_t sdo_timeouts = 0;
  for (const NodeBoot& boot : boots_) sdo_timeouts += boot.sdo_timeouts();
  const double measurement_age_s = loop_->has_estimate() ? to_s(sync_at_ - loop_->measured_at()) : 0.0;
  const std::array<double, 16> all{loop_->x_m(),
                                   command_.P_m,
                                   command_.U,
                                   loop_->U_applied(),
                                   set_point_m(),
                                   command_.flow_kg_per_s * kSecondsPerHour,
                                   loop_->pressure_Pa(),
                                   loop_->speed_m_per_s(),
                                   measurement_age_s,
                                   reaction_s_,
                                   static_cast<double>(state_),
                                   static_cast<double>(sdo_timeouts),
                                   static_cast<double>(heartbeats_lost_),
                                   static_cast<double>(samples_missed_),
                                   static_cast<double>(emcys_),
                                   static_cast<double>(sync_timer_.missed())};
  std::copy(all.begin(), all.end(), values.begin());
}

}  // namespace meltbench::machine
