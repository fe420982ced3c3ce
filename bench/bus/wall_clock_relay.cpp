#include "bench/bus/wall_clock_relay.hpp"

#include <fmt/format.h>
#include <poll.h>

#include <algorithm>
#include <limits>
#include <utility>

#include "protocols/runtime/real_time_driver.hpp"
#include "protocols/runtime/stop_signal.hpp"

namespace meltbench::bus {
namespace {

/// A row waits this many record periods for the reports of its instant.
constexpr int kRowDelayPeriods = 3;
constexpr Nanos kStartDelay = 20ms;  // From the welcome to Instant{0}: all have read it by then.
/// Frames from outside that are taken at once. A participant whose queue is said to have room can take ten times as
/// many.
constexpr std::size_t kMaxOutsideFramesAtOnce = 16;

}  // namespace

WallClockRelay::WallClockRelay(std::span<Joined> joined, Broker& broker, link::CanLink* kernel_bus, Nanos record_period,
                               const RunMedia& media)
    : broker_{broker},
      kernel_bus_{kernel_bus},
      outside_{media.outside},
      intervention_{media.intervention},
      lines_{media.lines},
      record_period_{record_period} {
  if (media.adapter != nullptr) gateway_.emplace(*media.adapter);
  for (Joined& program : joined) {
    const std::size_t before = parties_.empty() ? 0 : parties_.back().first_signal + parties_.back().signal_count;
    add_party(program).first_signal = before;
  }
  if (media.bit_timed && kernel_bus_ == nullptr && media.adapter == nullptr) {
    std::vector<BitTimedMedium::Member> members;
    for (const Joined& program : joined) members.push_back({program.hello.name, program.hello.nodes});
    MediumListener& self = *this;
    medium_ = std::make_unique<BitTimedMedium>(*media.bit_timed, members, self);
    medium_->set_clock_drifts(media.clock_drifts);
  }
  // What was not reported yet has no value; a counter that was not reported has counted nothing.
  for (const SignalInfo& signal : signals_of(joined)) {
    values_.push_back(signal.kind == SignalKind::kErrorCounter ? 0.0 : std::numeric_limits<double>::quiet_NaN());
  }
}

std::vector<SignalInfo> WallClockRelay::signals_of(std::span<const Joined> joined) {
  std::vector<SignalInfo> signals;
  for (const Joined& program : joined) {
    signals.insert(signals.end(), program.hello.signals.begin(), program.hello.signals.end());
    const auto own = runtime::real_time_signals(program.hello.name);
    signals.insert(signals.end(), own.begin(), own.end());
  }
  return signals;
}

WallClockRelay::Party& WallClockRelay::add_party(Joined& joined) {
  lines_.add_participant(joined.hello.lines);
  Party party;
  party.joined = &joined;
  party.signal_count = joined.hello.signals.size() + runtime::real_time_signals(joined.hello.name).size();
  parties_.push_back(std::move(party));
  return parties_.back();
}

/// Lets in who comes to a running bus, unless the bench has started one of that name: two would drive one machine.
void WallClockRelay::take_newcomer() {
  auto newcomer = broker_.take_newcomer();
  const bool on_kernel_bus = kernel_bus_ != nullptr;
  if (!newcomer || newcomer->hello.carries_frames == on_kernel_bus) return;  // Frames of another bus than ours.
  const auto has_its_name = [&](const Party& party) {
    return !party.gone && party.joined->hello.name == newcomer->hello.name;
  };
  const auto is_unknown = [&](const std::string& line) { return lines_.find(line) == nullptr; };
  if (std::ranges::any_of(parties_, has_its_name) || std::ranges::any_of(newcomer->hello.lines, is_unknown)) return;
  outsiders_.push_back(std::move(*newcomer));
  Party& party = add_party(outsiders_.back());
  party.is_outsider = true;
  observer_->on_join(party.joined->hello.name);
  party.gone = !welcome(*party.joined, welcome_);
}

RunOutcome WallClockRelay::run(Nanos duration, double speed, RunObserver& observer) {
  observer_ = &observer;
  const Nanos start = runtime::read_monotonic() + kStartDelay;
  clock_ = runtime::RealTimeClock{start, speed};
  welcome_ = {link::Pace::kWallClock, speed, start, record_period_};
  for (std::size_t number = 0; number < parties_.size(); ++number) {
    parties_[number].heard_of = start;
    parties_[number].gone = !welcome(*parties_[number].joined, welcome_);
    tell_nodes(number);
  }
  const Nanos end = clock_.to_monotonic(Instant{duration});
  RunOutcome outcome;
  while (runtime::read_monotonic() < end && outcome.text.empty()) {
    Nanos until = std::min(end, runtime::read_monotonic() + (outside_has_more_ ? 0ms : 10ms));
    if (gateway_ && gateway_->has_waiting()) until = std::min(until, runtime::read_monotonic() + 1ms);
    wait(find_next_event(until));
    take_newcomer();
    intervene();
    for (std::size_t number = 0; number < parties_.size(); ++number) read_messages(number);
    deliver_serial();
    read_kernel_bus();
    exchange_with_adapter();
    exchange_with_outside();
    send_queued();
    write_rows_until(clock_.now() - kRowDelayPeriods * record_period_);
    if (runtime::stop_requested()) outcome = {RunOutcome::Kind::kInterrupted, "interrupted", {}, 0};
    if (const std::string lost = find_lost(); !lost.empty()) {
      outcome = {RunOutcome::Kind::kParticipantLost, lost, {}, 0};
    }
  }
  outcome.at = std::min(clock_.now(), Instant{duration});
  outcome.lost_frames = lost_frames_ + (medium_ ? medium_->lost_frames() : 0) +
                        (kernel_bus_ != nullptr ? kernel_bus_->counters().dropped : 0);
  write_rows_until(outcome.at);
  for (Joined& outsider : outsiders_) stop(outsider);
  return outcome;
}

void WallClockRelay::wait(Nanos until) {
  watched_.clear();
  for (const Party& party : parties_) {
    if (!party.gone) watched_.push_back({party.joined->socket.fd(), POLLIN, 0});
  }
  if (kernel_bus_ != nullptr) watched_.push_back({kernel_bus_->fd(), POLLIN, 0});
  if (gateway_) watched_.push_back({gateway_->fd(), POLLIN, 0});
  if (outside_ != nullptr) outside_->watch(watched_);
  watched_.push_back({broker_.fd(), POLLIN, 0});
  const Nanos span = std::max(until - runtime::read_monotonic(), 0ns);
  const timespec timeout{span / 1s, (span % 1s).count()};
  ::ppoll(watched_.data(), watched_.size(), &timeout, nullptr);
}

void WallClockRelay::read_messages(std::size_t number) {
  Party& party = parties_[number];
  std::span<const std::uint8_t> message;
  while (!party.gone) {
    const link::ReceiveStatus status = party.joined->socket.try_receive(message);
    if (status == link::ReceiveStatus::kClosed) party.gone = true;
    if (status != link::ReceiveStatus::kMessage) return;
    party.heard_of = runtime::read_monotonic();
    if (const auto carried = runtime::read_frame(message)) {
      medium_ ? sent_.push_back({number, *carried}) : carry(number, *carried);
      continue;
    }
    if (take_lateness(party, message)) continue;
    if (const auto piece = runtime::read_serial_piece(message)) {
      lines_.write(clock_.now(), number, piece->line, piece->bytes);
      continue;
    }
    Report report{{}, std::vector<double>(party.signal_count)};
    if (const auto at = runtime::read_report(message, events_, report.values)) {
      report.at = *at;
      if (!party.is_outsider) party.reports.push_back(std::move(report));
      for (const Event& event : events_) observer_->on_event(number, event);
    }
  }
}

bool WallClockRelay::take_lateness(Party& party, std::span<const std::uint8_t> message) {
  if (runtime::message_type(message) != link::MessageType::kTiming) return false;
  LogHistogram read;
  if (runtime::read_timing(message, read)) party.lateness = read;
  return true;
}

std::vector<std::pair<std::string, LogHistogram>> WallClockRelay::collect_lateness() {
  std::vector<std::pair<std::string, LogHistogram>> all;
  for (Party& party : parties_) {
    if (party.is_outsider) continue;
    std::span<const std::uint8_t> message;
    while (party.joined->socket.try_receive(message) == link::ReceiveStatus::kMessage) {
      static_cast<void>(take_lateness(party, message));
    }
    all.emplace_back(party.joined->hello.name, party.lateness);
  }
  return all;
}

void WallClockRelay::deliver_serial() {
  while (lines_.next_delivery() <= clock_.now()) {
    const HeardPiece piece = lines_.take();
    observer_->on_serial(piece.line, piece.sender, piece.at, piece.bytes);
    for (const LineEnd& listener : piece.listeners) {
      const Party& party = parties_[listener.participant];
      if (party.gone) continue;
      const Instant at{clock_.to_monotonic(piece.at)};
      runtime::write_serial_piece(writer_, {at, listener.own_line, piece.bytes});
      if (party.joined->socket.try_send(writer_.bytes()) == link::SendStatus::kFull) ++lost_frames_;
    }
  }
}

void WallClockRelay::read_kernel_bus() {
  if (kernel_bus_ == nullptr || !kernel_bus_->is_up()) return;
  while (const auto received = kernel_bus_->receive())
    carry(kOutsideSender, {received->at_monotonic, 0, received->frame});
}

void WallClockRelay::exchange_with_adapter() {
  if (!gateway_) return;
  from_adapter_.clear();
  events_.clear();
  gateway_->exchange(std::max(clock_.now(), Instant{}), from_adapter_, events_);
  for (const Event& event : events_) observer_->on_event(kOutsideSender, event);
  for (const link::ReceivedFrame& received : from_adapter_) {
    carry(kOutsideSender, {received.at_monotonic, 0, received.frame});
  }
}

void WallClockRelay::exchange_with_outside() {
  if (outside_ == nullptr) return;
  from_outside_.clear();
  outside_->exchange(all_have_room() ? kMaxOutsideFramesAtOnce : 0, from_outside_);
  outside_has_more_ = from_outside_.size() == kMaxOutsideFramesAtOnce;
  if (from_outside_.empty()) return;
  const Nanos now = runtime::read_monotonic();
  if (!std::exchange(outside_has_sent_, true))
    observer_->on_event(kTapSender, make_outside_event(std::max(clock_.now(), Instant{})));
  for (const can::CanFrame& frame : from_outside_) {
    medium_ ? sent_.push_back({kTapSender, {now, 0, frame}}) : carry(kTapSender, {now, 0, frame});
  }
}

/// Linux says that a Unix socket can be written to while less than a quarter of its queue is taken.
bool WallClockRelay::all_have_room() const {
  return std::ranges::all_of(parties_, [](const Party& party) {
    pollfd socket{party.joined->socket.fd(), POLLOUT, 0};
    return party.gone || ::poll(&socket, 1, 0) == 1;
  });
}

/// Does what the intervention has to do by now. Before what has arrived: that was sent before it is read.
void WallClockRelay::intervene() {
  if (intervention_ == nullptr) return;
  for (std::size_t number = 0; number < parties_.size(); ++number) tell(number);
  const Instant now = clock_.now();
  if (now >= Instant{}) intervention_->look(now);
  if (intervention_->next_deadline() > now) return;
  if (medium_) medium_->advance(bus_time_ = std::max(bus_time_, now));
  intervened_at_ = std::max(now, bus_time_);
  intervention_->on_time(intervened_at_, *this);
}

bool WallClockRelay::passes(const can::StampedFrame& frame, std::size_t sender) {
  if (intervention_ == nullptr) return true;
  intervened_at_ = std::max(intervened_at_, frame.at);
  return intervention_->on_frame(frame, sender, *this);
}

void WallClockRelay::deliver(const can::CanFrame& frame, std::size_t sender) {
  last_frame_at_ = std::max(last_frame_at_, intervened_at_);
  distribute(sender, {runtime::read_monotonic(), 0, frame});
}

void WallClockRelay::post_order(std::size_t participant, std::string order) {
  parties_[participant].orders.push_back(std::move(order));
  tell(participant);
}

void WallClockRelay::plug_line(std::size_t participant, std::uint8_t own_line, bool in) {
  lines_.plug(clock_.now(), participant, own_line, in);
  parties_[participant].lines_changed = true;
  tell(participant);
}

/// Orders and plugs, as soon as there is room for them: none may be lost.
void WallClockRelay::tell(std::size_t number) {
  Party& party = parties_[number];
  const auto is_told = [&] { return party.joined->socket.try_send(writer_.bytes()) == link::SendStatus::kSent; };
  if (party.lines_changed) {
    runtime::write_line_states(writer_, lines_.states(number));
    party.lines_changed = !is_told();
  }
  while (!party.gone && !party.orders.empty()) {
    runtime::write_order(writer_, party.orders.front());
    if (!is_told()) return;
    party.orders.pop_front();
  }
}

void WallClockRelay::carry(std::size_t sender, const runtime::CarriedFrame& carried) {
  last_frame_at_ = std::max({last_frame_at_, clock_.to_instant(carried.at_monotonic), Instant{}});
  const bool is_carried_by_kernel = kernel_bus_ != nullptr && sender == kOutsideSender;
  if (passes({last_frame_at_, carried.frame}, sender) || is_carried_by_kernel) distribute(sender, carried);
}

void WallClockRelay::distribute(std::size_t sender, const runtime::CarriedFrame& carried) {
  show({last_frame_at_, carried.frame}, sender);
  if (kernel_bus_ != nullptr && sender == kOutsideSender) return;
  if (gateway_ && sender != kOutsideSender) gateway_->send(carried.frame);
  runtime::write_frame(writer_, carried);
  for (std::size_t number = 0; number < parties_.size(); ++number) {
    if (number == sender || parties_[number].gone) continue;
    if (parties_[number].joined->socket.try_send(writer_.bytes()) == link::SendStatus::kFull) ++lost_frames_;
  }
}

void WallClockRelay::show(const can::StampedFrame& frame, std::size_t sender) {
  const bool is_joined = sender < parties_.size() && parties_[sender].is_outsider;
  observer_->on_frame(frame, is_joined ? kTapSender : sender);
  if (outside_ != nullptr) outside_->show(frame, sender);
}

/// Puts what was sent on the bit-timed bus, in the order of sending, and lets the bus go on to now. A frame that was
/// read too late enters as soon as the bus has come.
void WallClockRelay::send_queued() {
  if (!medium_) return;
  std::ranges::stable_sort(sent_, {}, [](const Sent& sent) { return sent.carried.at_monotonic; });
  for (const auto& [sender, carried] : sent_) {
    const Instant sent_at = clock_.to_instant(carried.at_monotonic);
    if (sent_at > bus_time_) medium_->advance(bus_time_ = sent_at);
    const bool is_member = sender < parties_.size() && !parties_[sender].is_outsider;
    if (is_member) {
      medium_->send(bus_time_, sender, carried.node, carried.frame);
    } else {
      medium_->send_from_outside(bus_time_, carried.frame);
    }
  }
  sent_.clear();
  medium_->advance(bus_time_ = std::max(bus_time_, clock_.now()));
}

void WallClockRelay::give(const can::StampedFrame& frame, std::uint64_t heard_by) {
  runtime::write_frame(writer_, {clock_.to_monotonic(frame.at), 0, frame.frame});
  for (std::size_t number = 0; number < parties_.size(); ++number) {
    const Party& party = parties_[number];
    if (party.gone || (!party.is_outsider && ((heard_by >> number) & 1U) == 0)) continue;
    if (party.joined->socket.try_send(writer_.bytes()) == link::SendStatus::kFull) ++lost_frames_;
  }
}

void WallClockRelay::on_crossed(const can::StampedFrame& frame, std::size_t sender, std::uint64_t heard_by) {
  if (!passes(frame, sender)) return;
  show(frame, sender);
  give(frame, heard_by);
}

void WallClockRelay::on_error_frame(const can::StampedFrame& error, std::size_t participant) {
  show(error, participant);
}

void WallClockRelay::on_node_state(std::size_t participant, const Event& event) {
  observer_->on_event(kOutsideSender, event);
  if (participant < parties_.size()) tell_nodes(participant);
}

void WallClockRelay::tell_nodes(std::size_t number) {
  if (!medium_ || parties_[number].gone) return;
  runtime::write_node_states(writer_, medium_->states(number));
  static_cast<void>(parties_[number].joined->socket.try_send(writer_.bytes()));
}

/// When to look again: at the next thing that a line or the bus has to do, but not for every single bit.
Nanos WallClockRelay::find_next_event(Nanos until) const {
  constexpr Nanos kFewBits = 50us;
  const Instant by_intervention = intervention_ != nullptr ? intervention_->next_deadline() : Instant::never();
  if (by_intervention < Instant::never()) until = std::min(until, clock_.to_monotonic(by_intervention));
  const Instant on_line = lines_.next_delivery();
  if (on_line < Instant::never()) until = std::min(until, clock_.to_monotonic(on_line));
  const Instant on_bus = medium_ ? medium_->next_event() : Instant::never();
  if (on_bus < Instant::never()) {
    until = std::min(until, std::max(clock_.to_monotonic(on_bus), runtime::read_monotonic() + kFewBits));
  }
  return until;
}

void WallClockRelay::write_rows_until(Instant at) {
  for (; next_row_ <= at; next_row_ += record_period_) {
    for (Party& party : parties_) {
      while (!party.reports.empty() && party.reports.front().at <= next_row_) {
        std::ranges::copy(party.reports.front().values,
                          values_.begin() + static_cast<std::ptrdiff_t>(party.first_signal));
        party.reports.pop_front();
      }
    }
    observer_->on_row(next_row_, values_);
    if (intervention_ != nullptr) intervention_->on_row(next_row_, values_);
  }
}

std::string WallClockRelay::find_lost() const {
  for (const Party& party : parties_) {
    if (party.is_outsider) continue;
    const double at_s = to_s(clock_.now());
    if (party.gone) return fmt::format("{} has died at {:.3f} s of the run", party.joined->hello.name, at_s);
    if (runtime::read_monotonic() - party.heard_of > kWatchdog) {
      return fmt::format("{} hangs: nothing heard of it since {:.3f} s of the run", party.joined->hello.name,
                         to_s(clock_.to_instant(party.heard_of)));
    }
  }
  return {};
}

}  // namespace meltbench::bus
