#include "controller/safety/zone_watch.hpp"

#include <catch2/catch.hpp>

using namespace meltbench;
using namespace meltbench::safety;
using Catch::Matchers::Contains;

namespace {

constexpr double kSet_degC = 145.0;

/// Reports every 100 ms for a while; the temperature moves evenly. @returns the first trip.
ZoneTrip run(ZoneWatch& watch, double from_degC, double rate_K_per_s, double output, double duration_s,
             std::optional<double> set_point_degC = kSet_degC, Instant from = {}) {
  for (Nanos t{}; t <= nanos_from_s(duration_s); t += 100ms) {
    const ZoneReport report{.T_degC = from_degC + rate_K_per_s * to_s(t), .output = output};
    const ZoneTrip trip = watch.add(from + t, report, set_point_degC);
    if (trip != ZoneTrip::kNone) return trip;
  }
  return ZoneTrip::kNone;
}

}  // namespace

TEST_CASE("Zone watch: a zone that heats up as it should is left alone", "[safety]") {
  ZoneWatch watch{{}};
  CHECK(run(watch, 20.0, 0.5, 1.0, 240.0) == ZoneTrip::kNone);
}

TEST_CASE("Zone watch: full power without heat trips after one window, not before", "[safety]") {
  ZoneWatch watch{{}};
  CHECK(run(watch, 20.0, 0.01, 1.0, 59.9) == ZoneTrip::kNone);
  ZoneWatch again{{}};
  CHECK(run(again, 20.0, 0.01, 1.0, 60.0) == ZoneTrip::kNotRising);
  CHECK(again.rise_K() == Approx(0.6));
  CHECK_THAT(describe(ZoneTrip::kNotRising, again, "zone 2", {}), Contains("zone 2") && Contains("+0.6 K in 60 s"));
}

TEST_CASE("Zone watch: power that is not full is not judged: a zone at its set point is held, not heated", "[safety]") {
  ZoneWatch watch{{}};
  CHECK(run(watch, kSet_degC, 0.0, 0.5, 600.0) == ZoneTrip::kNone);
}

TEST_CASE("Zone watch: a heater that comes and goes starts its window anew", "[safety]") {
  ZoneWatch watch{{}};
  for (int i = 0; i < 10; ++i) {
    const Instant from{100s * i};
    CHECK(run(watch, 100.0, 0.0, 1.0, 50.0, kSet_degC, from) == ZoneTrip::kNone);
    CHECK(run(watch, 100.0, 0.0, 0.5, 40.0, kSet_degC, from + 55s) == ZoneTrip::kNone);
  }
}

TEST_CASE("Zone watch: heat without power trips above the set point, a neighbour's heat below it does not",
          "[safety]") {
  ZoneWatch below{{}};
  CHECK(run(below, 100.0, 0.1, 0.0, 120.0) == ZoneTrip::kNone);
  ZoneWatch above{{}};
  CHECK(run(above, kSet_degC, 0.1, 0.0, 60.0) == ZoneTrip::kRisingUnasked);
}

TEST_CASE("Zone watch: with all zones off any rise is unasked", "[safety]") {
  ZoneWatch watch{{}};
  CHECK(run(watch, 60.0, 0.1, 0.0, 60.0, std::nullopt) == ZoneTrip::kRisingUnasked);
  ZoneWatch cooling{{}};
  CHECK(run(cooling, 140.0, -0.1, 0.0, 600.0, std::nullopt) == ZoneTrip::kNone);
}

TEST_CASE("Zone watch: an open thermocouple, too hot, or no number trip at once", "[safety]") {
  ZoneWatch watch{{.max_degC = 185.0}};
  CHECK(watch.add({}, {.T_degC = 20.0, .sensor_good = false}, kSet_degC) == ZoneTrip::kSensorOpen);
  CHECK(watch.add({}, {.T_degC = 185.1}, kSet_degC) == ZoneTrip::kOverTemperature);
  CHECK(watch.add({}, {.T_degC = 185.0}, kSet_degC) == ZoneTrip::kNone);
  const double none = std::numeric_limits<double>::quiet_NaN();
  CHECK(watch.add({}, {.T_degC = none}, kSet_degC) == ZoneTrip::kOverTemperature);
}

TEST_CASE("Zone watch: every trip has a code and a text of its own", "[safety]") {
  const ZoneWatch watch{{}};
  CHECK(code_of(ZoneTrip::kSensorOpen) == "zone-sensor-open");
  CHECK(code_of(ZoneTrip::kOverTemperature) == "zone-over-temperature");
  CHECK(code_of(ZoneTrip::kNotRising) == "zone-not-rising");
  CHECK(code_of(ZoneTrip::kRisingUnasked) == "zone-rising-unasked");
  CHECK_THAT(describe(ZoneTrip::kSensorOpen, watch, "nozzle", {}), Contains("nozzle") && Contains("thermocouple"));
  CHECK_THAT(describe(ZoneTrip::kOverTemperature, watch, "zone 1", {.T_degC = 310.0}), Contains("310.0 C"));
  CHECK_THAT(describe(ZoneTrip::kRisingUnasked, watch, "zone 1", {}), Contains("relay"));
}

TEST_CASE("Zone watch: a reading that stands still is healthy as long as the power does", "[safety]") {
  ZoneWatch watch{{}};
  for (int i = 0; i < 36'000; ++i) {  // An hour; the output goes up and down as in production, and drifts by 2e-5 / s.
    const double output = 0.3 + 0.01 * (i % 20 < 10 ? 1 : -1) + 2e-5 * 0.1 * i;
    REQUIRE(watch.add(Instant{i * 100ms}, {.T_degC = kSet_degC, .output = output}, kSet_degC) == ZoneTrip::kNone);
  }
}

TEST_CASE("Zone watch: another power for a window and not one count of temperature is a frozen reading", "[safety]") {
  ZoneWatch frozen{{}};
  CHECK(run(frozen, kSet_degC, 0.0, 0.3, 30.0) == ZoneTrip::kNone);
  CHECK(run(frozen, kSet_degC, 0.0, 0.41, 59.0, kSet_degC, Instant{31s}) == ZoneTrip::kNone);
  CHECK(run(frozen, kSet_degC, 0.0, 0.41, 1.1, kSet_degC, Instant{90s}) == ZoneTrip::kStuck);
  CHECK_THAT(describe(ZoneTrip::kStuck, frozen, "zone 2", {.T_degC = 145.0}), Contains("zone 2: 145.0 C"));
  ZoneWatch off{{}};  // Frozen above its set point: the board takes its power away.
  CHECK(run(off, 150.0, 0.0, 0.3, 30.0) == ZoneTrip::kNone);
  CHECK(run(off, 150.0, 0.0, 0.0, 61.0, kSet_degC, Instant{31s}) == ZoneTrip::kStuck);
  ZoneWatch alive{{}};  // One count is enough.
  CHECK(run(alive, kSet_degC, 0.0, 0.3, 30.0) == ZoneTrip::kNone);
  CHECK(run(alive, kSet_degC, 0.0, 0.41, 59.0, kSet_degC, Instant{31s}) == ZoneTrip::kNone);
  CHECK(run(alive, kSet_degC + 0.1, 0.0, 0.41, 600.0, kSet_degC, Instant{91s}) == ZoneTrip::kNone);
}
