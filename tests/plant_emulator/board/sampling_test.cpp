#include "plant_emulator/board/sampling.hpp"

#include <catch2/catch.hpp>
#include <cmath>

using namespace meltbench;
using board::calc_noise;
using board::Chance;
using board::SampleClock;

TEST_CASE("Board clock: samples lie on its own grid, from its phase on", "[board][sampling]") {
  const SampleClock clock{300us, 2ms};
  CHECK(clock.last_until(Instant{299us}) == SampleClock::kNone);
  CHECK(clock.last_until(Instant{300us}) == Instant{300us});
  CHECK(clock.last_until(Instant{4299us}) == Instant{2300us});
  CHECK(clock.first_from(Instant{}) == Instant{300us});
  CHECK(clock.first_from(Instant{300us}) == Instant{300us});
  CHECK(clock.first_from(Instant{301us}) == Instant{2300us});
  CHECK(clock.next_after(Instant{2300us}) == Instant{4300us});
  CHECK(clock.number_of(Instant{4300us}) == 2);
}

TEST_CASE("Board clock: with period 0 every instant is a sample", "[board][sampling]") {
  const SampleClock clock{0ns, 0ns};
  CHECK(clock.first_from(Instant{123ns}) == Instant{123ns});
  CHECK(clock.last_until(Instant{123ns}) == Instant{123ns});
}

TEST_CASE("Board chance: the phase comes from the run's seed and the board's name, within one period",
          "[board][sampling]") {
  Chance one{7, "feeder"}, again{7, "feeder"}, other_board{7, "screw_drive"}, other_run{8, "feeder"};
  const Nanos phase = one.draw_phase(100ms);
  CHECK(phase == again.draw_phase(100ms));
  CHECK(phase != other_board.draw_phase(100ms));  // Equal by chance once in 10000 seeds, and these are fixed.
  CHECK(phase != other_run.draw_phase(100ms));
  for (int i = 0; i < 1000; ++i) {
    const Nanos drawn = one.draw_phase(2ms);
    REQUIRE(drawn >= 0ns);
    REQUIRE(drawn < 2ms);
    REQUIRE(drawn % 10us == 0ns);  // Ages on the wire count 10 us at the coarsest.
  }
  CHECK(one.draw_phase(0ns) == 0ns);
}

TEST_CASE("Board noise: mean 0, deviation 1, and a function of the sample's number alone", "[board][sampling]") {
  constexpr int kCount = 20'000;
  double sum = 0, sum_of_squares = 0;
  for (int i = 0; i < kCount; ++i) {
    const double noise = calc_noise(42, i);
    sum += noise;
    sum_of_squares += noise * noise;
  }
  CHECK(std::abs(sum / kCount) < 4.0 / std::sqrt(kCount));                         // 4 sigma of the mean.
  CHECK(std::abs(sum_of_squares / kCount - 1.0) < 4.0 * std::sqrt(2.0 / kCount));  // 4 sigma of the variance.
  CHECK(calc_noise(42, 17) == calc_noise(42, 17));
  CHECK(calc_noise(42, 17) != calc_noise(43, 17));
}
