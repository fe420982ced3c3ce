#pragma once
/// Observer of the temperature profile in the granules, from the front position and the inlet surface temperature.

#include <array>
#include <cstddef>
#include <optional>
#include <span>
#include <vector>

namespace meltbench::estimator {

/// The observer's model of the solid phase and of the front.
struct MeltObserverModel {
  double conductivity_W_per_mK;  ///< k_s.
  double diffusivity_m2_per_s;   ///< α_s.
  double exchange_rate_1_per_s;  ///< h_s.
  double T_melt_degC;
  double length_m;                       ///< L; the front stays inside.
  double front_speed_per_flux_m3_per_J;  ///< β = 1/(ρ_s ΔH).
};

struct MeltObserverNumerics {
  std::size_t cells = 100;
  double grid_speed_m_per_s = 10e-3;  ///< The end cells resolve α/b at this b: the fastest that the run will use.
  double max_travel_m = 1e-4;         ///< b dt of an internal step.
  double max_step_s = 0.05;
};

/// One sample. A measurement that is missing or too old is left empty: the model carries on without it.
struct MeltObserverInput {
  double speed_m_per_s;  ///< b, measured.
  double T_barrel_degC;
  double inlet_flux_W_per_m2;          ///< q_f as *applied* since the last sample (its mean, after saturation).
  double liquid_front_flux_W_per_m2;   ///< K: only used while the front is not measured.
  std::optional<double> front_m;       ///< Y1.
  std::optional<double> T_inlet_degC;  ///< Y2.
};

enum class MeltObserverStatus {
  kTracking,  ///< Both measurements fresh.
  kCoasting,  ///< A measurement is missing; estimate from the model.
  kTripped,   ///< Missing for half a flush time: the estimate is worth nothing, the loop must go to its safe state.
};

/// (O1), (O2) of controller/MODEL.md, [K19] (28)-(30), on a graded grid that stretches with the measured front:
///
///   ∂That/∂t = α That_xx - b That_x + h (T_b - That),  0 < x < s
///   That_x(0) = -q_f/k_s - γ (Y2 - That(0)),  γ = b/(2α);     That(s) = T_m
///
/// The error is carried out of the barrel by the screw: it does not fall like the norm of (32) says but stays of order
/// one until s/b, then collapses. Third-order upwind-biased advection, implicit Euler, band (2,2).
/// The front that it uses follows Y1 within -3b - 5 mm/s ... 0.95b + 5 mm/s: no front of (5) moves faster than the
/// material, but for what conduction does after the screw has slowed.
/// Cost: one band solve per internal step, no allocation after construction, no throw.
class MeltObserver {
 public:
  /// @throws std::invalid_argument if the numerics cannot be computed with.
  MeltObserver(const MeltObserverModel& model, const MeltObserverNumerics& numerics);

  /// Starts with a profile linear from T_inlet to T_m. A guess below the true profile keeps Z > 0 (Lemma 2).
  void start_linear(double front_m, double T_inlet_degC) noexcept;
  /// Starts with a given profile on nodes(); size must be nodes().size(), else std::invalid_argument.
  void start(double front_m, std::span<const double> T_degC);

  /// Moves the estimate on by dt >= 0 to the time of the sample.
  MeltObserverStatus advance(double dt_s, const MeltObserverInput& input) noexcept;

  [[nodiscard]] MeltObserverStatus status() const noexcept { return status_; }
  [[nodiscard]] double front_m() const noexcept { return front_m_; }
  [[nodiscard]] double T_inlet_degC() const noexcept { return T_.front(); }
  [[nodiscard]] std::span<const double> nodes() const noexcept { return nodes_; }
  [[nodiscard]] std::span<const double> T_degC() const noexcept { return T_; }
  /// Screw travel since the oldest missing measurement was last seen [m].
  [[nodiscard]] double coasted_m() const noexcept { return coasted_m_; }

 private:
  void step(double dt_s, double front_new_m, const MeltObserverInput& input) noexcept;
  [[nodiscard]] double calc_front_slope_K_per_m() const noexcept;
  [[nodiscard]] double predict_front_speed_m_per_s(const MeltObserverInput& input) const noexcept;

  using Row = std::array<double, 5>;  // Nodes i-2 ... i+2.
  MeltObserverModel model_;
  MeltObserverNumerics numerics_;
  std::vector<double> nodes_;
  std::vector<Row> first_;       // Biased to the inlet.
  std::vector<Row> first_back_;  // Biased to the front, for where the mesh outruns the granules.
  std::vector<Row> second_;
  std::array<double, 2> first_of_slope_{};
  std::array<double, 2> second_of_slope_{};
  std::array<double, 6> front_slope_{};
  std::vector<double> T_;
  std::vector<double> near_;  // Eliminated rows.
  std::vector<double> far_;
  double front_m_ = 0.0;
  double front_speed_m_per_s_ = 0.0;
  double coasted_m_ = 0.0;
  MeltObserverStatus status_ = MeltObserverStatus::kTracking;
};

}  // namespace meltbench::estimator
