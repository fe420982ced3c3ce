#pragma once
/// The bench's time axis: whole nanoseconds since the start of the run. Nothing here reads a clock.

#include <chrono>
#include <compare>
#include <cstdint>
#include <limits>

namespace meltbench {

using Nanos = std::chrono::nanoseconds;
using std::chrono_literals::operator""ns;
using std::chrono_literals::operator""us;
using std::chrono_literals::operator""ms;
using std::chrono_literals::operator""s;

/// A point on the bench axis; epoch = start of the run. It has no now(): nobody reads the time by accident.
/// Instant + Nanos -> Instant, Instant - Instant -> Nanos; nothing else converts.
struct Instant {
  Nanos since_start{};

  constexpr auto operator<=>(const Instant&) const = default;

  /// Later than every instant of a run: the deadline of who waits only for arrivals.
  [[nodiscard]] static constexpr Instant never() { return Instant{Nanos{std::numeric_limits<std::int64_t>::max()}}; }

  constexpr Instant& operator+=(Nanos span) {
    since_start += span;
    return *this;
  }
};

[[nodiscard]] constexpr Instant operator+(Instant at, Nanos span) {
  return Instant{at.since_start + span};
}
[[nodiscard]] constexpr Instant operator-(Instant at, Nanos span) {
  return Instant{at.since_start - span};
}
[[nodiscard]] constexpr Nanos operator-(Instant later, Instant earlier) {
  return later.since_start - earlier.since_start;
}

/// Seconds as a double, for formulas and for print. The way back gives the same Instant below 2^22 s = 48 days.
[[nodiscard]] constexpr double to_s(Nanos span) {
  return std::chrono::duration<double>(span).count();
}
[[nodiscard]] constexpr double to_s(Instant at) {
  return to_s(at.since_start);
}

/// Nearest whole nanosecond. @pre |seconds| < 9.2e9 (292 years), finite.
[[nodiscard]] constexpr Nanos nanos_from_s(double seconds) {
  const double nanoseconds = seconds * 1e9;
  return Nanos{static_cast<std::int64_t>(nanoseconds < 0 ? nanoseconds - 0.5 : nanoseconds + 0.5)};
}

}  // namespace meltbench
