#include "controller/law/paper_predictor.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace meltbench::law {

namespace {

double clamp_fill(double U, double otherwise) {
  return std::isnan(U) ? otherwise : std::clamp(U, 0.0, kMaxFillRatio);
}

constexpr double kMaxStep_m = 1e-3;    // Conveyed per RK4 step: error < 1e-11 m over the barrel.
constexpr double kMaxStep_rad = 0.02;  // Of the fluctuation per step, likewise.

}  // namespace

PaperPredictor::PaperPredictor(const BizoneModel& model, std::size_t samples) : model_{model}, samples_(samples) {
  const bool sound = model.speed_m_per_s > 0.0 && model.length_m > 0.0 && model.theta2_per_m > 0.0 &&
                     model.fluctuation >= 0.0 && model.fluctuation < 1.0 && model.fluctuation_rad_per_s >= 0.0;
  if (!sound) {
    throw std::invalid_argument(fmt::format(
        "paper predictor: speed_m_per_s = {}, length_m = {}, theta2_per_m = {} must be > 0, fluctuation = "
        "{} in [0, 1), fluctuation_rad_per_s = {} not negative",
        model.speed_m_per_s, model.length_m, model.theta2_per_m, model.fluctuation, model.fluctuation_rad_per_s));
  }
  start(0.0, 0.0);
}

void PaperPredictor::start(double t_s, double U) noexcept {
  samples_.clear();
  forgotten_ = false;
  samples_.push_back(TimedFeed{t_s, clamp_fill(U, 0.0)});
}

void PaperPredictor::feed(double t_to_s, double U) noexcept {
  if (!(t_to_s > newest_s()) || !std::isfinite(t_to_s)) return;
  U = clamp_fill(U, samples_.back().U);
  if (samples_.full()) {
    samples_.pop_front();
    forgotten_ = true;
  }
  samples_.push_back(TimedFeed{t_to_s, U});
}

double PaperPredictor::calc_speed_m_per_s(double t) const noexcept {
  const double phase = model_.fluctuation_rad_per_s * t + model_.fluctuation_phase_rad;
  return model_.speed_m_per_s * (1.0 + model_.fluctuation * std::cos(phase));
}

PaperPredictor::State PaperPredictor::calc_rate(const State& at, double U, double& min_den) const noexcept {
  const auto& [P, sigma] = at;
  const double theta1 = model_.speed_m_per_s, theta2 = model_.theta2_per_m;
  const double eps = model_.fluctuation, omega = model_.fluctuation_rad_per_s;
  const double phase = omega * sigma + model_.fluctuation_phase_rad;
  const double c = theta1 * (1.0 + eps * std::cos(phase));
  const double a = theta1 * eps * omega * std::sin(phase) / (c * c);  // c(sigma), where [D17] (91) prints c(t).
  const double q = (1.0 - U) * (1.0 + theta2 * P);
  const double den = 1.0 - a * (model_.length_m - P) * q;  // (C9)
  min_den = std::min(min_den, den);
  return State{c * (U - theta2 * (1.0 - U) * P) / den, q / den};
}

void PaperPredictor::integrate(State& state, double span_s, double U, double& min_den) const noexcept {
  const double steps_m = span_s * model_.speed_m_per_s / kMaxStep_m;
  const double steps_rad = span_s * model_.fluctuation_rad_per_s / kMaxStep_rad;
  const int steps = 1 + static_cast<int>(std::min(std::max(steps_m, steps_rad), 1e6));
  const double h = span_s / steps;
  const auto moved = [&](const State& rate, double by) {
    return State{state.P + by * rate.P, state.sigma + by * rate.sigma};
  };
  for (int i = 0; i < steps && min_den >= kMinDenominator; ++i) {
    const State k1 = calc_rate(state, U, min_den);
    const State k2 = calc_rate(moved(k1, 0.5 * h), U, min_den);
    const State k3 = calc_rate(moved(k2, 0.5 * h), U, min_den);
    const State k4 = calc_rate(moved(k3, h), U, min_den);
    state.P += h * (k1.P + 2.0 * k2.P + 2.0 * k3.P + k4.P) / 6.0;
    state.sigma += h * (k1.sigma + 2.0 * k2.sigma + 2.0 * k3.sigma + k4.sigma) / 6.0;
  }
}

std::size_t PaperPredictor::find_sample(double t) const noexcept {
  std::size_t low = 0, high = samples_.size();
  while (low < high) {
    const std::size_t middle = low + (high - low) / 2;
    if (samples_[middle].t_to_s <= t) {
      low = middle + 1;
    } else {
      high = middle;
    }
  }
  return high;
}

PaperPrediction PaperPredictor::predict(double t_measured_s, double x_measured_m,
                                        std::span<const TimedFeed> ahead) const noexcept {
  PaperPrediction answer;
  if (!std::isfinite(t_measured_s) || !std::isfinite(x_measured_m)) {
    answer.status = PredictionStatus::kBadInput;
    return answer;
  }
  const double L = model_.length_m;
  State state{std::clamp(x_measured_m, 0.0, L), t_measured_s};
  double theta = t_measured_s - (L - state.P) / calc_speed_m_per_s(t_measured_s);
  if (forgotten_ && theta < samples_.front().t_to_s) answer.status = PredictionStatus::kHistoryTooShort;
  double U = samples_.back().U;
  const auto advance_to = [&](const TimedFeed& feed) {
    if (!(feed.t_to_s > theta)) return;
    U = clamp_fill(feed.U, U);
    integrate(state, feed.t_to_s - theta, U, answer.min_denominator);
    theta = feed.t_to_s;
  };
  for (std::size_t i = find_sample(theta); i < samples_.size(); ++i) advance_to(samples_[i]);
  for (const TimedFeed& feed : ahead) advance_to(feed);

  answer.P_m = state.P;
  answer.sigma_s = state.sigma;
  answer.residual_s = state.sigma - theta - (L - state.P) / calc_speed_m_per_s(state.sigma);
  if (!(answer.min_denominator >= kMinDenominator)) answer.status = PredictionStatus::kInfeasible;
  return answer;
}

Theorem3 check_theorem3(const BizoneModel& model) {
  const double theta1 = model.speed_m_per_s, theta2 = model.theta2_per_m, L = model.length_m;
  const double eps = model.fluctuation;
  const double disturbance = eps * model.fluctuation_rad_per_s / ((1.0 - eps) * (1.0 - eps));
  const double bound = theta1 * theta2 / ((1.0 + theta2 * L) * (1.0 + theta2 * L));
  if (disturbance < bound) return Theorem3::k93;
  if (disturbance > bound && disturbance < theta1 / L && theta2 < 1.0 / L) return Theorem3::k94;
  if (disturbance > bound && disturbance < 4.0 * bound && theta2 > 1.0 / L) return Theorem3::k95;
  return Theorem3::kNone;
}

}  // namespace meltbench::law
