#include "controller/law/melt_materials.hpp"

#include <catch2/catch.hpp>
#include <string>

using namespace meltbench::law;

TEST_CASE("Melt materials: HDPE by name is the polymer of the melt paper", "[law]") {
  const MeltModel named = find_melt_material("hdpe", 2e4).value();
  const MeltModel paper = hdpe_melt_model(2e4);
  CHECK(named.solid.diffusivity_m2_per_s() == paper.solid.diffusivity_m2_per_s());
  CHECK(named.liquid.exchange_rate_1_per_s() == paper.liquid.exchange_rate_1_per_s());
  CHECK(named.T_melt_degC == paper.T_melt_degC);
  CHECK(named.heat_of_fusion_J_per_kg == paper.heat_of_fusion_J_per_kg);
}

TEST_CASE("Melt materials: every polymer has a steady state at the bench's speed and set point", "[law]") {
  for (const std::string name : {"hdpe", "pla", "ldpe"}) {
    CAPTURE(name);
    MeltModel model = find_melt_material(name, 9e4).value();
    model.length_m = 0.2;
    const auto reference = calc_melt_reference(model, model.T_melt_degC + 10.0, 0.015, 0.08);
    REQUIRE(reference);
    // At rest the inlet is a little below the melting point, and the barrel does the rest.
    CHECK(reference->T_inlet_degC < model.T_melt_degC);
    CHECK(reference->T_inlet_degC > model.T_melt_degC - 10.0);
    CHECK(reference->inlet_flux_W_per_m2 < 0.0);
  }
}

TEST_CASE("Melt materials: viscosity decays by E/(R T²), an unknown polymer is none", "[law]") {
  CHECK(find_viscosity_decay_1_per_K("hdpe") == Approx(27e3 / (8.314 * 418.15 * 418.15)));
  CHECK(find_viscosity_decay_1_per_K("pla") > find_viscosity_decay_1_per_K("ldpe"));
  CHECK_FALSE(find_melt_material("wood", 2e4));
  CHECK(find_viscosity_decay_1_per_K("wood") == 0.0);
}
