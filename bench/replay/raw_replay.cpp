#include "bench/replay/raw_replay.hpp"

#include <time.h>

#include <algorithm>

#include "protocols/runtime/real_time_clock.hpp"

namespace meltbench::replay {
namespace {

/// The last part of a wait is spent looking at the clock: a sleeping thread wakes up later than it should.
constexpr Nanos kSpin = 80us;
constexpr Nanos kNap = 100ms;  // So that a stop is heard in a long pause.
constexpr Nanos kRetry = 50us;

void sleep_until(Nanos monotonic) {
  const timespec until{monotonic / 1s, (monotonic % 1s).count()};
  static_cast<void>(::clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &until, nullptr));
}

/// @returns false if stopped before.
bool wait_until(Nanos monotonic, const std::function<bool()>& stop) {
  for (;;) {
    if (stop()) return false;
    const Nanos now = runtime::read_monotonic();
    if (now >= monotonic) return true;
    if (monotonic - now > kSpin) sleep_until(std::min(monotonic - kSpin, now + kNap));
  }
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

}  // namespace

RawReplayResult replay_raw(const std::function<std::unique_ptr<log::LogReader>()>& open, link::CanLink& bus,
                           const RawReplayRequest& request, const std::function<bool()>& stop) {
  RawReplayResult result;
  std::string channel = request.channel;
  for (std::uint64_t loop = 0; request.loops == 0 || loop < request.loops; ++loop) {
    const auto log = open();
    log::LogEntry entry;
    bool begun = false;
    Instant first{};
    Instant latest{};
    Nanos start{};
    while (log->next(entry)) {
      const std::string& name = log->channels()[entry.channel];
      if (channel.empty()) channel = name;
      if (name != channel || !is_wanted(entry.frame, request)) {
        ++result.left_out;
        continue;
      }
      if (!begun) {
        begun = true;
        first = latest = entry.at;
        start = runtime::read_monotonic();
      }
      latest = std::max(latest, entry.at);
      const Nanos due = runtime::RealTimeClock{start, request.speed}.to_monotonic(Instant{latest - first});
      if (!wait_until(due, stop)) return result;
      rename(entry.frame, request);
      link::SendStatus status = bus.send(entry.frame);
      while (status == link::SendStatus::kFull && !stop()) {
        ++result.waits;
        sleep_until(runtime::read_monotonic() + kRetry);
        status = bus.send(entry.frame);
      }
      if (status == link::SendStatus::kDown) {
        throw link::LinkError{"the bus went down in the middle of the replay", "is the interface up? ip link"};
      }
      if (status == link::SendStatus::kUnsupported) {
        ++result.unsupported;
        continue;
      }
      ++result.sent;
      result.lateness.add(runtime::read_monotonic() - due, Instant{latest - first});
    }
    if (!begun) break;
  }
  return result;
}

}  // namespace meltbench::replay
