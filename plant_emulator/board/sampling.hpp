#pragma once
/// The clock and the chance of a board: sample instants with a phase of their own, and noise, both from the run's seed.

#include <cstdint>
#include <random>
#include <string_view>

#include "protocols/time/instant.hpp"

namespace meltbench::board {

/// Chance of one board. Own uniform draw, because the distributions of the standard library differ between libraries;
/// equal (seed, name) give equal numbers everywhere.
class Chance {
 public:
  /// @param name  of the board, so that boards of one run differ.
  Chance(std::uint64_t seed, std::string_view name);

  /// In [0, 1), 53 bits.
  [[nodiscard]] double draw_uniform();

  /// A whole multiple of 10 us, the coarsest step of ages on the wire, in [0, period). A period up to 10 us gives 0.
  [[nodiscard]] Nanos draw_phase(Nanos period);

  /// A seed for Noise.
  [[nodiscard]] std::uint64_t draw_bits() { return engine_(); }

 private:
  std::mt19937_64 engine_;
};

/// Noise with mean 0 and standard deviation 1 as a function of the sample's number: a sample that nobody looks at need
/// not be computed, and does not shift the others. Sum of 12 uniform numbers: normal to 3 sigma, never beyond 6.
[[nodiscard]] double calc_noise(std::uint64_t seed, std::int64_t sample_number);

/// In [0, 1), a function of the number alone as well.
[[nodiscard]] double draw_at(std::uint64_t seed, std::int64_t number);

/// The instants phase + k * period, k = 0, 1, ...; with period 0 every instant.
class SampleClock {
 public:
  SampleClock(Nanos phase, Nanos period) : phase_{phase}, period_{period} {}

  /// First one at or after `at`.
  [[nodiscard]] Instant first_from(Instant at) const;
  /// First one after `at`; with period 0 the next nanosecond.
  [[nodiscard]] Instant next_after(Instant at) const { return first_from(at + 1ns); }
  /// Last one at or before `at`; before the first one: one nanosecond before the start of the run.
  [[nodiscard]] Instant last_until(Instant at) const;
  /// k of an instant of this clock.
  [[nodiscard]] std::int64_t number_of(Instant sample) const;

  /// What last_until() says when there was none yet.
  static constexpr Instant kNone{Nanos{-1}};

  [[nodiscard]] Nanos period() const { return period_; }

 private:
  Nanos phase_;
  Nanos period_;
};

}  // namespace meltbench::board
