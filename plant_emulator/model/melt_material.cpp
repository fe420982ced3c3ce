#include "plant_emulator/model/melt_material.hpp"

#include <algorithm>
#include <cmath>

namespace meltbench::plant {

double MeltBarrel::share(std::size_t index, double x_over_L) const noexcept {
  const double last = static_cast<double>(zone_count - 1);
  const double place = std::clamp(x_over_L * static_cast<double>(zone_count) - 0.5, 0.0, last);
  return std::max(0.0, 1.0 - std::abs(place - static_cast<double>(index)));
}

double MeltBarrel::T_degC(double x_over_L) const noexcept {
  if (zone_count == 1) return T_zone_degC[0];
  const double last = static_cast<double>(zone_count - 1);
  const double place = std::clamp(x_over_L * static_cast<double>(zone_count) - 0.5, 0.0, last);
  const auto left = std::min(static_cast<std::size_t>(place), zone_count - 2);
  const double share_of_right = place - static_cast<double>(left);
  return T_zone_degC[left] + share_of_right * (T_zone_degC[left + 1] - T_zone_degC[left]);
}

MeltParameters hdpe_melt_parameters(double barrel_exchange_W_per_m3K) {
  return {.solid = {.conductivity_W_per_mK = 0.373,
                    .density_kg_per_m3 = 955.0,
                    .heat_capacity_J_per_kgK = 1895.0,
                    .barrel_exchange_W_per_m3K = barrel_exchange_W_per_m3K},
          .liquid = {.conductivity_W_per_mK = 0.324,
                     .density_kg_per_m3 = 780.0,
                     .heat_capacity_J_per_kgK = 2640.0,
                     .barrel_exchange_W_per_m3K = barrel_exchange_W_per_m3K},
          .T_melt_degC = 135.0,
          .heat_of_fusion_J_per_kg = 39000.0,
          .length_m = 0.1,
          .nozzle_flux_W_per_m2 = 100.0};
}

MeltParameters paper_melt_parameters() {
  return hdpe_melt_parameters(2e4);
}

MeltParameters bench_melt_parameters() {
  return hdpe_melt_parameters(9e4);
}

}  // namespace meltbench::plant
