#pragma once
/// A clock that does not go as the bench's does.

#include "protocols/time/instant.hpp"

namespace meltbench::fault {

/// What a clock shows: from `from` on, local = shown + (bench - from) (1 + drift), in whole nanoseconds.
class ClockSkew {
 public:
  /// Runs faster or slower from now on.
  void set_drift(Instant now, double drift_ppm) {
    shown_ = to_local(now);
    from_ = now;
    drift_ = drift_ppm * 1e-6;
  }
  /// Jumps forward. A monotonic clock never jumps back.
  void step(Instant now, Nanos by) {
    shown_ = to_local(now) + by;
    from_ = now;
  }
  [[nodiscard]] bool is_right() const { return drift_ == 0.0 && shown_ == from_; }

  [[nodiscard]] Instant to_local(Instant bench) const;
  /// The first bench instant at which the clock shows `local` or more.
  [[nodiscard]] Instant to_bench(Instant local) const;

 private:
  Instant from_;
  Instant shown_;
  double drift_ = 0.0;
};

}  // namespace meltbench::fault
