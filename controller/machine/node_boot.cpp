#include "controller/machine/node_boot.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <utility>

#include "controller/machine/drive_402.hpp"
#include "controller/machine/objects.hpp"

namespace meltbench::machine {

namespace {

constexpr double kSpeedTolerance = 0.01;  // Of the target: the ramp has ended.

}  // namespace

NodeBoot::NodeBoot(std::string label, std::uint8_t node_id, BootPlan plan, const BootTimes& times)
    : label_{std::move(label)},
      node_id_{node_id},
      plan_{std::move(plan)},
      times_{times},
      queue_{node_id, label_, times.sdo_timeout} {}

void NodeBoot::begin(Instant now, canopen::Frames& out) {
  if (list_runs_) queue_.cancel(now, out);
  restart(Instant::never());
  phase_ = Phase::kWaiting;
  deadline_ = now + times_.boot_timeout;
  act_at_ = now + kResetInterval;
}

void NodeBoot::on_boot_up(Instant now, canopen::Frames& out) {
  if (phase_ == Phase::kIdle || phase_ == Phase::kFailed) return;
  if (phase_ == Phase::kWaiting) return restart(now);
  if (!list_runs_ && phase_ == Phase::kConfiguring) return;  // About to begin anyway.
  queue_.cancel(now, out);
  last_trouble_ = "it was reset in the middle of the configuration";
  restart(now + kSettleTime);
}

void NodeBoot::restart(Instant at) {
  phase_ = Phase::kConfiguring;
  list_runs_ = false;
  controlword_.reset();
  write_controlword_ = target_written_ = false;
  act_at_ = at;
}

void NodeBoot::on_frame(Instant now, const can::CanFrame& frame, canopen::Frames& out) {
  queue_.on_frame(now, frame, out);
}

void NodeBoot::on_time(Instant now, canopen::Frames& out) {
  if (phase_ == Phase::kIdle || phase_ == Phase::kFailed) return;
  queue_.on_time(now, out);
  if (phase_ == Phase::kDone) return;
  if (phase_ == Phase::kWaiting && now >= act_at_) {
    out.push_back(canopen::make_nmt_command(canopen::NmtCommand::kResetCommunication, node_id_));
    act_at_ = now + kResetInterval;
  }
  while (phase_ == Phase::kConfiguring || phase_ == Phase::kEnabling) {
    if (!list_runs_ && now >= act_at_) begin_list(now, out);
    if (!list_runs_ || queue_.status() == canopen::ConfigurationQueue::Status::kBusy) break;
    conclude_list(now);
  }
  if (now >= deadline_ && phase_ != Phase::kDone && phase_ != Phase::kFailed) {
    queue_.cancel(now, out);
    fail("boot-timeout",
         fmt::format("{} is not ready after {:.3g} s: {}", label_, to_s(times_.boot_timeout), what_it_waits_for()));
  }
}

Instant NodeBoot::next_deadline() const {
  switch (phase_) {
    case Phase::kIdle:
    case Phase::kFailed:
      return Instant::never();
    case Phase::kDone:
      return queue_.next_deadline();
    default:
      return std::min({deadline_, list_runs_ ? Instant::never() : act_at_, queue_.next_deadline()});
  }
}

void NodeBoot::begin_list(Instant now, canopen::Frames& out) {
  list_runs_ = true;
  queue_.start(now, phase_ == Phase::kConfiguring ? plan_.steps : make_enable_steps(), out);
}

void NodeBoot::conclude_list(Instant now) {
  list_runs_ = false;
  if (queue_.status() == canopen::ConfigurationQueue::Status::kFailed) {
    if (queue_.last_result().status == canopen::SdoStatus::kTimedOut) {
      ++sdo_timeouts_;
      last_trouble_ = queue_.failure();
      return restart(now + kSettleTime);
    }
    // A wrong identity is an answer that is not the expected one; a refused read is a configuration that cannot work.
    const bool answered = queue_.last_result().status == canopen::SdoStatus::kDone;
    const bool is_identity = answered && phase_ == Phase::kConfiguring && queue_.steps_done() < plan_.identity_steps;
    return fail(is_identity ? "identity-mismatch" : "configuration-failed", queue_.failure());
  }
  if (phase_ == Phase::kEnabling) return on_drive_status(now);
  for (std::size_t i = 0; i < plan_.steps.size(); ++i) {
    canopen::SdoStep& step = plan_.steps[i];
    if (step.kind != canopen::SdoStep::Kind::kRead) continue;
    const auto value = queue_.value_read(i);
    if (value.size() != step.value.size()) {
      return fail("configuration-failed", fmt::format("{}: {}: {} has {} bytes, expected {}", label_, step.purpose,
                                                      canopen::text(step.address), value.size(), step.value.size()));
    }
    std::copy(value.begin(), value.end(), step.value.begin());
  }
  phase_ = plan_.screw_rev_per_s ? Phase::kEnabling : Phase::kDone;
  act_at_ = now;
}

std::int32_t NodeBoot::target_inc_per_s() const {
  const auto increments = value<std::uint32_t>(drive_object::kEncoderIncrements);
  const auto revolutions = std::max(value<std::uint32_t>(drive_object::kEncoderRevolutions), 1U);
  const double target = plan_.screw_rev_per_s.value_or(0.0) * increments / revolutions;
  return static_cast<std::int32_t>(std::lround(std::clamp(target, 0.0, 2e9)));
}

// The last two steps read the status word and the speed demanded by the ramp.
std::vector<canopen::SdoStep> NodeBoot::make_enable_steps() const {
  using namespace drive_object;
  using Kind = canopen::SdoStep::Kind;
  std::vector<canopen::SdoStep> steps;
  if (!target_written_) {
    // Target before mode: a drive that turns already must not see a target of 0 in the new mode.
    steps.push_back(canopen::write_step(kTargetVelocity.index, kTargetVelocity.sub, target_inc_per_s(), "speed"));
    steps.push_back(canopen::write_step(kMode.index, kMode.sub, kProfileVelocityMode, "mode: profile velocity"));
  }
  if (write_controlword_) {
    steps.push_back(canopen::write_step(kControlword.index, kControlword.sub, *controlword_, "control word"));
  }
  steps.push_back({Kind::kRead, kStatusword, {}, "status word"});
  steps.push_back({Kind::kRead, kVelocityDemand, {}, "speed demand"});
  return steps;
}

void NodeBoot::on_drive_status(Instant now) {
  const std::size_t count = queue_.step_count();
  const auto statusword = queue_.value_read(count - 2);
  const auto demand = queue_.value_read(count - 1);
  if (statusword.size() < sizeof(std::uint16_t) || demand.size() < sizeof(std::int32_t)) {
    return fail("configuration-failed", fmt::format("{}: status word or speed demand is too short", label_));
  }
  target_written_ = true;
  const DriveState state = decode_drive_state(canopen::load<std::uint16_t>(statusword));
  drive_state_ =
      fmt::format("{}, {} of {} increments/s", text(state), canopen::load<std::int32_t>(demand), target_inc_per_s());
  const double missing = std::abs(target_inc_per_s() - static_cast<double>(canopen::load<std::int32_t>(demand)));
  const bool enabled = state == DriveState::kOperationEnabled && controlword_ == kEnableOperation;
  if (enabled && missing <= kSpeedTolerance * target_inc_per_s()) {
    phase_ = Phase::kDone;
    return;
  }
  const auto next = next_controlword(state);
  write_controlword_ = next && next != controlword_;
  if (write_controlword_) controlword_ = next;
  act_at_ = write_controlword_ ? now : now + kPollInterval;
}

void NodeBoot::fail(std::string_view code, std::string why) {
  phase_ = Phase::kFailed;
  list_runs_ = false;
  failure_code_ = code;
  failure_ = std::move(why);
}

std::string NodeBoot::what_it_waits_for() const {
  if (phase_ == Phase::kWaiting) {
    return fmt::format("no boot-up message; is it powered, on this bus, at this bit rate, and set to node id {}?",
                       node_id_);
  }
  if (phase_ == Phase::kEnabling && !drive_state_.empty()) return fmt::format("the drive stays in {}", drive_state_);
  return last_trouble_.empty() ? "the configuration has not ended" : last_trouble_;
}

std::span<const std::uint8_t> NodeBoot::find_value(canopen::ObjectAddress address) const {
  for (const canopen::SdoStep& step : plan_.steps) {
    if (step.kind != canopen::SdoStep::Kind::kWrite && step.address == address) return step.value;
  }
  throw std::logic_error(fmt::format("{}: the boot plan does not read {}", label_, canopen::text(address)));
}

void NodeBoot::write(Instant now, std::vector<canopen::SdoStep> steps, canopen::Frames& out) {
  list_runs_ = true;
  queue_.start(now, std::move(steps), out);
}

std::optional<std::string> NodeBoot::take_failure() {
  if (phase_ != Phase::kDone || !list_runs_ || queue_.status() == canopen::ConfigurationQueue::Status::kBusy) return {};
  list_runs_ = false;
  if (queue_.status() != canopen::ConfigurationQueue::Status::kFailed) return {};
  if (queue_.last_result().status == canopen::SdoStatus::kTimedOut) ++sdo_timeouts_;
  return queue_.failure();
}

}  // namespace meltbench::machine
