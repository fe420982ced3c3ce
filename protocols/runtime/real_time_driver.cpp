#include "protocols/runtime/real_time_driver.hpp"

#include <poll.h>
#include <spdlog/spdlog.h>

#include <algorithm>
#include <array>

#include "protocols/runtime/stop_signal.hpp"

namespace meltbench::runtime {
namespace {

constexpr Nanos kRetryPeriod = 200us;  // One frame of 8 bytes takes 220 us at 500 kbit/s.
constexpr Nanos kLinkCheckPeriod = 100ms;
constexpr std::size_t kMaxWaiting = 1024;  // Frames; more is a bus that does not move: they are lost, and counted.

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
          {name + ".worst_lateness_s", SignalKind::kValue}};
}

RealTimeDriver::RealTimeDriver(Participant& participant, link::CanLink& can, BenchClient* bench,
                               const link::Welcome& timing)
    : participant_{participant},
      can_{can},
      bench_{bench},
      clock_{timing.start_monotonic, timing.speed},
      record_period_{timing.record_period},
      signals_(participant.signals().size() + real_time_signals(participant.name()).size()) {
  arrived_.reserve(256);
  out_.wake_at(Instant{});
}

bool RealTimeDriver::finished() const {
  return stop_requested() || (bench_ != nullptr && (bench_->stopped() || bench_->lost()));
}

DriverEnd RealTimeDriver::run() {
  while (!finished()) {
    wait_for_work();
    const Instant deadline = out_.deadline();
    now_ = std::max(now_, clock_.now());
    note_link(can_.is_up());
    collect_frames();
    const bool due = now_ >= deadline;
    if (due) {
      const Nanos lateness = now_ - deadline;
      worst_lateness_ = std::max(worst_lateness_, lateness);
      if (lateness > record_period_) ++deadline_misses_;
    }
    if (due || (!arrived_.empty() && out_.wake_on() == WakeOn::kArrivalOrDeadline)) wake();
    send_waiting();
    if (now_ >= next_record_) report();
  }
  report();
  return bench_ != nullptr && bench_->lost() ? DriverEnd::kBenchLost : DriverEnd::kStopped;
}

void RealTimeDriver::wait_for_work() {
  const Nanos now = read_monotonic();
  Nanos until = now + 1s;
  const Instant due = std::min(out_.deadline(), next_record_);
  until = std::min(until, clock_.to_monotonic(due));
  if (!waiting_.empty()) until = std::min(until, now + kRetryPeriod);
  if (!link_up_) until = std::min(until, next_link_check_);
  if (until <= now) return;

  std::array<pollfd, 2> watched{};
  nfds_t count = 0;
  if (link_up_ && out_.wake_on() == WakeOn::kArrivalOrDeadline) watched[count++] = {can_.fd(), POLLIN, 0};
  if (bench_ != nullptr && bench_->fd() != can_.fd()) watched[count++] = {bench_->fd(), POLLIN, 0};
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

void RealTimeDriver::collect_frames() {
  while (const auto received = can_.receive()) {
    // A stamp is never later than now on the participant's axis, whatever the two clocks' readings.
    arrived_.push_back({std::min(clock_.to_instant(received->at_monotonic), now_), received->frame});
  }
  if (bench_ != nullptr && static_cast<const link::CanLink*>(bench_) != &can_) bench_->poll_stop();
}

void RealTimeDriver::wake() {
  out_.clear();
  participant_.wake({now_, arrived_, link_up_ ? LinkState::kUp : LinkState::kDown}, out_);
  arrived_.clear();
  for (const can::CanFrame& frame : out_.frames()) {
    if (!link_up_ || waiting_.size() >= kMaxWaiting)
      ++frames_lost_;
    else
      waiting_.push_back(frame);
  }
  for (const Event& event : out_.events()) events_.push_back(event);
}

void RealTimeDriver::send_waiting() {
  while (!waiting_.empty()) {
    const link::SendStatus status = can_.send(waiting_.front());
    if (status == link::SendStatus::kFull || status == link::SendStatus::kDown) return;
    if (status == link::SendStatus::kUnsupported) ++frames_lost_;
    waiting_.pop_front();
  }
}

void RealTimeDriver::log_events() {
  for (const Event& event : events_) {
    spdlog::log(to_level(event.severity), "{:.3f} s  {}: {} [{}]", to_s(event.at), participant_.name(), event.text,
                event.code);
  }
  events_.clear();
}

void RealTimeDriver::report() {
  const std::int64_t periods = now_.since_start / record_period_;
  next_record_ = Instant{(periods + 1) * record_period_};
  if (bench_ == nullptr) {
    log_events();
    return;
  }
  participant_.read_signals(std::span{signals_}.first(participant_.signals().size()));
  const auto own = std::span{signals_}.last(3);
  own[0] = static_cast<double>(deadline_misses_);
  own[1] = static_cast<double>(frames_lost_ + can_.counters().dropped);
  own[2] = to_s(worst_lateness_);
  bench_->report(Instant{periods * record_period_}, events_, signals_);
  events_.clear();
}

}  // namespace meltbench::runtime
