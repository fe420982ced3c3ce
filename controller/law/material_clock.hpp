#pragma once
/// How far the screw has conveyed at any instant, from time-stamped encoder samples.

#include <cstddef>

#include "protocols/time/instant.hpp"
#include "protocols/time/ring.hpp"

namespace meltbench::law {

/// Conveyed length s(t) between, before and a little after encoder samples. Linear in between.
///
/// With samples 10 ms apart and the fluctuation of `slow` A the interpolation is wrong by < 2e-9 m.
/// Real time: no heap after construction; at() finds its place in O(1) for recent times, O(log n) else.
class MaterialClock {
 public:
  /// @param samples  how many are kept. Older times are extrapolated backwards with the oldest speed known.
  /// @param speed_m_per_s  assumed until there are two samples.
  explicit MaterialClock(double speed_m_per_s, std::size_t samples = 4096);

  /// A sample of the encoder: s at the instant `at`.
  /// @returns false and ignores it if it is not newer than the newest, runs backwards or is not a number.
  bool add(Instant at, double s_m);

  /// Conveyed length at `at` [m]; beyond the newest sample with the newest speed, before the oldest with the oldest.
  [[nodiscard]] double at(Instant at) const;
  /// Speed over the newest two samples [m/s]; the assumed one until there are two.
  [[nodiscard]] double speed_m_per_s() const { return speed_; }
  /// Mean speed over the sample interval that holds `at` [m/s].
  [[nodiscard]] double speed_m_per_s(Instant at) const;

  [[nodiscard]] bool empty() const { return samples_.empty(); }
  [[nodiscard]] Instant newest() const { return samples_.empty() ? Instant{} : samples_.back().at; }

 private:
  struct Sample {
    Instant at;
    double s_m = 0.0;
  };
  [[nodiscard]] std::size_t find_after(Instant at) const;

  Ring<Sample> samples_;
  double speed_;
};

}  // namespace meltbench::law
