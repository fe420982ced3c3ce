#include "plant_emulator/model/screw_clock.hpp"

#include <cmath>

namespace meltbench::plant {

ScrewClock::ScrewClock(double speed_m_per_s, double fluctuation, double fluctuation_rad_per_s, double phase_rad)
    : theta1_{speed_m_per_s}, eps_{fluctuation}, omega_{fluctuation_rad_per_s}, phase_{phase_rad} {}

void ScrewClock::set_speed(double t_s, double speed_m_per_s) {
  s_anchor_ = conveyed_m(t_s);
  s_nominal_anchor_ = nominal_conveyed_m(t_s);
  t_anchor_ = t_s;
  theta1_ = speed_m_per_s;
}

double ScrewClock::speed_m_per_s(double t_s) const {
  return theta1_ * (1.0 + eps_ * std::cos(omega_ * t_s + phase_));
}

double ScrewClock::acceleration_m_per_s2(double t_s) const {
  return -theta1_ * eps_ * omega_ * std::sin(omega_ * t_s + phase_);
}

double ScrewClock::conveyed_m(double t_s) const {
  return s_anchor_ + theta1_ * (stretched_time_s(t_s) - stretched_time_s(t_anchor_));
}

double ScrewClock::nominal_conveyed_m(double t_s) const {
  return s_nominal_anchor_ + theta1_ * (t_s - t_anchor_);
}

double ScrewClock::stretched_time_s(double t_s) const {
  if (omega_ == 0.0) return t_s * (1.0 + eps_ * std::cos(phase_));
  return t_s + eps_ * std::sin(omega_ * t_s + phase_) / omega_;
}

double ScrewClock::calc_time_s(double g_s, double guess_s) const {
  double t = guess_s;
  for (int i = 0; i < 12; ++i) {
    const double slope = 1.0 + eps_ * std::cos(omega_ * t + phase_);
    const double correction = (stretched_time_s(t) - g_s) / slope;
    t -= correction;
    if (std::abs(correction) < 1e-13) break;
  }
  return t;
}

}  // namespace meltbench::plant
