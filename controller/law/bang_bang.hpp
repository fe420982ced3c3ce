#pragma once
/// The nominal law of [D17], for the extruder without delay.

#include "controller/law/bizone_model.hpp"

namespace meltbench::law {

/// What to design the bang-bang law for.
struct BangBangSettings {
  double x_set_m = 0.16;             ///< x*, in (0, L).
  double max_fill = 0.9;             ///< vmax, in (v(x*), 1): the feeder's capacity. Not given in [D17].
  double slope_margin_per_m = 30.0;  ///< dS = S - Smin, > 0. Below about 24 the delay does no harm (x* = 0.16).
};

/// Piecewise exponential "bang-bang" law, (C3): full feed when empty, none when full, slope -S at the set point.
///
///   x <= x*:  v* + (vmax - v*) (1 - e^{-al (x* - x)}) / (1 - e^{-al x*})
///   x >  x*:  v* - v*          (1 - e^{-ar (x - x*)}) / (1 - e^{-ar (L - x*)})                          (C3)
///
/// Gains from [D17] (32), (33) by bisection; the spurious root a = 0 is excluded. A branch whose slope condition binds
/// (S equal to its least value) is linear, the limit of (C3) for a -> 0.
class BangBang {
 public:
  /// @throws std::invalid_argument naming the value and its range if a setting or the model is out of range.
  BangBang(const BizoneModel& model, const BangBangSettings& settings);

  /// Filling ratio to command at filled length x; x is clamped to [0, L]. Two exponentials at most.
  [[nodiscard]] double calc_U(double x_m) const;

  [[nodiscard]] double x_set_m() const { return x_set_; }
  [[nodiscard]] double U_set() const { return v_set_; }            ///< v* = v(x*): the open-loop rate.
  [[nodiscard]] double max_fill() const { return v_max_; }         ///< vmax.
  [[nodiscard]] double min_slope_per_m() const { return S_min_; }  ///< Smin, [D17] (31).
  [[nodiscard]] double slope_per_m() const { return S_; }          ///< S.
  [[nodiscard]] double left_gain_per_m() const { return a_l_; }    ///< al, [D17] (32).
  [[nodiscard]] double right_gain_per_m() const { return a_r_; }   ///< ar, [D17] (33).

 private:
  double L_, x_set_, v_max_, v_set_;
  double S_min_, S_, a_l_ = 0.0, a_r_ = 0.0;
};

/// Nonzero root a of S (1 - e^{-a X}) = a A, (C4), to 1e-14 relative; 0 if S X <= A, where there is none.
[[nodiscard]] double calc_gain_per_m(double S_per_m, double X_m, double A);

}  // namespace meltbench::law
