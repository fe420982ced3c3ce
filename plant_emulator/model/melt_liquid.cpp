#include "plant_emulator/model/melt_liquid.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <stdexcept>
#include <utility>

#include "plant_emulator/model/melt_grid.hpp"

namespace meltbench::plant {

MeltLiquid::MeltLiquid(const MeltParameters& parameters, std::vector<double> nodes)
    : parameters_{parameters},
      nodes_{std::move(nodes)},
      weights_{calc_quadrature_weights(nodes_)},
      T_(nodes_.size(), parameters.T_melt_degC),
      trial_{T_},
      scheme_{nodes_.size()},
      x_old_(nodes_.size()),
      x_new_(nodes_.size()),
      u_old_(nodes_.size()),
      offset_(nodes_.size()) {}

double MeltLiquid::try_step(const MeltPhaseStep& step) noexcept {
  const double L = parameters_.length_m;
  const double T_b = step.barrel.T_degC(0.5);
  const bool uniform = step.barrel.zone_count == 1;
  for (std::size_t i = 0; i < nodes_.size(); ++i) {
    x_old_[i] = step.front_old_m + (L - step.front_old_m) * nodes_[i];
    x_new_[i] = step.front_new_m + (L - step.front_new_m) * nodes_[i];
    u_old_[i] = T_b - T_[i];
    if (!uniform) offset_[i] = step.barrel.T_degC(x_new_[i] / L) - T_b;
  }
  const double nozzle_slope = parameters_.nozzle_flux_W_per_m2 / parameters_.liquid.conductivity_W_per_mK;
  const auto slopes = scheme_.solve({.diffusivity_m2_per_s = parameters_.liquid.diffusivity_m2_per_s(),
                                     .exchange_rate_1_per_s = parameters_.liquid.exchange_rate_1_per_s(),
                                     .speed_m_per_s = step.speed_m_per_s,
                                     .dt_s = step.dt_s},
                                    x_old_, x_new_, u_old_, uniform ? std::span<const double>{} : offset_,
                                    ScharfetterGummelStep::End::value(T_b - parameters_.T_melt_degC),
                                    ScharfetterGummelStep::End::slope(-nozzle_slope), trial_);
  for (double& T : trial_) T = T_b - T;
  return -slopes.first_K_per_m;
}

void MeltLiquid::accept() noexcept {
  std::swap(T_, trial_);
}

void MeltLiquid::set_T_degC(std::span<const double> T_degC) {
  if (T_degC.size() != T_.size()) {
    throw std::invalid_argument(fmt::format("melt liquid: {} temperatures for {} nodes", T_degC.size(), T_.size()));
  }
  std::copy(T_degC.begin(), T_degC.end(), T_.begin());
}

}  // namespace meltbench::plant
