#include "plant_emulator/model/screw_clock.hpp"

#include <catch2/catch.hpp>

using meltbench::plant::ScrewClock;

TEST_CASE("Screw clock: conveyed length is the integral of the speed", "[model]") {
  const ScrewClock clock{0.9, 0.4, 0.8, 0.3};
  // Simpson's rule with h = 1 ms: error h^4 omega^4 / 2880, far below the rounding of 1e-13.
  double s = 0.0;
  for (int i = 0; i < 7000; ++i) {
    const double t = i * 1e-3;
    s += 1e-3 * (clock.speed_m_per_s(t) + 4 * clock.speed_m_per_s(t + 5e-4) + clock.speed_m_per_s(t + 1e-3)) / 6.0;
  }
  CHECK(clock.conveyed_m(0.0) == 0.0);
  CHECK(clock.conveyed_m(7.0) == Approx(s).margin(1e-12).epsilon(0));
  CHECK(clock.nominal_conveyed_m(7.0) == Approx(6.3));
}

TEST_CASE("Screw clock: acceleration is the derivative of the speed", "[model]") {
  const ScrewClock clock{0.015, 0.4, 0.8, 0.0};
  const double t = 2.3, h = 1e-4;
  const double difference = (clock.speed_m_per_s(t + h) - clock.speed_m_per_s(t - h)) / (2.0 * h);
  CHECK(clock.acceleration_m_per_s2(t) == Approx(difference).epsilon(1e-6));  // Central difference, h^2 = 1e-8.
}

TEST_CASE("Screw clock: a change of speed keeps the conveyed length continuous and the phase running", "[model]") {
  ScrewClock clock{0.015, 0.1, 4.0, 0.0};
  const ScrewClock untouched = clock;
  const double s = clock.conveyed_m(3.0);
  clock.set_speed(3.0, 0.03);
  CHECK(clock.conveyed_m(3.0) == Approx(s).margin(1e-16));
  CHECK(clock.speed_m_per_s(4.0) == Approx(2.0 * untouched.speed_m_per_s(4.0)));
  CHECK(clock.conveyed_m(4.0) - s == Approx(2.0 * (untouched.conveyed_m(4.0) - s)));
  CHECK(clock.nominal_conveyed_m(4.0) == Approx(0.015 * 3.0 + 0.03));
  clock.set_speed(5.0, 0.0);
  CHECK(clock.conveyed_m(9.0) == clock.conveyed_m(5.0));
}

TEST_CASE("Screw clock: the inverse finds the time back, from a far guess and without fluctuation too", "[model]") {
  const ScrewClock wild{0.9, 0.4, 0.8, 0.0}, even{0.9, 0.0, 0.0, 0.0};
  for (double t = -20.0; t < 60.0; t += 0.37) {
    CHECK(wild.calc_time_s(wild.stretched_time_s(t), t + 0.5) == Approx(t).margin(1e-12));
    CHECK(even.calc_time_s(even.stretched_time_s(t), 0.0) == Approx(t).margin(1e-12));
  }
}
