#pragma once
/// The melt loop without a bus: plant, sensors, observer, law and preconditioner, stepped by a fixed sample time.
/// Shared by the tests of this folder.

#include <functional>
#include <string_view>
#include <vector>

#include "controller/estimator/melt_observer.hpp"
#include "controller/law/melt_law.hpp"
#include "plant_emulator/model/melt_front.hpp"

namespace meltbench::melt_loop {

/// The presets of physics, both sides agreeing on every figure.
struct Preset {
  std::string_view name;
  plant::MeltParameters plant;
  law::MeltModel model;
};
[[nodiscard]] Preset paper_preset();
[[nodiscard]] Preset bench_preset();
[[nodiscard]] Preset preset_named(std::string_view name);

/// Where q_f = q_f* - γ k_s (T_s(0) - T_reference) is closed.
enum class Placement {
  kBoard,   ///< In the preconditioner, every plant step.
  kCapped,  ///< In the controller, with the gain limited to what its sample time allows.
  kDirect,  ///< In the controller with the full gain: (82) as published, sampled.
};

/// What the observer is told when a sensor is silent.
enum class OnSilence {
  kModel,  ///< Nothing: the model carries on.
  kHold,   ///< The last value.
};

struct Silence {
  double from_s = 0.0;
  double to_s = 0.0;
};

struct Settings {
  Preset preset = paper_preset();
  double speed_m_per_s = 10e-3;
  double T_barrel_degC = 145.0;
  double front_start_m = 20e-3;
  double front_set_m = 50e-3;
  double T_inlet_start_degC = 115.0;
  double T_inlet_guess_degC = 95.0;
  double duration_s = 15.0;
  double sample_s = 10e-3;
  Placement placement = Placement::kBoard;
  bool full_state = false;  ///< The law sees the plant's profile instead of the observer's.
  plant::MeltDiscretisation solid = plant::MeltDiscretisation::kThirdOrderUpwind;
  std::size_t plant_cells = 100;
  std::size_t observer_cells = 100;
  double max_travel_m = 1e-4;  ///< b dt of the plant's and the observer's internal steps.
  double flux_min_W_per_m2 = -1e12;
  double flux_max_W_per_m2 = 1e12;
  double T_quantum_K = 0.0;  ///< Resolution of Y2 and Y1; 0 = exact.
  double front_quantum_m = 0.0;
  double T_bias_K = 0.0;  ///< Error of Y2, and of the thermocouple inside the preconditioner.
  int delay_samples = 0;  ///< Age of both measurements.
  Silence inlet_silent;
  Silence front_silent;
  OnSilence on_silence = OnSilence::kModel;
};

struct Sample {
  double t_s;
  double front_m;
  double T_inlet_degC;
  double flux_W_per_m2;
  double Z_W_per_m2;
  double observer_error_K;  ///< max over the granules of |T - That|.
};

struct Run {
  std::vector<Sample> samples;  ///< One per sample time, the first at sample_s.
  plant::MeltStatus status = plant::MeltStatus::kRunning;
  double ended_s = 0.0;
  double front_set_m = 0.0;
  double front_start_m = 0.0;
  double front_flux_W_per_m2 = 0.0;   ///< k_s T_s,x(s) at the end.
  double worst_solid_margin_K = 1e9;  ///< Smallest margin of (6) and (7) in the run.
  double worst_liquid_margin_K = 1e9;
  bool observer_tripped = false;

  /// Front at t, linear between samples.
  [[nodiscard]] double front_at_m(double t_s) const;
  /// Last time outside 2 % of the step.
  [[nodiscard]] double settle_s() const;
  [[nodiscard]] double integral_of_error_mm_s() const;
  [[nodiscard]] double largest(double Sample::*what) const;
  [[nodiscard]] double smallest(double Sample::*what) const;
};

/// Runs the loop; stops early when the plant's status is no longer kRunning.
[[nodiscard]] Run run(const Settings& settings, law::MeltLaw& law);
/// The same with the backstepping law at 100 1/m.
[[nodiscard]] Run run(const Settings& settings);

}  // namespace meltbench::melt_loop
