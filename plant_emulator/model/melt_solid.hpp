#pragma once
/// The granules, (1) and (3) of [K19], on a grid that stretches with the front; one class per discretisation.

#include <cstddef>
#include <memory>
#include <span>
#include <vector>

#include "plant_emulator/model/melt_inlet.hpp"
#include "plant_emulator/model/melt_material.hpp"

namespace meltbench::plant {

/// One implicit Euler step of a phase, with a trial front speed.
struct MeltPhaseStep {
  double dt_s;
  double speed_m_per_s;  ///< b.
  double front_old_m;
  double front_new_m;  ///< = front_old + dt * front_speed, else the mesh creates heat.
  double front_speed_m_per_s;
  MeltBarrel barrel;
};

/// The solid phase. A step is tried (any number of times, always from the last accepted state), then accepted.
/// Nodes ξ_0 = 0 ... ξ_N = 1, x = s ξ; T(ξ_N) = T_m always. No allocation and no throw in try_step() and accept().
class MeltSolid {
 public:
  virtual ~MeltSolid() = default;

  /// Computes the temperatures after the step. Returns T_s,x at the front [K/m].
  double try_step(const MeltPhaseStep& step, const MeltInlet& inlet) noexcept;
  /// Takes the last trial as the state.
  void accept() noexcept;
  /// Undoes accept(); at once after it only.
  void take_back() noexcept { accept(); }
  /// Moves the state on by `share` of the change that accept() just made.
  void carry_on(double share) noexcept;
  /// Sets the state; size must be nodes().size().
  void set_T_degC(std::span<const double> T_degC);

  [[nodiscard]] std::span<const double> nodes() const noexcept { return nodes_; }
  [[nodiscard]] std::span<const double> T_degC() const noexcept { return T_; }
  /// Quadrature weights on nodes(): ∫_0^1 f dξ = Σ w_i f(ξ_i).
  [[nodiscard]] std::span<const double> weights() const noexcept { return weights_; }
  /// q_f of the last trial, after saturation [W/m²].
  [[nodiscard]] double inlet_flux_W_per_m2() const noexcept { return inlet_flux_; }

 protected:
  MeltSolid(const MeltParameters& parameters, std::vector<double> nodes);

  /// Solves the step for q_f = drive - gain T(0) into trial_. Returns the front slope.
  virtual double solve(const MeltPhaseStep& step, double drive_W_per_m2, double gain_W_per_m2K) noexcept = 0;

  MeltParameters parameters_;
  std::vector<double> nodes_;
  std::vector<double> weights_;
  std::vector<double> T_;
  std::vector<double> trial_;

 private:
  double inlet_flux_ = 0.0;
};

/// The default: third-order upwind-biased advection and five-point diffusion on graded nodes, band (2,2); the front
/// slope from six points. Observed order three.
[[nodiscard]] std::unique_ptr<MeltSolid> make_third_order_solid(const MeltParameters& parameters,
                                                                std::vector<double> nodes);
/// Scharfetter-Gummel fluxes for θ = (T_b - T) e^{μx}, μ = -q4, which obeys advection and diffusion without a source:
/// conservative, monotone, nodally exact at steady state under a uniform barrel, first order in transients.
[[nodiscard]] std::unique_ptr<MeltSolid> make_scharfetter_gummel_solid(const MeltParameters& parameters,
                                                                       std::vector<double> nodes);
/// For comparison only: uniform cells, first-order upwind, front slope (T_m - T_{N-1})/dx. The slope is too small by
/// the cell's Peclet number, which slows the closed loop to a speed that depends on the grid and not on the screw.
[[nodiscard]] std::unique_ptr<MeltSolid> make_coarse_two_point_solid(const MeltParameters& parameters,
                                                                     std::size_t cells);

}  // namespace meltbench::plant
