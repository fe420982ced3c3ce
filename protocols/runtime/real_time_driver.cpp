#include "protocols/runtime/real_time_driver.hpp"

#include <poll.h>
#include <spdlog/spdlog.h>
#include <sys/prctl.h>

#include <algorithm>
#include <array>
#include <utility>

#include "protocols/runtime/stop_signal.hpp"

namespace meltbench::runtime {
namespace {

constexpr Nanos kRetryPeriod = 200us;  // One frame of 8 bytes takes 220 us at 500 kbit/s.
constexpr Nanos kLinkCheckPeriod = 100ms;
constexpr Nanos kTimingPeriod = 1s;
constexpr std::size_t kUsualBurst = 1024;  // Frames in one wake-up, after some 100 ms without one on a full bus.
constexpr std::size_t kMaxLines = 16;  // Serial lines that arrivals wake for; those of a further one wait for a timer.

spdlog::level::level_enum to_level(Severity severity) {
  switch (severity) {
    case Severity::kInfo:
      return spdlog::level::info;
    case Severity::kWarning:
      return spdlog::level::warn;
    case Severity::kFault:
      break;
  }
  return spdlog::level::err;
}

timespec to_timespec(Nanos span) {
  return timespec{span / 1s, (span % 1s).count()};
}

}  // namespace

std::vector<SignalInfo> real_time_signals(std::string_view participant_name) {
  const std::string name{participant_name};
  return {{name + ".deadline_misses", SignalKind::kErrorCounter},
          {name + ".frames_lost", SignalKind::kErrorCounter},
          {name + ".worst_lateness_s", SignalKind::kValue},
          {name + ".queue_full", SignalKind::kValue}};
}

RealTimeDriver::RealTimeDriver(Participant& participant, link::CanLink& can, BenchClient* bench,
                               const link::Welcome& timing, SerialPorts serial)
    : participant_{participant},
      can_{can},
      bench_{bench},
      serial_{std::move(serial)},
      clock_{timing.start_monotonic, timing.speed},
      record_period_{timing.record_period},
      signals_(participant.signals().size() + real_time_signals(participant.name()).size()) {
  arrived_.reserve(kUsualBurst);
  out_.frame_queue().reserve(kUsualBurst);
  events_.reserve(64);
  out_.wake_at(Instant{});
}

bool RealTimeDriver::finished() const {
  return now_ >= until_ || stop_requested() || (bench_ != nullptr && (bench_->stopped() || bench_->lost()));
}

DriverEnd RealTimeDriver::run(Instant until) {
  until_ = until;
  ::prctl(PR_SET_TIMERSLACK, 1);  // Else the kernel may be 50 us late on purpose, to wake several threads at once.
  while (!finished()) {
    wait_for_work();
    const Instant deadline = out_.deadline();
    now_ = std::max(now_, clock_.now());
    note_link(can_.is_up());
    collect_arrivals();
    const bool due = now_ >= deadline;
    if (due) note_lateness(deadline);
    // A row shows its own instant, not that of the latest wake-up, which may be a whole cycle ago.
    const bool recorded = bench_ != nullptr && now_ >= next_record_;
    if (due || recorded || (has_arrivals() && out_.wake_on() == WakeOn::kArrivalOrDeadline)) wake();
    send_waiting();
    if (now_ >= next_record_) report();
  }
  report();
  if (bench_ != nullptr) bench_->report_timing(lateness_);
  if (bench_ == nullptr) {
    log_lateness();
    return DriverEnd::kStopped;
  }
  bench_->poll_stop();  // A bench that closes behind its Stop makes a sending fail before the Stop is read.
  return bench_->stopped() || stop_requested() ? DriverEnd::kStopped : DriverEnd::kBenchLost;
}

void RealTimeDriver::note_lateness(Instant deadline) {
  // The first is at Instant{0} by rule, however long ago that was for who joins a running bench.
  if (!std::exchange(was_woken_, true)) return;
  const Nanos lateness = now_ - deadline;
  lateness_.add(lateness, now_);
  if (lateness > record_period_) ++deadline_misses_;
}

void RealTimeDriver::wait_for_work() {
  const Nanos now = read_monotonic();
  Nanos until = now + 1s;
  const Instant due = std::min({out_.deadline(), next_record_, until_});
  until = std::min(until, clock_.to_monotonic(due));
  if (!waiting_.empty()) until = std::min(until, now + kRetryPeriod);
  if (!link_up_) until = std::min(until, next_link_check_);
  until = std::min(until, serial_.next_look());
  if (until <= now) return;

  std::array<pollfd, 2 + kMaxLines> watched{};
  nfds_t count = 0;
  if (out_.wake_on() == WakeOn::kArrivalOrDeadline) {
    if (link_up_) watched[count++] = {can_.fd(), POLLIN, 0};
    count += serial_.watch(std::span{watched}.subspan(count, kMaxLines));
  }
  if (bench_ != nullptr && bench_->fd() != can_.fd()) watched[count++] = {bench_->fd(), POLLIN, 0};
  // No timer at the absolute time: the kernel wakes a sleeper sooner than the reader of a timer (p99 on the development
  // machine 58 us against 98), and the span begins with the clock read above. A stop signal that comes before the sleep
  // is noticed at its end, within a second.
  const timespec span = to_timespec(until - now);
  ::ppoll(watched.data(), count, &span, nullptr);
}

void RealTimeDriver::note_link(bool up) {
  if (up == link_up_) {
    if (!up) next_link_check_ = read_monotonic() + kLinkCheckPeriod;
    return;
  }
  link_up_ = up;
  if (!up) {
    next_link_check_ = read_monotonic() + kLinkCheckPeriod;
    frames_lost_ += waiting_.size();
    waiting_.clear();
  }
  events_.push_back({now_, up ? Severity::kInfo : Severity::kWarning, up ? "link-up" : "link-down",
                     up ? "the CAN link is up again" : "the CAN link went down"});
  out_.wake_at(now_);  // Both edges are told at once.
}

void RealTimeDriver::collect_arrivals() {
  while (const auto received = can_.receive()) {
    // A stamp is never later than now on the participant's axis, whatever the two clocks' readings.
    arrived_.push_back({std::min(clock_.to_instant(received->at_monotonic), now_), received->frame});
  }
  if (bench_ != nullptr && static_cast<const link::CanLink*>(bench_) != &can_) bench_->poll_stop();
  if (bench_ != nullptr) note_bench();
  if (serial_.collect(clock_, now_, events_)) out_.wake_at(now_);
}

/// What the bench has told beside frames: whoever is concerned is woken for it at once.
void RealTimeDriver::note_bench() {
  if (bench_->take_node_change() || !bench_->orders().empty()) out_.wake_at(now_);
  if (!bench_->take_line_change()) return;
  serial_.plug(bench_->line_states());
  out_.wake_at(now_);
}

void RealTimeDriver::wake() {
  out_.clear();
  participant_.wake({.now = now_,
                     .frames = arrived_,
                     .link = link_up_ ? LinkState::kUp : LinkState::kDown,
                     .serial = serial_.inbox().arrivals(),
                     .lines = serial_.states(),
                     .nodes = bench_ != nullptr ? bench_->node_states() : std::span<const can::ErrorState>{},
                     .orders = bench_ != nullptr ? bench_->orders() : std::span<const std::string>{}},
                    out_);
  if (bench_ != nullptr) bench_->clear_orders();
  arrived_.clear();
  serial_.inbox().clear();
  serial_.write(out_);
  queue_frames();
  for (const Event& event : out_.events()) events_.push_back(event);
}

void RealTimeDriver::queue_frames() {
  auto mark = out_.senders().begin();
  std::uint8_t node = 0;
  for (std::size_t i = 0; i < out_.frames().size(); ++i) {
    for (; mark != out_.senders().end() && mark->first <= i; ++mark) node = mark->node;
    if (!link_up_ || waiting_.full())
      ++frames_lost_;
    else
      waiting_.push(out_.frames()[i], node);
  }
}

void RealTimeDriver::send_waiting() {
  while (!waiting_.empty()) {
    const link::SendStatus status = can_.send_as(waiting_.front_node(), waiting_.front());
    if (status == link::SendStatus::kFull || status == link::SendStatus::kDown) return;
    if (status == link::SendStatus::kUnsupported) ++frames_lost_;
    waiting_.pop();
  }
}

void RealTimeDriver::log_events() {
  for (const Event& event : events_) {
    spdlog::log(to_level(event.severity), "{:.3f} s  {}: {} [{}]", to_s(event.at), participant_.name(), event.text,
                event.code);
  }
  events_.clear();
}

void RealTimeDriver::log_lateness() const {
  const auto us = [](Nanos span) { return to_s(span) * 1e6; };
  spdlog::info(
      "{}: {} wake-ups, late by {:.0f} us (p50), {:.0f} us (p99), {:.0f} us (p99.9), at most {:.0f} us at {:.3f} s, "
      "{} of them missed their deadline",
      participant_.name(), lateness_.count(), us(lateness_.quantile(0.5)), us(lateness_.quantile(0.99)),
      us(lateness_.quantile(0.999)), us(lateness_.max()), to_s(lateness_.max_at()), deadline_misses_);
}

void RealTimeDriver::report() {
  const std::int64_t periods = now_.since_start / record_period_;
  next_record_ = Instant{(periods + 1) * record_period_};
  if (bench_ == nullptr) {
    log_events();
    return;
  }
  participant_.read_signals(std::span{signals_}.first(participant_.signals().size()));
  const auto own = std::span{signals_}.last(4);
  own[0] = static_cast<double>(deadline_misses_);
  own[1] = static_cast<double>(frames_lost_ + can_.counters().dropped + can_.counters().refused);
  own[2] = to_s(lateness_.max());
  own[3] = static_cast<double>(can_.counters().full);
  bench_->report(Instant{periods * record_period_}, events_, signals_);
  events_.clear();
  if (now_ < next_timing_) return;
  next_timing_ = now_ + kTimingPeriod;
  bench_->report_timing(lateness_);
}

}  // namespace meltbench::runtime
