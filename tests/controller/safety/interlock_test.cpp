#include "controller/safety/interlock.hpp"

#include <catch2/catch.hpp>

using namespace meltbench;
using namespace meltbench::safety;
using Catch::Matchers::Contains;

namespace {

constexpr Limits kLimits{
    .max_age = 2s, .max_implausible_time = 200ms, .max_pressure_Pa = 1e5, .max_filled_length_m = 0.198};

Observation make_healthy() {
  Observation seen;
  seen.pressure_age = seen.screw_age = seen.feed_age = 10ms;
  seen.pressure_Pa = 4e4;
  seen.filled_length_m = 0.16;
  return seen;
}

}  // namespace

TEST_CASE("Interlock: a healthy extruder trips nothing, nor does one exactly at its limits of age", "[safety]") {
  Observation seen = make_healthy();
  CHECK(judge(kLimits, seen) == Trip::kNone);
  seen.pressure_age = seen.screw_age = seen.feed_age = 2s;
  seen.implausible_time = 200ms;
  seen.pressure_Pa = 1e5;
  CHECK(judge(kLimits, seen) == Trip::kNone);
}

TEST_CASE("Interlock: each limit trips by itself, with its own code and the value in words", "[safety]") {
  Observation seen = make_healthy();
  SECTION("old pressure") {
    seen.pressure_age = 2s + 1ns;
    CHECK(judge(kLimits, seen) == Trip::kMeasurementStale);
    CHECK(code_of(Trip::kMeasurementStale) == "measurement-stale");
    CHECK_THAT(describe(Trip::kMeasurementStale, kLimits, seen), Contains("2 s, limit 2 s"));
  }
  SECTION("old encoder sample") {
    seen.screw_age = 3s;
    CHECK(judge(kLimits, seen) == Trip::kScrewStale);
    CHECK_THAT(describe(Trip::kScrewStale, kLimits, seen), Contains("3 s, limit 2 s"));
  }
  SECTION("old feeder report") {
    seen.feed_age = 3s;
    CHECK(judge(kLimits, seen) == Trip::kFeedStale);
  }
  SECTION("pressures that make no sense") {
    seen.implausible_time = 201ms;
    CHECK(judge(kLimits, seen) == Trip::kMeasurementImplausible);
    CHECK_THAT(describe(Trip::kMeasurementImplausible, kLimits, seen), Contains("0.201 s, limit 0.2 s"));
  }
  SECTION("high pressure") {
    seen.pressure_Pa = 1.5e5;
    CHECK(judge(kLimits, seen) == Trip::kPressureHigh);
    CHECK_THAT(describe(Trip::kPressureHigh, kLimits, seen), Contains("1.5 bar, limit 1 bar"));
  }
  SECTION("flooding, from the limit on") {
    seen.filled_length_m = 0.198;
    CHECK(judge(kLimits, seen) == Trip::kFlooding);
    CHECK_THAT(describe(Trip::kFlooding, kLimits, seen), Contains("0.198 m"));
  }
}

TEST_CASE("Interlock: of several reasons the one that hurts most is told", "[safety]") {
  Observation seen = make_healthy();
  seen.pressure_age = seen.feed_age = 3s;
  CHECK(judge(kLimits, seen) == Trip::kMeasurementStale);
  seen.filled_length_m = 0.2;
  CHECK(judge(kLimits, seen) == Trip::kFlooding);
  seen.pressure_Pa = 2e5;
  CHECK(judge(kLimits, seen) == Trip::kPressureHigh);
}

TEST_CASE("Interlock: a number that is missing trips by its age, not by itself", "[safety]") {
  Observation seen = make_healthy();
  seen.pressure_Pa.reset();
  seen.filled_length_m.reset();
  CHECK(judge(kLimits, seen) == Trip::kNone);
  seen.pressure_age = 3s;
  CHECK(judge(kLimits, seen) == Trip::kMeasurementStale);
}

TEST_CASE("Interlock: a device that complains about the bus goes on, one that complains about itself does not",
          "[safety]") {
  CHECK(is_survivable_emcy(0x0000));
  CHECK(is_survivable_emcy(0x8130));  // It missed our heartbeat.
  CHECK(is_survivable_emcy(0x8210));  // A PDO was too short.
  CHECK_FALSE(is_survivable_emcy(0x1000));
  CHECK_FALSE(is_survivable_emcy(0x5030));  // Hardware.
  CHECK_FALSE(is_survivable_emcy(0x8400));  // Speed controller.
  CHECK_FALSE(is_survivable_emcy(0xFF02));  // Device specific: unknown is no reassurance.
}
