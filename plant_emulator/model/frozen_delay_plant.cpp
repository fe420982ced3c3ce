#include "plant_emulator/model/frozen_delay_plant.hpp"

#include <algorithm>
#include <cmath>

namespace meltbench::plant {

namespace {

constexpr double kPhiTolerance_s = 1e-13;  // A boundary counts as crossed beyond this; it moves x by less than 1e-12 m.
constexpr double kMaxDelay_s = 1e6;        // Stands for "for ever" while the screw stands.

}  // namespace

FrozenDelayPlant::FrozenDelayPlant(double length_m, double theta2_per_m, double x0_m, double U_before,
                                   const ScrewClock& clock, std::size_t max_samples)
    : L_{length_m}, theta2_{theta2_per_m}, samples_(max_samples), before_{clock}, x_{x0_m} {
  samples_.push_back(Sample{0.0, U_before, 0.0});
  content0_m_ = content_m(clock);
}

void FrozenDelayPlant::advance(double t_s, double U, const ScrewClock& clock) {
  if (!(t_s > t_)) return;
  append(t_s, U, clock);
  bool stuck = false;  // Just crossed a boundary without moving on: phi slides along it.
  for (int i = 0; i < kMaxSubsteps && t_ < t_s; ++i) {
    const double h = std::min(calc_max_step_s(clock), t_s - t_);
    const Step to = try_step(h, clock);
    const double end = samples_[current_].t_end;
    const bool ahead = to.phi > end + kPhiTolerance_s;
    const bool back = to.phi < sample_begin() - kPhiTolerance_s;
    if (!(ahead || back) || stuck || to.x >= L_) {
      take(h, to, clock);
      select_sample(calc_phi(t_, x_, clock));
      stuck = false;
      continue;
    }
    const double h_cross = calc_crossing_s(h, to.phi, ahead ? end : sample_begin(), clock);
    stuck = h_cross <= kPhiTolerance_s;
    take(h_cross, try_step(h_cross, clock), clock);
    if (ahead && current_ + 1 < samples_.size()) ++current_;
    if (back && current_ > 0) --current_;
  }
  if (t_ < t_s) {
    take(t_s - t_, try_step(t_s - t_, clock), clock);
    select_sample(calc_phi(t_, x_, clock));
  }
  t_ = t_s;  // Not a sum of steps: rounding must not add up.
}

double FrozenDelayPlant::calc_phi(double t, double x, const ScrewClock& clock) const {
  const double c = clock.speed_m_per_s(t);
  return t - (c * kMaxDelay_s > L_ ? (L_ - x) / c : kMaxDelay_s);
}

// One RK4 step of (D15) with the filling ratio of the current sample.
FrozenDelayPlant::Step FrozenDelayPlant::try_step(double h, const ScrewClock& clock) const {
  const double u = samples_[current_].U;
  const auto rate = [&](double c, double x) { return c * (u - theta2_ * x / (1.0 + theta2_ * x)) / (1.0 - u); };
  const double c0 = clock.speed_m_per_s(t_), c1 = clock.speed_m_per_s(t_ + 0.5 * h), c2 = clock.speed_m_per_s(t_ + h);
  const double k1 = rate(c0, x_);
  const double k2 = rate(c1, x_ + 0.5 * h * k1);
  const double k3 = rate(c1, x_ + 0.5 * h * k2);
  const double k4 = rate(c2, x_ + h * k3);
  const double x = x_ + h * (k1 + 2.0 * k2 + 2.0 * k3 + k4) / 6.0;
  return Step{x, calc_phi(t_ + h, x, clock)};
}

// 1 mm conveyed, less if the channel is nearly full (x then moves 1/(1 - u) times as fast), and 0.02 rad of
// fluctuation: RK4 is then good to 1e-11 m.
double FrozenDelayPlant::calc_max_step_s(const ScrewClock& clock) const {
  const double c = clock.speed_m_per_s(t_);
  const double u = samples_[current_].U;
  const double bend = std::abs(clock.acceleration_m_per_s2(t_));
  double h = std::min(1e-3, 1e-2 * (1.0 - u)) / std::max(c, 1e-9);
  if (bend > 0.0) h = std::min(h, 0.02 * c / bend);
  return h;
}

// The h at which phi reaches the boundary; phi is past it at the given h. Regula falsi (Illinois).
double FrozenDelayPlant::calc_crossing_s(double h, double phi_end, double boundary, const ScrewClock& clock) const {
  double h0 = 0.0, h1 = h;
  double f0 = calc_phi(t_, x_, clock) - boundary, f1 = phi_end - boundary;
  if (f0 * f1 >= 0.0) return 0.0;  // Already there.
  for (int i = 0; i < 50; ++i) {
    const double h_new = (h0 * f1 - h1 * f0) / (f1 - f0);
    const double f_new = try_step(h_new, clock).phi - boundary;
    if (std::abs(f_new) < 0.5 * kPhiTolerance_s) return h_new;
    if (f_new * f1 < 0.0) {
      h0 = h1;
      f0 = f1;
    } else {
      f0 *= 0.5;
    }
    h1 = h_new;
    f1 = f_new;
  }
  return h1;
}

double FrozenDelayPlant::sample_begin() const {
  return current_ == 0 ? -kMaxDelay_s * 2.0 : samples_[current_ - 1].t_end;
}

void FrozenDelayPlant::append(double t_end, double U, const ScrewClock& clock) {
  const double fed = samples_.back().fed_end_m + U * (clock.conveyed_m(t_end) - clock.conveyed_m(t_));
  if (samples_.full()) {
    samples_.pop_front();
    if (current_ > 0) --current_;
  }
  samples_.push_back(Sample{t_end, U, fed});
}

void FrozenDelayPlant::select_sample(double phi) {
  while (current_ + 1 < samples_.size() && phi > samples_[current_].t_end + kPhiTolerance_s) ++current_;
  while (current_ > 0 && phi < samples_[current_ - 1].t_end - kPhiTolerance_s) --current_;
}

void FrozenDelayPlant::take(double h, const Step& to, const ScrewClock& clock) {
  const auto outflow_rate = [&](double t, double x) {
    return clock.speed_m_per_s(t) * theta2_ * x / (1.0 + theta2_ * x);
  };
  const double x_new = std::clamp(to.x, 0.0, L_);
  outflow_m_ += 0.5 * h * (outflow_rate(t_, x_) + outflow_rate(t_ + h, x_new));
  flooded_ = to.x > L_;
  if (flooded_) spill_m_ += (to.x - L_) * (1.0 - samples_[current_].U);
  t_ += h;
  x_ = x_new;
}

// int U c dt from 0 to t, t in the current sample; negative before 0. The clock may have been changed since then, so
// not by the clock but by what was fed.
double FrozenDelayPlant::calc_fed_m(double t) const {
  const Sample& sample = samples_[current_];
  if (current_ == 0) return sample.fed_end_m + sample.U * (before_.conveyed_m(t) - before_.conveyed_m(sample.t_end));
  const Sample& previous = samples_[current_ - 1];
  const double share = (t - previous.t_end) / (sample.t_end - previous.t_end);
  return previous.fed_end_m + share * (sample.fed_end_m - previous.fed_end_m);
}

double FrozenDelayPlant::content_m(const ScrewClock& clock) const {
  return x_ + samples_.back().fed_end_m - calc_fed_m(calc_phi(t_, x_, clock));
}

double FrozenDelayPlant::mass_residual_m(const ScrewClock& clock) const {
  return content_m(clock) - content0_m_ - (samples_.back().fed_end_m - outflow_m_ - spill_m_);
}

}  // namespace meltbench::plant
