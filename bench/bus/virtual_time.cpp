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

std::vector<BitTimedMedium::Member> members_of(std::span<runtime::ParticipantPort* const> ports) {
  std::vector<BitTimedMedium::Member> members;
  for (const runtime::ParticipantPort* port : ports) members.push_back({port->name(), port->nodes()});
  return members;
}

}  // namespace

VirtualTime::VirtualTime(std::span<runtime::ParticipantPort* const> ports, Nanos record_period, RunObserver& observer,
                         const RunMedia& media)
    : record_period_{record_period},
      observer_{observer},
      outside_{media.outside},
      intervention_{media.intervention},
      lines_{media.lines} {
  MediumListener& self = *this;
  if (media.bit_timed) {
    medium_ = std::make_unique<BitTimedMedium>(*media.bit_timed, members_of(ports), self);
    medium_->set_clock_drifts(media.clock_drifts);
  }
  for (runtime::ParticipantPort* port : ports) {
    Party party;
    party.port = port;
    party.first_signal = values_.size();
    party.signal_count = port->signals().size();
    values_.resize(values_.size() + party.signal_count);
    parties_.push_back(std::move(party));
    lines_.add_participant(port->lines());
  }
}

RunOutcome VirtualTime::run(Nanos duration) {
  while (true) {
    const std::size_t number = choose_next();
    const Instant due = std::max(now_, next_wake(parties_[number]));
    const Instant others = std::min({due, lines_.next_delivery(), std::max(now_, next_intervention())});
    const Instant next = std::min(others, next_on_bus());
    if (next > Instant{duration}) break;
    if (next > now_) {
      if (runtime::stop_requested())
        return end(RunOutcome::Kind::kInterrupted, lost_text({}, PortStatus::kInterrupted, now_));
      advance_to(next);
      if (admit_outside()) continue;  // Everybody has something to read: who is first is chosen anew.
      if (intervention_ != nullptr && intervention_->look(now_)) continue;
    }
    if (next < others) {
      medium_->advance(now_);
      continue;
    }
    if (next_intervention() <= now_) {
      intervention_->on_time(now_, *this);
      continue;
    }
    if (lines_.next_delivery() <= now_) {
      deliver_serial();  // First of all: who is woken at this instant finds it there.
      continue;
    }
    if (++wakeups_now_ > kMaxWakeupsAtOneInstant) {
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

void VirtualTime::advance_to(Instant at) {
  write_rows_before(at);
  now_ = std::max(now_, std::min(at, next_intervention()));  // A row may have asked for one, at its own instant.
  wakeups_now_ = 0;
}

void VirtualTime::plug_line(std::size_t participant, std::uint8_t own_line, bool in) {
  lines_.plug(now_, participant, own_line, in);
  parties_[participant].line_changed = true;
}

void VirtualTime::post_order(std::size_t participant, std::string order) {
  parties_[participant].orders.push_back(std::move(order));
}

Instant VirtualTime::next_wake(const Party& party) {
  if (!party.orders.empty() || party.line_changed || party.node_changed) return Instant{};
  if (party.wake_on == WakeOn::kDeadlineOnly) return party.deadline;
  if (!party.inbox.empty() || !party.serial.empty()) return Instant{};
  return std::min(party.deadline, party.next_record);
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
  const Wakeup in{.now = now_,
                  .frames = taken_,
                  .serial = party.serial.arrivals(),
                  .lines = lines_.states(number),
                  .nodes = medium_ ? medium_->states(number) : std::span<const can::ErrorState>{},
                  .orders = taken_orders_};
  const PortStatus status = party.port->wake(in, out_, signals);
  party.serial.clear();
  party.line_changed = false;
  party.node_changed = false;
  if (status != PortStatus::kOk) return status;
  // A deadline that has passed would hold the time: the participant is asked again at the next nanosecond.
  party.deadline = std::max(out_.deadline(), now_ + 1ns);
  party.wake_on = out_.wake_on();
  while (party.next_record <= now_) party.next_record += record_period_;
  return status;
}

void VirtualTime::carry(std::size_t sender) {
  for (const Event& event : out_.events()) observer_.on_event(sender, event);
  if (medium_) {
    queue(sender);
  } else {
    for (const can::CanFrame& frame : out_.frames()) put_on_bus(frame, sender);
  }
  for (const SerialPiece& piece : out_.serial()) lines_.write(now_, sender, piece.line, out_.serial_bytes(piece));
}

void VirtualTime::put_on_bus(const can::CanFrame& frame, std::size_t sender) {
  if (intervention_ == nullptr || intervention_->on_frame({now_, frame}, sender, *this)) deliver(frame, sender);
}

void VirtualTime::deliver(const can::CanFrame& frame, std::size_t sender) {
  give(frame, sender, sender < parties_.size() ? ~(std::uint64_t{1} << sender) : ~std::uint64_t{0});
}

void VirtualTime::give(const can::CanFrame& frame, std::size_t sender, std::uint64_t heard_by) {
  const can::StampedFrame stamped{now_, frame};
  observer_.on_frame(stamped, sender);
  if (outside_ != nullptr) outside_->show(stamped, sender);
  for (std::size_t number = 0; number < parties_.size(); ++number) {
    if (((heard_by >> number) & 1U) != 0) parties_[number].inbox.push_back(stamped);
  }
}

/// Hands what a participant sends to its nodes on the bit-timed bus.
void VirtualTime::queue(std::size_t sender) {
  const auto frames = out_.frames();
  auto mark = out_.senders().begin();
  std::size_t node = 0;
  for (std::size_t i = 0; i < frames.size(); ++i) {
    for (; mark != out_.senders().end() && mark->first <= i; ++mark) node = mark->node;
    medium_->send(now_, sender, node, frames[i]);
  }
}

void VirtualTime::on_crossed(const can::StampedFrame& frame, std::size_t sender, std::uint64_t heard_by) {
  if (intervention_ == nullptr || intervention_->on_frame(frame, sender, *this)) give(frame.frame, sender, heard_by);
}

void VirtualTime::on_error_frame(const can::StampedFrame& error, std::size_t participant) {
  observer_.on_frame(error, participant);
  if (outside_ != nullptr) outside_->show(error, participant);
}

void VirtualTime::on_node_state(std::size_t participant, const Event& event) {
  if (participant < parties_.size()) parties_[participant].node_changed = true;
  observer_.on_event(kOutsideSender, event);
}

Instant VirtualTime::next_on_bus() const {
  return medium_ ? std::max(now_, medium_->next_event()) : Instant::never();
}

Instant VirtualTime::next_intervention() const {
  return intervention_ == nullptr ? Instant::never() : intervention_->next_deadline();
}

void VirtualTime::deliver_serial() {
  const HeardPiece piece = lines_.take();
  observer_.on_serial(piece.line, piece.sender, piece.at, piece.bytes);
  for (const LineEnd& listener : piece.listeners) {
    parties_[listener.participant].serial.add(piece.at, listener.own_line, piece.bytes);
  }
}

/// @returns whether frames from outside have come on the bus now.
bool VirtualTime::admit_outside() {
  if (outside_ == nullptr) return false;
  from_outside_.clear();
  const std::size_t room = medium_ ? medium_->room_for_outside() : kMaxOutsideFramesAtOnce;
  outside_->exchange(std::min(room, kMaxOutsideFramesAtOnce), from_outside_);
  if (from_outside_.empty()) return false;
  if (!std::exchange(outside_has_sent_, true)) observer_.on_event(kTapSender, make_outside_event(now_));
  for (const can::CanFrame& frame : from_outside_) {
    medium_ ? medium_->send_from_outside(now_, frame) : put_on_bus(frame, kTapSender);
  }
  return !medium_;
}

void VirtualTime::write_rows_before(Instant now) {
  for (; next_row_ < now; next_row_ += record_period_) {
    observer_.on_row(next_row_, values_);
    if (intervention_ != nullptr) intervention_->on_row(next_row_, values_);
  }
}

RunOutcome VirtualTime::end(RunOutcome::Kind kind, std::string text) const {
  return RunOutcome{kind, std::move(text), now_, medium_ ? medium_->lost_frames() : 0};
}

}  // namespace meltbench::bus
