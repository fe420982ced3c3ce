#pragma once
/// The material clock: how fast, and how far, the screw conveys.

namespace meltbench::plant {

/// Speed c(t) and conveyed length s(t) of the screw, (D2) and (D3).
///
///   c(t) = theta1 (1 + eps cos(omega t + phase))                                                        (D2)
///   s(t) = int_0^t c = theta1 (g(t) - g(0)),   g(t) = t + eps sin(omega t + phase) / omega              (D3)
///
/// theta1 may change at any instant; s stays continuous and the fluctuation keeps its phase. Closed form: no drift.
class ScrewClock {
 public:
  ScrewClock(double speed_m_per_s, double fluctuation, double fluctuation_rad_per_s, double phase_rad);

  /// New theta1 from time t on. Times asked for later must not be before t.
  void set_speed(double t_s, double speed_m_per_s);

  /// theta1 [m/s].
  [[nodiscard]] double nominal_speed_m_per_s() const { return theta1_; }
  /// c(t) [m/s].
  [[nodiscard]] double speed_m_per_s(double t_s) const;
  /// dc/dt [m/s^2].
  [[nodiscard]] double acceleration_m_per_s2(double t_s) const;
  /// s(t) [m].
  [[nodiscard]] double conveyed_m(double t_s) const;
  /// What the screw would have conveyed without fluctuation [m]: what an encoder sees if the material slips.
  [[nodiscard]] double nominal_conveyed_m(double t_s) const;

  /// g(t) of (D3) [s]: metres conveyed per theta1, whatever theta1 is.
  [[nodiscard]] double stretched_time_s(double t_s) const;
  /// Inverse of g: the time t with g(t) = g. Newton from `guess`, at most 12 steps, error < 1e-13 s + rounding.
  [[nodiscard]] double calc_time_s(double g_s, double guess_s) const;

 private:
  double theta1_, eps_, omega_, phase_;
  double t_anchor_ = 0.0;  // Time of the last change of theta1, and what had been conveyed by then.
  double s_anchor_ = 0.0;
  double s_nominal_anchor_ = 0.0;
};

}  // namespace meltbench::plant
