#include "plant_emulator/model/polymer.hpp"

#include <catch2/catch.hpp>

#include "plant_emulator/model/melt_steady.hpp"

using namespace meltbench::plant;

TEST_CASE("Polymer: HDPE is the paper's", "[model][polymer]") {
  const MeltParameters hdpe = make_polymer(PolymerKind::kHdpe, 2e4).melt;
  const MeltParameters paper = paper_melt_parameters();
  CHECK(hdpe.T_melt_degC == paper.T_melt_degC);
  CHECK(hdpe.front_speed_per_flux_m3_per_J() == paper.front_speed_per_flux_m3_per_J());
  CHECK(hdpe.solid.exchange_rate_1_per_s() == paper.solid.exchange_rate_1_per_s());
}

TEST_CASE("Polymer: each has a steady state under a barrel 10 K above its melting temperature", "[model][polymer]") {
  for (const PolymerKind kind : {PolymerKind::kHdpe, PolymerKind::kPla, PolymerKind::kLdpe}) {
    const MeltParameters p = make_polymer(kind, 9e4).melt;
    const MeltBarrelWindow window = calc_melt_barrel_window(p, 0.015, 0.05);  // Lemma 1.
    CHECK(window.upper_K > 10.0);
    const MeltSteadyState steady = calc_melt_steady_state(p, p.T_melt_degC + 10, 0.015, 0.05);
    CHECK(steady.T_inlet_degC() < p.T_melt_degC);
    CHECK(steady.T_inlet_degC() > p.T_melt_degC - 20);
  }
}

TEST_CASE("Polymer: viscosity is 1000 Pa s at its reference and falls as Arrhenius says", "[model][polymer]") {
  const Viscosity pla = make_polymer(PolymerKind::kPla, 9e4).viscosity;
  CHECK(pla.at_Pa_s(170.0) == Approx(1000.0));
  const double arrhenius = std::exp(85e3 / 8.314 * (1 / 448.15 - 1 / 443.15));  // 5 K more.
  CHECK(pla.at_Pa_s(175.0) == Approx(1000.0 * arrhenius).epsilon(0.01));
}
