#include "plant_emulator/model/polymer.hpp"

namespace meltbench::plant {

namespace {

constexpr double kBarrelExcess_K = 10.0;  // Of T_ref over T_m.
constexpr double kGasConstant_J_per_molK = 8.314;
constexpr double kZero_degC_in_K = 273.15;

/// Arrhenius, linearised in the exponent at T_ref.
Viscosity make_viscosity(double T_melt_degC, double activation_J_per_mol) {
  const double T_ref_K = T_melt_degC + kBarrelExcess_K + kZero_degC_in_K;
  return {.at_reference_Pa_s = 1000.0,
          .T_reference_degC = T_melt_degC + kBarrelExcess_K,
          .decay_1_per_K = activation_J_per_mol / (kGasConstant_J_per_molK * T_ref_K * T_ref_K)};
}

}  // namespace

Polymer make_polymer(PolymerKind kind, double barrel_exchange_W_per_m3K) {
  MeltParameters melt = hdpe_melt_parameters(barrel_exchange_W_per_m3K);
  double activation_J_per_mol = 27e3;
  if (kind == PolymerKind::kPla) {
    activation_J_per_mol = 85e3;
    melt.solid.conductivity_W_per_mK = 0.13;
    melt.solid.density_kg_per_m3 = 1300.0;
    melt.solid.heat_capacity_J_per_kgK = 1800.0;
    melt.liquid.conductivity_W_per_mK = 0.13;
    melt.liquid.density_kg_per_m3 = 1240.0;
    melt.liquid.heat_capacity_J_per_kgK = 1800.0;
    melt.T_melt_degC = 160.0;
    melt.heat_of_fusion_J_per_kg = 32700.0;
  }
  if (kind == PolymerKind::kLdpe) {
    activation_J_per_mol = 49e3;
    melt.solid.conductivity_W_per_mK = 0.36;
    melt.solid.density_kg_per_m3 = 920.0;
    melt.solid.heat_capacity_J_per_kgK = 2300.0;
    melt.liquid.conductivity_W_per_mK = 0.36;
    melt.liquid.density_kg_per_m3 = 855.0;
    melt.liquid.heat_capacity_J_per_kgK = 2300.0;
    melt.T_melt_degC = 110.0;
    melt.heat_of_fusion_J_per_kg = 142800.0;
  }
  return {melt, make_viscosity(melt.T_melt_degC, activation_J_per_mol)};
}

}  // namespace meltbench::plant
