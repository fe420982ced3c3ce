#include "controller/law/melt_materials.hpp"

#include <algorithm>
#include <array>

namespace meltbench::law {

namespace {

struct Row {
  std::string_view name;
  MeltPhaseModel solid, liquid;  // hbar is the machine's, not the polymer's.
  double T_melt_degC;
  double heat_of_fusion_J_per_kg;
  double activation_J_per_mol;
};

constexpr std::array kRows{
    Row{"hdpe", {0.373, 955.0, 1895.0, 0.0}, {0.324, 780.0, 2640.0, 0.0}, 135.0, 39000.0, 27e3},
    Row{"pla", {0.13, 1300.0, 1800.0, 0.0}, {0.13, 1240.0, 1800.0, 0.0}, 160.0, 32700.0, 85e3},
    Row{"ldpe", {0.36, 920.0, 2300.0, 0.0}, {0.36, 855.0, 2300.0, 0.0}, 110.0, 142800.0, 49e3},
};

const Row* find_row(std::string_view name) {
  const auto* found = std::find_if(kRows.begin(), kRows.end(), [&](const Row& row) { return row.name == name; });
  return found == kRows.end() ? nullptr : found;
}

}  // namespace

std::optional<MeltModel> find_melt_material(std::string_view name, double barrel_exchange_W_per_m3K) {
  const Row* row = find_row(name);
  if (row == nullptr) return {};
  MeltModel model = hdpe_melt_model(barrel_exchange_W_per_m3K);
  model.solid = row->solid;
  model.liquid = row->liquid;
  model.solid.barrel_exchange_W_per_m3K = model.liquid.barrel_exchange_W_per_m3K = barrel_exchange_W_per_m3K;
  model.T_melt_degC = row->T_melt_degC;
  model.heat_of_fusion_J_per_kg = row->heat_of_fusion_J_per_kg;
  return model;
}

double find_viscosity_decay_1_per_K(std::string_view name) {
  constexpr double kGasConstant_J_per_molK = 8.314, kBarrelExcess_K = 10.0, kZero_degC_in_K = 273.15;
  const Row* row = find_row(name);
  if (row == nullptr) return 0.0;
  const double T_K = row->T_melt_degC + kBarrelExcess_K + kZero_degC_in_K;
  return row->activation_J_per_mol / (kGasConstant_J_per_molK * T_K * T_K);
}

}  // namespace meltbench::law
