#pragma once
/// The melt equations by the method of lines under SUNDIALS CVODE: referee of the plant's own stepper.
/// Shares no code with plant_emulator/ but its parameters; used by tests and benchmarks only.

#include <cstddef>
#include <memory>
#include <span>

#include "plant_emulator/model/melt_inlet.hpp"
#include "plant_emulator/model/melt_material.hpp"
#include "plant_emulator/model/melt_steady.hpp"

namespace meltbench::referee {

/// BDF, Newton with the analytic Jacobian: its band (2,2) is factored by SUNDIALS' band solver; the two columns that
/// every row shares (front position, front speed through the moving mesh) are added by the Woodbury formula, without
/// which Newton does not converge. Third-order upwind-biased advection in both phases.
class MeltCvode {
 public:
  struct Settings {
    std::size_t solid_cells = 400;
    std::size_t liquid_cells = 80;
    double grid_speed_m_per_s = 10e-3;
    double end_cell = 0.0375;  ///< In units of α/b.
    double growth = 1.068;
    double relative_tolerance = 1e-8;
    double absolute_tolerance_K = 1e-8;  ///< Of temperatures; the front's is a millionth of it in metres.
  };
  MeltCvode(const plant::MeltParameters& parameters, double T_barrel_degC, const Settings& settings);
  ~MeltCvode();
  MeltCvode(const MeltCvode&) = delete;
  MeltCvode& operator=(const MeltCvode&) = delete;

  void start_linear(double front_m, double T_inlet_degC);
  void start_steady(const plant::MeltSteadyState& steady);
  /// Integrates to t with the input held; @throws std::runtime_error with CVODE's return value if it gives up.
  void advance_to(double t_s, double speed_m_per_s, const plant::MeltInlet& inlet);
  /// Forgets the integrator's history: to be called when the input has jumped, else it finds out by failing steps.
  void restart();

  [[nodiscard]] double front_m() const;
  [[nodiscard]] double T_inlet_degC() const;
  [[nodiscard]] double inlet_flux_W_per_m2() const;
  [[nodiscard]] std::span<const double> solid_nodes() const;
  /// Temperatures on solid_nodes() without the last, which is T_m.
  [[nodiscard]] std::span<const double> solid_T_degC() const;
  [[nodiscard]] long step_count() const;

 private:
  struct State;
  struct Hooks;
  std::unique_ptr<State> state_;
};

}  // namespace meltbench::referee
