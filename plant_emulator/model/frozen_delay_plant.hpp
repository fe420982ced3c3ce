#pragma once
/// The bizone extruder as [D17] prints it: the delay takes the speed of the moment for the whole way.

#include <cstddef>

#include "plant_emulator/model/screw_clock.hpp"
#include "protocols/time/ring.hpp"

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
  /// @param clock  as it runs at t = 0 and ran before.
  FrozenDelayPlant(double length_m, double theta2_per_m, double x0_m, double U_before, const ScrewClock& clock,
                   std::size_t max_samples = 65536);

  /// Integrates up to t with inlet filling ratio U held since the previous call.
  /// @pre t not before the previous one; 0 <= U <= kMaxFillRatio; the clock has not been changed since the previous t.
  void advance(double t_s, double U, const ScrewClock& clock);

  [[nodiscard]] double x_m() const { return x_; }
  [[nodiscard]] double U_at_interface() const { return samples_[current_].U; }
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
  [[nodiscard]] Step try_step(double h, const ScrewClock& clock) const;
  [[nodiscard]] double calc_max_step_s(const ScrewClock& clock) const;
  [[nodiscard]] double calc_crossing_s(double h, double phi_end, double boundary, const ScrewClock& clock) const;
  [[nodiscard]] double sample_begin() const;
  [[nodiscard]] double calc_fed_m(double t) const;
  void append(double t_end, double U, const ScrewClock& clock);
  void select_sample(double phi);
  void take(double h, const Step& to, const ScrewClock& clock);

  double L_, theta2_;
  Ring<Sample> samples_;     // The oldest one holds for ever before its end.
  std::size_t current_ = 0;  // The one that phi lies in.
  ScrewClock before_;        // As the screw ran before the start.
  double t_ = 0.0, x_;
  bool flooded_ = false;
  double outflow_m_ = 0.0, spill_m_ = 0.0, content0_m_ = 0.0;
};

}  // namespace meltbench::plant
