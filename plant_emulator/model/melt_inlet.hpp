#pragma once
/// The inlet preconditioner as a boundary condition.

#include <algorithm>

namespace meltbench::plant {

/// Heat flux into the granules at x = 0, positive heats:
///
///   q_f = clip(feedforward - gain (T_s(0) - T_reference), min, max)                       (M7)
///
/// gain = 0 is the plain flux of (3). gain = γ k_s with feedforward = q_f* is the part of (82) that cannot be sampled;
/// the preconditioner closes it here, inside the implicit step.
struct MeltInlet {
  double feedforward_W_per_m2 = 0.0;
  double gain_W_per_m2K = 0.0;
  double T_reference_degC = 0.0;
  double min_W_per_m2 = -1e12;
  double max_W_per_m2 = 1e12;

  [[nodiscard]] static constexpr MeltInlet flux(double q_W_per_m2) {
    MeltInlet inlet;
    inlet.feedforward_W_per_m2 = q_W_per_m2;
    return inlet;
  }
  [[nodiscard]] static constexpr MeltInlet local_loop(double feedforward, double gain, double T_reference) {
    MeltInlet inlet;
    inlet.feedforward_W_per_m2 = feedforward;
    inlet.gain_W_per_m2K = gain;
    inlet.T_reference_degC = T_reference;
    return inlet;
  }
  /// q_f before clipping, for an inlet temperature.
  [[nodiscard]] constexpr double wanted_W_per_m2(double T_inlet_degC) const {
    return feedforward_W_per_m2 - gain_W_per_m2K * (T_inlet_degC - T_reference_degC);
  }
};

}  // namespace meltbench::plant
