#pragma once
/// What the controller believes about the extruder. It may be wrong: nothing here is shared with the plant.
/// Equation numbers (C..) are those of controller/MODEL.md, [D17] is the paper named there.

namespace meltbench::law {

/// The controller's own constants of the bizone extruder; defaults are those of [D17] and of the bench's `slow` preset.
struct BizoneModel {
  double length_m = 0.2;                                    ///< L.
  double theta2_per_m = 2.45e-5 / (9.345e-9 * 1240.0);      ///< theta2 = Kd/(B rho0).
  double mass_per_length_kg_per_m = 1240.0 * 2.2383097e-4;  ///< rho0 S_eff: turns filling ratio into mass flow.
  double nozzle_kg = 2.45e-5;                               ///< Kd: turns pressure into flow.
  double viscosity_Pa_s = 1000.0;                           ///< eta.

  double speed_m_per_s = 0.015;               ///< theta1. Used by the laws that do not look at the encoder.
  double fluctuation = 0.1;                   ///< eps. Used by the paper's predictor only.
  double fluctuation_rad_per_s = 4.0 / 60.0;  ///< omega, likewise.
  double fluctuation_phase_rad = 0.0;         ///< Phase at Instant{0}, likewise.

  /// Filling ratio that holds x at rest, (C1): v(x) = theta2 x/(1 + theta2 x).
  [[nodiscard]] double holding_ratio(double x_m) const {
    const double r = theta2_per_m * x_m;
    return r / (1.0 + r);
  }

  /// Mass flow [kg/s] that gives filling ratio U while the screw conveys at c, (C2): F = rho0 S_eff c U.
  [[nodiscard]] double feed_kg_per_s(double U, double c_m_per_s) const {
    return mass_per_length_kg_per_m * c_m_per_s * U;
  }
};

/// A full channel would make the model singular; what is commanded or believed to be applied stays below.
inline constexpr double kMaxFillRatio = 0.999;

}  // namespace meltbench::law
