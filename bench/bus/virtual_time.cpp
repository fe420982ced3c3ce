#include "bench/bus/virtual_time.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <utility>

#include "protocols/runtime/stop_signal.hpp"

namespace meltbench::bus {
namespace {

using runtime::PortStatus;

/// Wake-ups at one instant after which the participants are said to run in a circle. A boot needs some hundreds.
constexpr int kMaxWakeupsAtOneInstant = 100'000;
/// Frames from outside that enter at one instant: about what a bus carries in 10 ms.
constexpr std::size_t kMaxOutsideFramesAtOnce = 64;

std::string lost_text(std::string_view name, PortStatus status, Instant at) {
  const double at_s = to_s(at);
  switch (status) {
    case PortStatus::kGone:
      return fmt::format("{} has died at {:.6f} s of the run", name, at_s);
    case PortStatus::kHanging:
      return fmt::format("{} hangs: no answer at {:.6f} s of the run", name, at_s);
    case PortStatus::kNonsense:
      return fmt::format("{} sent nonsense at {:.6f} s of the run", name, at_s);
    case PortStatus::kOk:
    case PortStatus::kInterrupted:
      break;
  }
  return "interrupted";
}

}  // namespace

VirtualTime::VirtualTime(std::span<runtime::ParticipantPort* const> ports, Nanos record_period, RunObserver& observer,
                         Outside* outside)
    : record_period_{record_period}, observer_{observer}, outside_{outside} {
  for (runtime::ParticipantPort* port : ports) {
    Party party;
    party.port = port;
    party.first_signal = values_.size();
    party.signal_count = port->signals().size();
    values_.resize(values_.size() + party.signal_count);
    parties_.push_back(std::move(party));
  }
}

RunOutcome VirtualTime::run(Nanos duration) {
  int wakeups_now = 0;
  while (true) {
    const std::size_t number = choose_next();
    const Instant due = std::max(now_, next_wake(parties_[number]));
    if (due > Instant{duration}) break;
    if (due > now_) {
      if (runtime::stop_requested())
        return end(RunOutcome::Kind::kInterrupted, lost_text({}, PortStatus::kInterrupted, now_));
      write_rows_before(due);
      now_ = due;
      wakeups_now = 0;
      if (admit_outside()) continue;  // Everybody has something to read: who is first is chosen anew.
    }
    if (++wakeups_now > kMaxWakeupsAtOneInstant) {
      return end(RunOutcome::Kind::kParticipantLost,
                 fmt::format("{} and others answer each other without end at {:.6f} s of the run",
                             parties_[number].port->name(), to_s(now_)));
    }
    const PortStatus status = wake(number);
    if (status == PortStatus::kInterrupted) {
      return end(RunOutcome::Kind::kInterrupted, lost_text({}, status, now_));
    }
    if (status != PortStatus::kOk) {
      return end(RunOutcome::Kind::kParticipantLost, lost_text(parties_[number].port->name(), status, now_));
    }
    carry(number);
  }
  now_ = Instant{duration};
  write_rows_before(now_ + 1ns);
  return end(RunOutcome::Kind::kCompleted, {});
}

void VirtualTime::post_order(std::size_t participant, std::string order) {
  parties_[participant].orders.push_back(std::move(order));
}

Instant VirtualTime::next_wake(const Party& party) {
  if (!party.orders.empty()) return Instant{};
  if (party.wake_on == WakeOn::kDeadlineOnly) return party.deadline;
  const Instant due = std::min(party.deadline, party.next_record);
  return party.inbox.empty() ? due : std::min(due, party.inbox.front().at);
}

std::size_t VirtualTime::choose_next() const {
  // Strictly earlier, so that the lowest number wins a tie. A handful of participants: a scan beats any queue.
  std::size_t chosen = 0;
  for (std::size_t number = 1; number < parties_.size(); ++number) {
    const Instant due = std::max(now_, next_wake(parties_[number]));
    if (due < std::max(now_, next_wake(parties_[chosen]))) chosen = number;
  }
  return chosen;
}

PortStatus VirtualTime::wake(std::size_t number) {
  Party& party = parties_[number];
  taken_.clear();
  std::swap(taken_, party.inbox);
  taken_orders_.clear();
  std::swap(taken_orders_, party.orders);
  const auto signals = std::span{values_}.subspan(party.first_signal, party.signal_count);
  const Wakeup in{.now = now_, .frames = taken_, .orders = taken_orders_};
  const PortStatus status = party.port->wake(in, out_, signals);
  if (status != PortStatus::kOk) return status;
  // A deadline that has passed would hold the time: the participant is asked again at the next nanosecond.
  party.deadline = std::max(out_.deadline(), now_ + 1ns);
  party.wake_on = out_.wake_on();
  while (party.next_record <= now_) party.next_record += record_period_;
  return status;
}

void VirtualTime::carry(std::size_t sender) {
  for (const Event& event : out_.events()) observer_.on_event(sender, event);
  for (const can::CanFrame& frame : out_.frames()) put_on_bus(frame, sender);
}

void VirtualTime::put_on_bus(const can::CanFrame& frame, std::size_t sender) {
  const can::StampedFrame stamped{now_, frame};
  observer_.on_frame(stamped, sender);
  if (outside_ != nullptr) outside_->show(stamped, sender);
  for (std::size_t number = 0; number < parties_.size(); ++number) {
    if (number != sender) parties_[number].inbox.push_back(stamped);
  }
}

/// @returns whether frames from outside have come on the bus now.
bool VirtualTime::admit_outside() {
  if (outside_ == nullptr) return false;
  from_outside_.clear();
  outside_->exchange(kMaxOutsideFramesAtOnce, from_outside_);
  if (from_outside_.empty()) return false;
  if (!std::exchange(outside_has_sent_, true)) observer_.on_event(kTapSender, make_outside_event(now_));
  for (const can::CanFrame& frame : from_outside_) put_on_bus(frame, kTapSender);
  return true;
}

void VirtualTime::write_rows_before(Instant now) {
  for (; next_row_ < now; next_row_ += record_period_) observer_.on_row(next_row_, values_);
}

RunOutcome VirtualTime::end(RunOutcome::Kind kind, std::string text) const {
  return RunOutcome{kind, std::move(text), now_, 0};
}

}  // namespace meltbench::bus
