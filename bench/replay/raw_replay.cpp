#include "bench/replay/raw_replay.hpp"

#include <poll.h>
#include <time.h>

#include <algorithm>
#include <optional>
#include <utility>

#include "bench/log/chosen_channel.hpp"
#include "protocols/runtime/real_time_clock.hpp"

namespace meltbench::replay {
namespace {

/// The last part of a wait is spent looking at the clock: a sleeping thread wakes up later than it should.
constexpr Nanos kSpin = 80us;
constexpr Nanos kNap = 100ms;  // So that a stop is heard in a long pause.
constexpr Nanos kRetry = 50us;
constexpr int kMostHeard = 16;        // At once: others may talk without end.
constexpr Nanos kLastAnswer = 100ms;  // Of a slow adapter.

void sleep_until(Nanos monotonic) {
  const timespec until{monotonic / 1s, (monotonic % 1s).count()};
  static_cast<void>(::clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &until, nullptr));
}

bool is_wanted(const can::CanFrame& frame, const RawReplayRequest& request) {
  if (frame.kind == can::FrameKind::kError) return false;
  return request.only.empty() || std::ranges::any_of(request.only, [&](const RawReplayRequest::IdRange& range) {
           return ((frame.id ^ range.id) & range.mask) == 0;
         });
}

void rename(can::CanFrame& frame, const RawReplayRequest& request) {
  for (const RawReplayRequest::Rename& rename : request.renames) {
    if (frame.id != rename.from) continue;
    frame.id = rename.to;
    frame.extended = frame.extended || rename.to > can::kMaxStandardId;
    return;
  }
}

/// Puts frames on the bus, and keeps the account of it.
class Sender {
 public:
  Sender(link::CanLink& bus, const RawReplayRequest& request, const std::function<bool()>& stop)
      : bus_{bus}, request_{request}, stop_{stop}, channel_{request.channel} {}

  /// Plays the log once. @returns false if there is nothing in it to send, or it was stopped.
  bool play(log::LogReader& log) {
    log::LogEntry entry;
    std::optional<Instant> first;
    Instant latest{};
    Nanos start{};
    while (log.next(entry)) {
      if (!channel_.takes(log, entry) || !is_wanted(entry.frame, request_)) {
        ++result_.left_out;
        continue;
      }
      if (!first) {
        first = latest = entry.at;
        start = runtime::read_monotonic();
      }
      latest = std::max(latest, entry.at);
      const Nanos due = runtime::RealTimeClock{start, request_.speed}.to_monotonic(Instant{latest - *first});
      if (!wait_until(due)) return false;
      rename(entry.frame, request_);
      if (send(entry.frame)) result_.lateness.add(runtime::read_monotonic() - due, Instant{latest - *first});
      hear();
    }
    channel_.check_found(log);
    return first.has_value();
  }

  /// After the last frame: hears what an adapter makes of it. @returns the account.
  RawReplayResult finish() {
    const Nanos end = runtime::read_monotonic() + kLastAnswer;
    for (Nanos now{}; (now = runtime::read_monotonic()) < end;) listen(end - now);
    result_.refused = bus_.counters().refused;
    return std::move(result_);
  }

 private:
  /// @returns false if stopped before.
  bool wait_until(Nanos monotonic) {
    for (;;) {
      if (stop_()) return false;
      const Nanos left = monotonic - runtime::read_monotonic();
      if (left <= 0ns) return true;
      if (left > kSpin) listen(std::min(left - kSpin, kNap));
    }
  }
  /// Sleeps for so long, or until the bus has had something for us.
  void listen(Nanos at_most) {
    const timespec span{at_most / 1s, (at_most % 1s).count()};
    pollfd watched{bus_.fd(), POLLIN, 0};
    static_cast<void>(::ppoll(&watched, 1, &span, nullptr));
    hear();
  }

  /// @returns whether it is sent. @throws link::LinkError if the bus is down.
  bool send(const can::CanFrame& frame) {
    link::SendStatus status = bus_.send(frame);
    while (status == link::SendStatus::kFull && !stop_()) {
      ++result_.waits;
      sleep_until(runtime::read_monotonic() + kRetry);
      hear();
      status = bus_.send(frame);
    }
    if (status == link::SendStatus::kDown) {
      throw link::LinkError{"the bus went down in the middle of the replay",
                            "is it up, and plugged in? meltbench doctor"};
    }
    if (status == link::SendStatus::kUnsupported) ++result_.unsupported;
    if (status == link::SendStatus::kSent) ++result_.sent;
    return status == link::SendStatus::kSent;
  }
  /// Takes what the bus has for us, which is nothing to a replay: an adapter that is not listened to stops.
  void hear() {
    int heard = 0;
    while (heard < kMostHeard && bus_.receive()) ++heard;
  }

  link::CanLink& bus_;
  const RawReplayRequest& request_;
  const std::function<bool()>& stop_;
  log::ChosenChannel channel_;
  RawReplayResult result_;
};

}  // namespace

RawReplayResult replay_raw(const std::function<std::unique_ptr<log::LogReader>()>& open, link::CanLink& bus,
                           const RawReplayRequest& request, const std::function<bool()>& stop) {
  Sender sender{bus, request, stop};
  for (std::uint64_t loop = 0; request.loops == 0 || loop < request.loops; ++loop) {
    if (!sender.play(*open())) break;
  }
  return sender.finish();
}

}  // namespace meltbench::replay
