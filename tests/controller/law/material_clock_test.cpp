#include "controller/law/material_clock.hpp"

#include <catch2/catch.hpp>
#include <cmath>
#include <limits>

using namespace meltbench;
using law::MaterialClock;

TEST_CASE("Material clock: between samples it is off by less than 2e-9 m with the bench's fluctuation", "[law]") {
  const auto conveyed = [](double t) { return 0.015 * (t + 1.5 * std::sin(t * 4.0 / 60.0)); };
  MaterialClock clock{0.015};
  for (int k = 0; k <= 1000; ++k) clock.add(Instant{k * 10ms}, conveyed(0.01 * k));
  double worst = 0.0;
  for (int k = 0; k < 9999; ++k) {
    worst = std::max(worst, std::abs(clock.at(Instant{k * 1ms}) - conveyed(1e-3 * k)));
  }
  CHECK(worst < 2e-9);  // theta1 eps omega T^2/8 = 1.25e-9 m.
  CHECK(clock.at(Instant{10002ms}) == Approx(conveyed(10.002)).margin(2e-9).epsilon(0));
  CHECK(clock.speed_m_per_s(Instant{5s}) == Approx(0.015 * (1 + 0.1 * std::cos(5 * 4.0 / 60.0))).epsilon(1e-4));
}

TEST_CASE("Material clock: before and after its samples it goes on at the nearest known speed", "[law]") {
  MaterialClock clock{0.02};
  CHECK(clock.at(Instant{1s}) == Approx(0.02));
  clock.add(Instant{1s}, 5.0);
  CHECK(clock.at(Instant{2s}) == Approx(5.02));
  CHECK(clock.at(Instant{0s}) == Approx(4.98));
  clock.add(Instant{2s}, 5.5);
  clock.add(Instant{3s}, 7.5);
  CHECK(clock.at(Instant{4s}) == Approx(9.5));
  CHECK(clock.at(Instant{0s}) == Approx(4.5));
  CHECK(clock.at(Instant{1500ms}) == Approx(5.25));
  CHECK(clock.at(Instant{2s}) == 5.5);
  CHECK(clock.speed_m_per_s() == Approx(2.0));
  CHECK(clock.speed_m_per_s(Instant{1200ms}) == Approx(0.5));
}

TEST_CASE("Material clock: old, backward and broken samples are ignored", "[law]") {
  MaterialClock clock{0.01};
  CHECK(clock.add(Instant{1s}, 1.0));
  CHECK_FALSE(clock.add(Instant{1s}, 1.5));
  CHECK_FALSE(clock.add(Instant{500ms}, 1.5));
  CHECK_FALSE(clock.add(Instant{2s}, 0.5));
  CHECK_FALSE(clock.add(Instant{2s}, std::numeric_limits<double>::quiet_NaN()));
  CHECK(clock.newest() == Instant{1s});
  CHECK(clock.at(Instant{1s}) == 1.0);
}

TEST_CASE("Material clock: a bounded memory keeps the newest samples, and far jumps are found", "[law]") {
  MaterialClock clock{0.01, 64};
  for (int k = 0; k < 1000; ++k) clock.add(Instant{k * 10ms}, 0.001 * k * k);
  const auto exact = [](int k) { return 0.001 * k * k; };
  for (const int k : {999, 998, 940, 975, 950, 996})
    CHECK(clock.at(Instant{k * 10ms}) == Approx(exact(k)).epsilon(1e-14));
  CHECK(clock.at(Instant{1s}) == Approx(exact(936) + (exact(937) - exact(936)) * (100 - 936)));  // Long forgotten.
}
