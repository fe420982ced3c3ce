#pragma once
/// The bizone extruder as [D17] prints it: the delay takes the speed of the moment for the whole way.

#include <cstddef>

#include "plant_emulator/model/ring.hpp"
#include "plant_emulator/model/screw_clock.hpp"

namespace meltbench::plant {

/// Filled length of the delay system of [D17], (13) with (16):
///
///   dx/dt = c(t) (u - v(x)) / (1 - u),   u = U(phi),   phi(t) = t - (L - x)/c(t)                        (D15)
///
/// Not the transport delay: if c varies, material is lost or doubled by some percent, and with a slow screw it may even
/// arrive out of order (dphi/dt < 0). Kept to reproduce the paper's figures. MODEL.md says how far off it is.
///
/// RK4 in t. U jumps where phi passes a sample boundary; each such instant is located, else the order drops to one.
/// Real time: no heap after construction; the number of substeps per call is bounded (kMaxSubsteps).
class FrozenDelayPlant {
 public:
  FrozenDelayPlant(double length_m, double theta2_per_m, double x0_m, double U_before, std::size_t max_samples = 65536);

  /// Integrates up to t with inlet filling ratio U held since the previous call.
  /// @pre t not before the previous one; 0 <= U <= kMaxFillRatio; the clock has not been changed since the previous t.
  void advance(double t_s, double U, const ScrewClock& clock);

  [[nodiscard]] double x_m() const { return x_; }
  [[nodiscard]] double U_at_interface() const { return u_; }
  [[nodiscard]] bool flooded() const { return flooded_; }
  [[nodiscard]] double spill_m() const { return spill_m_; }

  /// Material fed and not yet arrived plus the filled length, (D16). Not conserved by (D15).
  [[nodiscard]] double content_m(const ScrewClock& clock) const;
  /// Content minus what the flows say [m]: how far (16) breaks the mass balance. A property of the reading, no fault.
  [[nodiscard]] double mass_residual_m(const ScrewClock& clock) const;

  static constexpr int kMaxSubsteps = 20000;  ///< Per call; beyond it the rest is one step, boundaries not located.

 private:
  struct Sample {
    double t_end = 0.0;  // Held up to here [s].
    double U = 0.0;
    double fed_end_m = 0.0;  // int U c dt from t = 0 up to t_end.
  };
  struct Step {
    double x = 0.0, phi = 0.0;
  };

  [[nodiscard]] double calc_phi(double t, double x, const ScrewClock& clock) const;
  [[nodiscard]] double calc_rate(double t, double x, double u, const ScrewClock& clock) const;
  [[nodiscard]] Step step(double h, const ScrewClock& clock) const;
  [[nodiscard]] double calc_step_s(double t_end, const ScrewClock& clock) const;
  [[nodiscard]] double sample_begin() const;
  [[nodiscard]] double sample_end() const;
  [[nodiscard]] double fed_until(double t, const ScrewClock& clock) const;
  void select_sample(double phi);
  void take(double h, const Step& to, const ScrewClock& clock);
  bool step_to_boundary(double h, double boundary, bool upwards, const ScrewClock& clock);

  double L_, theta2_;
  Ring<Sample> samples_;
  std::size_t current_ = 0;  // Sample that phi is in; 0 = before the oldest kept one begins.
  double U_before_;
  double t_ = 0.0, x_, u_;
  bool flooded_ = false;
  double outflow_m_ = 0.0, spill_m_ = 0.0, content0_m_ = 0.0;
  bool content0_known_ = false;
};

}  // namespace meltbench::plant
