#pragma once
/// The melting extruder: two temperature fields and the front between them.

#include <cstddef>
#include <memory>
#include <span>
#include <vector>

#include "plant_emulator/model/melt_inlet.hpp"
#include "plant_emulator/model/melt_liquid.hpp"
#include "plant_emulator/model/melt_material.hpp"
#include "plant_emulator/model/melt_solid.hpp"
#include "plant_emulator/model/melt_steady.hpp"

namespace meltbench::plant {

/// How the solid phase is discretised.
enum class MeltDiscretisation {
  kThirdOrderUpwind,     ///< The default ("fd3"): third-order upwind-biased advection on a graded grid.
  kScharfetterGummel,    ///< Independent check ("sgt"): conservative, monotone, first order, exact at steady state.
  kCoarseTwoPointSlope,  ///< For comparison only: uniform upwind cells, front slope from two points. Wrong by Pe.
};

/// Grids and steps of a MeltFront.
struct MeltNumerics {
  MeltDiscretisation solid = MeltDiscretisation::kThirdOrderUpwind;
  std::size_t solid_cells = 100;
  std::size_t liquid_cells = 40;
  double grid_speed_m_per_s = 10e-3;  ///< The end cells resolve α/b at this b: the fastest that the run will use.
  double max_travel_m = 1e-4;         ///< An Euler step: b dt at most this ...
  double max_step_s = 0.05;           ///< ... and dt at most this; a two-stage step reaches five times as far.
};

/// What moves the melt during one advance().
struct MeltInput {
  double speed_m_per_s;  ///< b >= 0, held over the advance.
  MeltInlet inlet;
  MeltBarrel barrel;
};

/// Whether the equations still describe the extruder. Everything but kRunning is latched: the state stays as it was.
enum class MeltStatus {
  kRunning,
  kSolidLost,    ///< s < 1 mm: no granules left in the barrel.
  kMeltLost,     ///< L - s < 1 mm: no melt left.
  kSuperheated,  ///< Solid more than 10 K above T_m: at 20.6 K the front speed becomes infinite.
  kDiverged,     ///< The step found no front speed; not seen in any supported regime.
};

/// Distance to the model's validity conditions (6) and (7), in kelvin; negative = violated.
struct MeltValidity {
  double solid_margin_K;   ///< T_m - max T_s, (6). The front itself is T_m, so this is <= 0 by construction of max.
  double liquid_margin_K;  ///< min T_l - T_m, (7).
  double solid_length_m;   ///< s.
  double liquid_length_m;  ///< L - s.
};

/// Two-phase Stefan problem with advection, (1)-(5) of [K19], plant_emulator/MODEL.md Part 2:
///
///   ∂T_s/∂t = α_s T_s,xx - b T_s,x + h_s (T_b - T_s),  0 < x < s;    T_s,x(0) = -q_f/k_s,  T_s(s) = T_m   (M1) (M3)
///   ∂T_l/∂t = α_l T_l,xx - b T_l,x + h_l (T_b - T_l),  s < x < L;    T_l(s) = T_m,  T_l,x(L) = q_m/k_l    (M2) (M4)
///   ds/dt   = β (k_s T_s,x(s) - k_l T_l,x(s))                                                             (M5)
///
/// Both domains are mapped to fixed graded grids that stretch with s. A step is implicit Euler, solved for the front
/// speed by a secant iteration, so the fields, the front and the mesh velocity of one step agree (geometric
/// conservation). An advance longer than one such step is made of two-stage steps (M17), five times as long and of
/// second order (third-order granules only). Temperatures [°C], x from the inlet [m].
/// Cost: bounded (at most kMaxSolves linear solves a step, usually one or two), no allocation after construction, no
/// throw.
class MeltFront {
 public:
  static constexpr int kMaxSolves = 12;
  static constexpr double kMinLength_m = 1e-3;
  static constexpr double kMaxSuperheat_K = 10.0;

  /// @throws std::invalid_argument if the parameters or the numerics cannot be computed with.
  MeltFront(const MeltParameters& parameters, const MeltNumerics& numerics);

  /// Starts as [K19] section 7 does: solid linear from T_inlet to T_m, liquid linear with the slope q_m/k_l.
  /// @pre kMinLength_m < front_m < L - kMinLength_m, else throws std::invalid_argument.
  void start_linear(double front_m, double T_inlet_degC);
  /// Starts on the given steady state. @pre as above.
  void start_steady(const MeltSteadyState& steady);
  /// Starts on temperatures at equidistant places from inlet to nozzle, first and last included, linear between.
  /// Granules above T_m start at T_m, melt below it as well. @pre as above, and at least two temperatures.
  void start_profile(double front_m, std::span<const double> T_degC);

