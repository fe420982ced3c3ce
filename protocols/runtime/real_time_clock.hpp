#pragma once

#include "protocols/link/clock.hpp"
#include "protocols/time/instant.hpp"

namespace meltbench::runtime {

using link::read_monotonic;

/// Bench axis against CLOCK_MONOTONIC: Instant{0} is at `start`, and the bench runs `speed` times as fast.
class RealTimeClock {
 public:
  RealTimeClock(Nanos start, double speed) : start_{start}, speed_{speed} {}

  [[nodiscard]] Instant now() const noexcept { return to_instant(read_monotonic()); }
  [[nodiscard]] Instant to_instant(Nanos monotonic) const noexcept {
    return Instant{speed_ == 1.0 ? monotonic - start_ : scale(monotonic - start_, speed_)};
  }
  /// @pre at < Instant::never().
  [[nodiscard]] Nanos to_monotonic(Instant at) const noexcept {
    return start_ + (speed_ == 1.0 ? at.since_start : scale(at.since_start, 1.0 / speed_));
  }

 private:
  static Nanos scale(Nanos span, double factor) noexcept {
    return Nanos{static_cast<std::int64_t>(static_cast<double>(span.count()) * factor)};
  }
  Nanos start_;
  double speed_;
};

}  // namespace meltbench::runtime
