#pragma once
/// The melt, (2) and (4) of [K19], on a grid that shrinks as the front advances.

#include <span>
#include <vector>

#include "plant_emulator/model/melt_scharfetter_gummel.hpp"
#include "plant_emulator/model/melt_solid.hpp"

namespace meltbench::plant {

/// The liquid phase by Scharfetter-Gummel. Nodes η_0 = 0 ... η_M = 1, x = s + (L - s) η; T(η_0) = T_m always.
/// A step is tried, then accepted, as in MeltSolid.
class MeltLiquid {
 public:
  MeltLiquid(const MeltParameters& parameters, std::vector<double> nodes);

  /// Computes the temperatures after the step. Returns T_l,x at the front [K/m].
  double try_step(const MeltPhaseStep& step) noexcept;
  void accept() noexcept;
  /// Sets the state; size must be nodes().size(), else std::invalid_argument.
  void set_T_degC(std::span<const double> T_degC);

  [[nodiscard]] std::span<const double> nodes() const noexcept { return nodes_; }
  [[nodiscard]] std::span<const double> T_degC() const noexcept { return T_; }
  /// Quadrature weights on nodes(): ∫_0^1 f dη = Σ w_i f(η_i).
  [[nodiscard]] std::span<const double> weights() const noexcept { return weights_; }

 private:
  MeltParameters parameters_;
  std::vector<double> nodes_;
  std::vector<double> weights_;
  std::vector<double> T_;
  std::vector<double> trial_;
  ScharfetterGummelStep scheme_;
  std::vector<double> x_old_;
  std::vector<double> x_new_;
  std::vector<double> u_old_;
  std::vector<double> offset_;
};

}  // namespace meltbench::plant