  /// Moves time on by dt >= 0, in equal internal steps. Returns the status after it.
  MeltStatus advance(double dt_s, const MeltInput& input) noexcept;

  [[nodiscard]] MeltStatus status() const noexcept { return status_; }
  [[nodiscard]] double front_m() const noexcept { return front_m_; }
  [[nodiscard]] double front_speed_m_per_s() const noexcept { return front_speed_m_per_s_; }
  [[nodiscard]] double T_inlet_degC() const noexcept { return solid_->T_degC().front(); }
  [[nodiscard]] double T_nozzle_degC() const noexcept { return liquid_.T_degC().back(); }
  /// q_f at the end of the last step, and its mean over the last advance [W/m²], after saturation.
  [[nodiscard]] double inlet_flux_W_per_m2() const noexcept { return inlet_flux_; }
  [[nodiscard]] double mean_inlet_flux_W_per_m2() const noexcept { return mean_inlet_flux_; }
  /// k_s T_s,x and k_l T_l,x at the front [W/m²].
  [[nodiscard]] double solid_front_flux_W_per_m2() const noexcept { return solid_front_flux_; }
  [[nodiscard]] double liquid_front_flux_W_per_m2() const noexcept { return liquid_front_flux_; }
  [[nodiscard]] MeltValidity validity() const noexcept;

  /// Nodes as fractions of the phase's length, and temperatures there. Solid: x = s ξ; liquid: x = s + (L - s) η.
  [[nodiscard]] std::span<const double> solid_nodes() const noexcept { return solid_->nodes(); }
  [[nodiscard]] std::span<const double> solid_T_degC() const noexcept { return solid_->T_degC(); }
  [[nodiscard]] std::span<const double> liquid_nodes() const noexcept { return liquid_.nodes(); }
  [[nodiscard]] std::span<const double> liquid_T_degC() const noexcept { return liquid_.T_degC(); }
  /// Temperature at x [°C], linear between nodes; outside [0, L] the end value.
  [[nodiscard]] double T_degC(double x_m) const noexcept;
  /// Mean temperature of the last `length_m` before the nozzle [°C]; what the viscosity in the screw sees.
  [[nodiscard]] double mean_T_before_nozzle_degC(double length_m) const noexcept;

  /// Heat that the zones of `barrel` give to both phases now, per cross-section: ∫ hbar (T_b - T) share_j dx [W/m²].
  void calc_barrel_heat_W_per_m2(const MeltBarrel& barrel, std::span<double> heat_W_per_m2) const noexcept;

  /// Energy identity of (M1), (M3), (M5), accounted since start [m of front]:
  ///   d/dt [ s + c_s/ΔH ∫(T_m - T_s) ] = -β k_l T_l,x(s) - β q_f + c_s/ΔH [ b (T_m - T_s(0)) - h_s ∫(T_b - T_s) ] (M6)
  /// stored = left side integrated, supplied = right side; their difference is the discretisation's energy error.
  [[nodiscard]] double energy_stored_m() const noexcept;
  [[nodiscard]] double energy_residual_m() const noexcept { return energy_stored_m() - energy_supplied_m_; }

 private:
  double step(double dt_s, const MeltInput& input) noexcept;
  double euler_steps(double dt_s, const MeltInput& input) noexcept;
  double two_stage_step(double dt_s, const MeltInput& input) noexcept;
  bool find_front(double dt_s, double since_last_s, const MeltInput& input, const MeltPhaseStep* melt) noexcept;
  void account(double dt_s, const MeltInput& input) noexcept;
  void restart(double front_m);
  [[nodiscard]] MeltStatus judge() const noexcept;
  [[nodiscard]] double energy_content_m() const noexcept;
  [[nodiscard]] double energy_supply_m_per_s(const MeltInput& input) const noexcept;

  MeltParameters parameters_;
  MeltNumerics numerics_;
  std::unique_ptr<MeltSolid> solid_;
  MeltLiquid liquid_;
  MeltStatus status_ = MeltStatus::kRunning;
  double front_m_ = 0.0;
  double front_speed_m_per_s_ = 0.0;
  double inlet_flux_ = 0.0;
  double mean_inlet_flux_ = 0.0;
  double solid_front_flux_ = 0.0;
  double liquid_front_flux_ = 0.0;
  double corrected_speed_ = 0.0;  // First guess of the next step: the last speed less its mismatch ...
  double acceleration_ = 0.0;     // ... and its trend, trusted for as long as
  double last_step_s_ = 0.0;      // it was measured over.
  double residual_slope_ = 1.0;   // d(mismatch)/d(front speed), carried from step to step.
  double energy_at_start_m_ = 0.0;
  double energy_supplied_m_ = 0.0;
};

}  // namespace meltbench::plant
