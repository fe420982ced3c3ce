#include "plant_emulator/model/standing_polymer.hpp"

#include <array>
#include <catch2/catch.hpp>
#include <cmath>

using namespace meltbench::plant;

namespace {

MeltParameters make_parameters() {
  MeltParameters p = bench_melt_parameters();
  p.length_m = 0.2;
  return p;
}

/// Four zones at one temperature.
MeltBarrel make_zones(double T_degC) {
  MeltBarrel barrel;
  barrel.zone_count = 4;
  barrel.T_zone_degC.fill(T_degC);
  return barrel;
}

}  // namespace

TEST_CASE("Standing polymer: solid follows the barrel exponentially", "[model][standing]") {
  const MeltParameters p = make_parameters();
  StandingPolymer polymer{p, 0.02, 60, 25};
  const double rate = p.solid.exchange_rate_1_per_s();
  for (int k = 1; k <= 40; ++k) {
    polymer.advance(1.0, make_zones(120));
    // Euler in steps of 1 s: rate dt/2 = 2.5 % of the exponent's growth at most.
    REQUIRE(polymer.T_degC(0.15) == Approx(120 - 95 * std::exp(-rate * k)).margin(1.0));
  }
}

TEST_CASE("Standing polymer: melting takes the heat of fusion at the melting temperature", "[model][standing]") {
  const MeltParameters p = make_parameters();
  StandingPolymer polymer{p, 0.02, 60, 134.999};
  const double needs_s = p.heat_of_fusion_J_per_kg * p.solid.density_kg_per_m3 / (9e4 * 10);
  polymer.advance(0.48 * needs_s, make_zones(145));
  CHECK(polymer.T_degC(0.15) == 135.0);
  CHECK(polymer.molten_from_nozzle_m() == 0.0);
  polymer.advance(0.48 * needs_s, make_zones(145));
  CHECK(polymer.T_degC(0.15) == 135.0);
  CHECK(polymer.molten_from_nozzle_m() == Approx(0.18));
  polymer.advance(0.3 * needs_s, make_zones(145));
  CHECK(polymer.T_degC(0.15) > 137.0);
}

TEST_CASE("Standing polymer: the cooled throat stays granular, and a cold barrel freezes the rest",
          "[model][standing]") {
  StandingPolymer polymer{make_parameters(), 0.02, 60, 25};
  polymer.advance(600, make_zones(150));
  CHECK(polymer.T_degC(0.005) == Approx(60).margin(0.1));
  CHECK(polymer.front_m() == Approx(0.02).margin(1e-6));
  CHECK(polymer.can_start());
  polymer.advance(600, make_zones(25));
  CHECK(polymer.T_degC(0.15) == Approx(25).margin(0.1));
  CHECK(std::isnan(polymer.front_m()));
  CHECK_FALSE(polymer.can_start());
}

TEST_CASE("Standing polymer: what the barrel gives is what the polymer gets", "[model][standing]") {
  const MeltParameters p = make_parameters();
  StandingPolymer polymer{p, 0.0, 60, 25};  // No throat: all heat is the zones'.
  const double area_mass = p.solid.density_kg_per_m3 * p.length_m;
  double given_J_per_m2 = 0;
  std::array<double, 4> heat{};
  for (int k = 0; k < 1500; ++k) {
    polymer.calc_barrel_heat_W_per_m2(make_zones(160), heat);
    for (const double zone : heat) given_J_per_m2 += 0.1 * zone;
    polymer.advance(0.1, make_zones(160));
  }
  const double T_degC = polymer.T_degC(0.1);
  REQUIRE(T_degC > 140.0);
  const double enthalpy = 110 * p.solid.heat_capacity_J_per_kgK + p.heat_of_fusion_J_per_kg +
                          (T_degC - 135) * p.liquid.heat_capacity_J_per_kgK;
  CHECK(given_J_per_m2 == Approx(area_mass * enthalpy).epsilon(1e-9));
}

TEST_CASE("Standing polymer: to stop and to start at once leaves front and temperatures where they were",
          "[model][standing]") {
  const MeltParameters p = make_parameters();
  MeltFront melt{p, {.grid_speed_m_per_s = 0.015}};
  melt.start_steady(calc_melt_steady_state(p, 145, 0.015, 0.08));
  const double T_before = melt.T_degC(0.15);
  StandingPolymer polymer{p, 0.02, 60, 25};
  polymer.take_over(melt);
  CHECK(polymer.solid_m() == Approx(0.08).margin(1e-9));
  polymer.hand_over(melt);
  CHECK(melt.front_m() == Approx(0.08).margin(1e-9));
  CHECK(melt.T_degC(0.15) == Approx(T_before).margin(0.05));  // Cells of 2.5 mm, linear between.
  CHECK(melt.T_degC(0.04) == Approx(calc_melt_steady_state(p, 145, 0.015, 0.08).T_solid_degC(0.04)).margin(0.05));
}

TEST_CASE("Standing polymer: a start from a soaked barrel is smooth however short the steps", "[model][standing]") {
  const MeltParameters p = make_parameters();
  StandingPolymer polymer{p, 0.02, 60, 25};
  polymer.advance(900, make_zones(146));
  for (const double least_s : {1e-5, 2e-3}) {
    MeltFront melt{p, {.grid_speed_m_per_s = 0.015}};
    polymer.hand_over(melt);
    double highest_degC = 0;
    for (int k = 0; k < 1000; ++k) {
      const MeltInput input{.speed_m_per_s = std::min(0.015, 1.5e-4 * (k + 1)),
                            .inlet = MeltInlet::local_loop(-16, 13573, 131.9),
                            .barrel = make_zones(146)};
      REQUIRE(melt.advance(least_s, input) == MeltStatus::kRunning);
      REQUIRE(melt.advance(0.01 - least_s, input) == MeltStatus::kRunning);
      for (const double T : melt.liquid_T_degC()) highest_degC = std::max(highest_degC, T);
    }
    CHECK(highest_degC < 146.1);  // The barrel's, and the nozzle's flux of 100 W/m².
    CHECK(melt.front_m() == Approx(0.075).margin(0.005));
  }
}
