#include <algorithm>
#include <cmath>
#include <utility>

#include "plant_emulator/model/melt_grid.hpp"
#include "plant_emulator/model/melt_solid.hpp"

namespace meltbench::plant {
namespace {

/// Central diffusion, first-order upwind advection, two-point slope at the front, on uniform cells.
class CoarseSolid final : public MeltSolid {
 public:
  CoarseSolid(const MeltParameters& parameters, std::size_t cells)
      : MeltSolid{parameters, make_uniform_nodes(cells)}, upper_(nodes_.size()), right_side_(nodes_.size()) {}

 private:
  double solve(const MeltPhaseStep& step, double drive_W_per_m2, double gain_W_per_m2K) noexcept override {
    const std::size_t N = nodes_.size() - 1;
    const double dx = step.front_new_m / static_cast<double>(N);
    const double k_s = parameters_.solid.conductivity_W_per_mK;
    const double diffusion = step.dt_s * parameters_.solid.diffusivity_m2_per_s() / (dx * dx);
    const double exchange = step.dt_s * parameters_.solid.exchange_rate_1_per_s();
    for (std::size_t i = 0; i < N; ++i) {
      const double advection = step.dt_s * (step.speed_m_per_s - nodes_[i] * step.front_speed_m_per_s) / dx;
      const double T_b = step.barrel.T_degC(nodes_[i] * step.front_new_m / parameters_.length_m);
      double lower = -diffusion - std::max(advection, 0.0);
      double diagonal = 1.0 + exchange + 2.0 * diffusion + std::abs(advection);
      double upper = -diffusion + std::min(advection, 0.0);
      double y = T_[i] + exchange * T_b;
      if (i == 0) {  // Mirror node behind the inlet; advection takes the inlet's own slope (gain T_0 - drive)/k_s.
        const double of_slope = (2.0 * diffusion + advection) * dx / k_s;
        lower = 0.0;
        diagonal = 1.0 + exchange + 2.0 * diffusion + of_slope * gain_W_per_m2K;
        upper = -2.0 * diffusion;
        y += of_slope * drive_W_per_m2;
      }
      if (i + 1 == N) y -= upper * parameters_.T_melt_degC;
      const double pivot = 1.0 / (diagonal - (i > 0 ? lower * upper_[i - 1] : 0.0));
      upper_[i] = upper * pivot;
      right_side_[i] = (y - (i > 0 ? lower * right_side_[i - 1] : 0.0)) * pivot;
    }
    trial_[N] = parameters_.T_melt_degC;
    trial_[N - 1] = right_side_[N - 1];
    for (std::size_t i = N - 1; i-- > 0;) trial_[i] = right_side_[i] - upper_[i] * trial_[i + 1];
    return (trial_[N] - trial_[N - 1]) / dx;
  }

  std::vector<double> upper_;
  std::vector<double> right_side_;
};

}  // namespace

std::unique_ptr<MeltSolid> make_coarse_two_point_solid(const MeltParameters& parameters, std::size_t cells) {
  return std::make_unique<CoarseSolid>(parameters, cells);
}

}  // namespace meltbench::plant
