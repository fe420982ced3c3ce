#pragma once
/// An independent integrator for the delay extruder's closed loops: no parcels, no material clock, no predictor
/// formula.
///
/// The plant is the delay ODE in time, dx/dt = c (u - v(x))/(1 - u), u = U(phi), with phi found at every stage of RK4
/// by Newton from its definition; steps end where phi meets a change of U. A prediction is made by its definition, P(t)
/// = x(sigma) with phi(sigma) = t: a copy of the plant is run ahead until the present arrives. Slow (a whole run per
/// sample) and used only as referee and to make fixtures/reference/delay_zoh_10ms.csv.

#include <algorithm>
#include <cmath>
#include <vector>

#include "tests/controller/law/delay_loop.hpp"

namespace brute_force {

using delay_loop::Kind;

class Plant {
 public:
  Plant(const meltbench::plant::BizoneParameters& p, bool frozen_delay)
      : L_{p.length_m},
        theta2_{p.theta2_per_m()},
        theta1_{p.speed_m_per_s},
        eps_{p.fluctuation},
        omega_{p.fluctuation_rad_per_s},
        frozen_{frozen_delay},
        x_{p.x0_m} {
    history_.push_back({0.0, theta2_ * x_ / (1.0 + theta2_ * x_)});
  }

  /// U has been held from the end of the history up to t_end.
  void feed(double t_end, double U) { history_.push_back({t_end, U}); }

  /// Runs to t_end or until phi = phi_end, whichever is first.
  void run(double t_end, double phi_end = INFINITY) {
    const double max_step = 5e-4 / theta1_;
    while (t_ < t_end - 1e-13) {
      const double h = std::min(max_step, t_end - t_);
      const double stop = std::min(history_[i_].t_end, phi_end);
      const double x_new = step(h);
      if (calc_phi(t_ + h, x_new) <= stop) {
        t_ += h;
        x_ = x_new;
        continue;
      }
      const double cut = calc_crossing(h, stop);
      x_ = step(cut);
      t_ += cut;
      if (stop == phi_end) return;
      if (i_ + 1 < history_.size()) ++i_;
    }
  }

  [[nodiscard]] double x() const { return x_; }
  /// From now on the screw is believed to turn evenly: the model of the state-only predictor.
  void forget_fluctuation() { eps_ = 0.0; }

  /// The first part of the history that phi, after an abrupt change of model, lies in.
  void find_place() {
    const double phi = calc_phi(t_, x_);
    i_ = 0;
    while (i_ + 1 < history_.size() && history_[i_].t_end < phi) ++i_;
  }

 private:
  struct Held {
    double t_end, U;
  };

  [[nodiscard]] double speed(double t) const { return theta1_ * (1.0 + eps_ * std::cos(omega_ * t)); }
  [[nodiscard]] double conveyed(double t) const { return theta1_ * (t + eps_ * std::sin(omega_ * t) / omega_); }

  [[nodiscard]] double calc_phi(double t, double x) const {
    if (frozen_) return t - (L_ - x) / speed(t);
    const double s = conveyed(t) - (L_ - x);
    double phi = t - (L_ - x) / theta1_;
    for (int i = 0; i < 50; ++i) {
      const double correction = (conveyed(phi) - s) / speed(phi);
      phi -= correction;
      if (std::abs(correction) < 1e-15 + 1e-16 * std::abs(phi)) break;
    }
    return phi;
  }

  [[nodiscard]] double step(double h) const {
    const double u = history_[i_].U;
    const auto rate = [&](double t, double x) {
      return speed(t) * (u - theta2_ * x / (1.0 + theta2_ * x)) / (1.0 - u);
    };
    const double k1 = rate(t_, x_), k2 = rate(t_ + h / 2, x_ + h / 2 * k1);
    const double k3 = rate(t_ + h / 2, x_ + h / 2 * k2), k4 = rate(t_ + h, x_ + h * k3);
    return std::clamp(x_ + h * (k1 + 2 * k2 + 2 * k3 + k4) / 6, 0.0, L_);
  }

  [[nodiscard]] double calc_crossing(double h, double stop) const {
    double low = 0.0, high = h;
    double f_low = calc_phi(t_, x_) - stop, f_high = calc_phi(t_ + h, step(h)) - stop;
    for (int i = 0; i < 200 && high - low > 1e-15; ++i) {
      double cut = high - f_high * (high - low) / (f_high - f_low);
      if (i % 4 == 3 || !(cut > low && cut < high)) cut = 0.5 * (low + high);
      const double f = calc_phi(t_ + cut, step(cut)) - stop;
      if (std::abs(f) < 1e-14) return cut;
      (f > 0.0 ? high : low) = cut;
      (f > 0.0 ? f_high : f_low) = f;
    }
    return high;
  }

  double L_, theta2_, theta1_, eps_, omega_;
  bool frozen_;
  double t_ = 0.0, x_;
  std::vector<Held> history_;
  std::size_t i_ = 0;  // Part of the history that phi lies in.
};

/// The loop of delay_loop::run() without latencies.
inline delay_loop::Run run(const meltbench::plant::BizoneParameters& p, Kind kind, double T, double end_s) {
  const meltbench::law::BangBang bang_bang{delay_loop::matched_model(p), {}};
  const bool frozen = p.delay_reading == meltbench::plant::DelayReading::kPaper;
  Plant extruder{p, frozen};
  delay_loop::Run result;
  result.sample_s = T;
  const auto samples = std::lround(end_s / T);
  for (long k = 0; k <= samples; ++k) {
    const double t = static_cast<double>(k) * T;
    double P = extruder.x();
    if (kind == Kind::kExact || kind == Kind::kPaper || kind == Kind::kStateOnly) {
      Plant ahead = extruder;
      if (kind == Kind::kStateOnly) {
        ahead.forget_fluctuation();
        ahead.find_place();
      }
      ahead.feed(INFINITY, 0.0);  // Never reached: the run ends when the present arrives.
      ahead.run(INFINITY, t);
      P = ahead.x();
    }
    const double U = kind == Kind::kOpenLoop ? bang_bang.U_set() : bang_bang.calc_U(P);
    result.samples.push_back({t, 0.0, extruder.x(), U, P});
    extruder.feed(t + T, U);
    extruder.run(t + T);
  }
  return result;
}

}  // namespace brute_force
