#include "controller/safety/melt_interlock.hpp"

#include <catch2/catch.hpp>

using namespace meltbench::safety;
using Catch::Matchers::Contains;

namespace {

MeltObservation make_healthy() {
  return {.front_m = 0.05, .T_inlet_degC = 131.8, .T_solid_max_degC = 135.0};
}

}  // namespace

TEST_CASE("Melt interlock: a front in the barrel with fresh sensors is no reason to stop", "[safety]") {
  CHECK(judge({}, make_healthy()) == MeltTrip::kNone);
}

TEST_CASE("Melt interlock: half a flush without a sensor trips, named after the sensor", "[safety]") {
  MeltObservation seen = make_healthy();
  seen.front_coasted_m = 0.025;
  CHECK(judge({}, seen) == MeltTrip::kNone);
  seen.front_coasted_m = 0.0251;
  CHECK(judge({}, seen) == MeltTrip::kFrontStale);
  CHECK_THAT(describe(MeltTrip::kFrontStale, {}, seen), Contains("25.1 mm") && Contains("limit 25 mm"));
  seen.front_coasted_m = 0.0;
  seen.inlet_coasted_m = 0.0251;
  CHECK(judge({}, seen) == MeltTrip::kInletStale);
  CHECK_THAT(describe(MeltTrip::kInletStale, {}, seen), Contains("inlet temperature"));
}

TEST_CASE("Melt interlock: superheat trips whether it is measured or only estimated", "[safety]") {
  MeltObservation seen = make_healthy();
  seen.T_inlet_degC = 145.1;
  CHECK(judge({}, seen) == MeltTrip::kSuperheated);
  CHECK_THAT(describe(MeltTrip::kSuperheated, {}, seen), Contains("145.1 C"));
  seen.T_inlet_degC.reset();
  CHECK(judge({}, seen) == MeltTrip::kNone);
  seen.T_solid_max_degC = 145.1;
  CHECK(judge({}, seen) == MeltTrip::kSuperheated);
}

TEST_CASE("Melt interlock: melt that may freeze trips, beyond its limit only", "[safety]") {
  MeltObservation seen = make_healthy();
  seen.T_liquid_min_degC = 125.1;
  CHECK(judge({}, seen) == MeltTrip::kNone);
  seen.T_liquid_min_degC = 124.9;
  CHECK(judge({}, seen) == MeltTrip::kFreezing);
  CHECK_THAT(describe(MeltTrip::kFreezing, {}, seen), Contains("124.9 C") && Contains("limit 10 K below"));
  CHECK(judge({.max_undercooling_K = 12.0}, seen) == MeltTrip::kNone);
}

TEST_CASE("Melt interlock: a front at an end of the barrel trips with what was lost", "[safety]") {
  MeltObservation seen = make_healthy();
  seen.front_m = 0.0014;
  CHECK(judge({}, seen) == MeltTrip::kSolidLost);
  seen.front_m = 0.0986;
  CHECK(judge({}, seen) == MeltTrip::kMeltLost);
  CHECK_THAT(describe(MeltTrip::kMeltLost, {}, seen), Contains("1.4 mm before the nozzle"));
}

TEST_CASE("Melt interlock: every trip has a code of its own", "[safety]") {
  CHECK(code_of(MeltTrip::kSuperheated) == "superheated");
  CHECK(code_of(MeltTrip::kFreezing) == "melt-freezing");
  CHECK(code_of(MeltTrip::kSolidLost) == "solid-lost");
  CHECK(code_of(MeltTrip::kMeltLost) == "melt-lost");
  CHECK(code_of(MeltTrip::kFrontStale) == "front-stale");
  CHECK(code_of(MeltTrip::kInletStale) == "inlet-stale");
}
