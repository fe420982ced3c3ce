#include <utility>

#include "plant_emulator/model/melt_scharfetter_gummel.hpp"
#include "plant_emulator/model/melt_solid.hpp"

namespace meltbench::plant {
namespace {

class ScharfetterGummelSolid final : public MeltSolid {
 public:
  ScharfetterGummelSolid(const MeltParameters& parameters, std::vector<double> nodes)
      : MeltSolid{parameters, std::move(nodes)},
        scheme_{nodes_.size()},
        x_old_(nodes_.size()),
        x_new_(nodes_.size()),
        u_old_(nodes_.size()),
        u_new_(nodes_.size()),
        offset_(nodes_.size()) {}

 private:
  double solve(const MeltPhaseStep& step, double drive_W_per_m2, double gain_W_per_m2K) noexcept override {
    const double T_b = step.barrel.T_degC(0.5);
    const bool uniform = step.barrel.zone_count == 1;
    for (std::size_t i = 0; i < nodes_.size(); ++i) {
      x_old_[i] = step.front_old_m * nodes_[i];
      x_new_[i] = step.front_new_m * nodes_[i];
      u_old_[i] = T_b - T_[i];
      if (!uniform) offset_[i] = step.barrel.T_degC(x_new_[i] / parameters_.length_m) - T_b;
    }
    // T_x(0) = (gain T - drive)/k_s with T = T_b - u gives u_x = (drive - gain T_b)/k_s + gain/k_s u.
    const double k_s = parameters_.solid.conductivity_W_per_mK;
    const auto inlet =
        ScharfetterGummelStep::End::slope((drive_W_per_m2 - gain_W_per_m2K * T_b) / k_s, gain_W_per_m2K / k_s);
    const auto front = ScharfetterGummelStep::End::value(T_b - parameters_.T_melt_degC);
    const auto slopes =
        scheme_.solve({.diffusivity_m2_per_s = parameters_.solid.diffusivity_m2_per_s(),
                       .exchange_rate_1_per_s = parameters_.solid.exchange_rate_1_per_s(),
                       .speed_m_per_s = step.speed_m_per_s,
                       .dt_s = step.dt_s},
                      x_old_, x_new_, u_old_, uniform ? std::span<const double>{} : offset_, inlet, front, u_new_);
    for (std::size_t i = 0; i < nodes_.size(); ++i) trial_[i] = T_b - u_new_[i];
    return -slopes.last_K_per_m;
  }

  ScharfetterGummelStep scheme_;
  std::vector<double> x_old_;
  std::vector<double> x_new_;
  std::vector<double> u_old_;
  std::vector<double> u_new_;
  std::vector<double> offset_;
};

}  // namespace

std::unique_ptr<MeltSolid> make_scharfetter_gummel_solid(const MeltParameters& parameters, std::vector<double> nodes) {
  return std::make_unique<ScharfetterGummelSolid>(parameters, std::move(nodes));
}

}  // namespace meltbench::plant
