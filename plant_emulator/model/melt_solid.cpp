#include "plant_emulator/model/melt_solid.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <stdexcept>
#include <utility>

#include "plant_emulator/model/melt_grid.hpp"

namespace meltbench::plant {

MeltSolid::MeltSolid(const MeltParameters& parameters, std::vector<double> nodes)
    : parameters_{parameters},
      nodes_{std::move(nodes)},
      weights_{calc_quadrature_weights(nodes_)},
      T_(nodes_.size(), parameters.T_melt_degC),
      trial_{T_} {}

double MeltSolid::try_step(const MeltPhaseStep& step, const MeltInlet& inlet) noexcept {
  const double drive = inlet.feedforward_W_per_m2 + inlet.gain_W_per_m2K * inlet.T_reference_degC;
  double slope = solve(step, drive, inlet.gain_W_per_m2K);
  const double wanted = drive - inlet.gain_W_per_m2K * trial_.front();
  inlet_flux_ = std::clamp(wanted, inlet.min_W_per_m2, inlet.max_W_per_m2);
  // The inlet temperature rises with q_f, so a flux beyond a limit stays beyond it when the limit is applied.
  if (inlet_flux_ != wanted) slope = solve(step, inlet_flux_, 0.0);
  return slope;
}

void MeltSolid::accept() noexcept {
  std::swap(T_, trial_);
}

void MeltSolid::carry_on(double share) noexcept {
  for (std::size_t i = 0; i < T_.size(); ++i) T_[i] += share * (T_[i] - trial_[i]);
}

void MeltSolid::set_T_degC(std::span<const double> T_degC) {
  if (T_degC.size() != T_.size()) {
    throw std::invalid_argument(fmt::format("melt solid: {} temperatures for {} nodes", T_degC.size(), T_.size()));
  }
  std::copy(T_degC.begin(), T_degC.end(), T_.begin());
}

}  // namespace meltbench::plant
