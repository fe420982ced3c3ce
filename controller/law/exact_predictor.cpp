#include "controller/law/exact_predictor.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "controller/law/bizone_model.hpp"

namespace meltbench::law {

namespace {

double clamp_fill(double U, double otherwise) {
  return std::isnan(U) ? otherwise : std::clamp(U, 0.0, kMaxFillRatio);
}

ExactPredictor::Settings checked(const ExactPredictor::Settings& s) {
  const auto positive = [](double value) { return value > 0.0 && std::isfinite(value); };
  if (!positive(s.length_m) || !positive(s.theta2_per_m) || !positive(s.ds_min_m) || !(s.window_m >= s.length_m) ||
      !std::isfinite(s.window_m)) {
    throw std::invalid_argument(
        fmt::format("exact predictor: length_m = {}, theta2_per_m = {}, ds_min_m = {} must be > 0 and window_m = {} "
                    "not less than the length",
                    s.length_m, s.theta2_per_m, s.ds_min_m, s.window_m));
  }
  return s;
}

}  // namespace

double calc_affine_step(double P0_m, double d_m, double U, double theta2_per_m) noexcept {
  const double r = theta2_per_m * (1.0 - U);
  const double rd = r * d_m;
  if (std::abs(rd) < 1e-15) return P0_m + U * d_m;
  const double decay = std::expm1(-rd);  // (C5)
  return P0_m + (P0_m - U / r) * decay;
}

ExactPredictor::ExactPredictor(const Settings& settings)
    : settings_{checked(settings)}, knots_(static_cast<std::size_t>(settings.window_m / settings.ds_min_m) + 4) {
  start(0.0, 0.0);
}

void ExactPredictor::start(double s_m, double U) noexcept {
  U = clamp_fill(U, 0.0);
  knots_.clear();
  hint_ = 0;
  forgotten_ = false;
  // At rest in its own past: R stays where it is when followed backwards, however far.
  knots_.push_back(Knot{s_m, 0.0, U / (settings_.theta2_per_m * (1.0 - U)), U});
}

ExactPredictor::Knot ExactPredictor::calc_knot(const Knot& from, double s_to, double U) const noexcept {
  const double d = s_to - from.s;
  const double theta2 = settings_.theta2_per_m;
  return Knot{s_to, from.A + theta2 * (1.0 - U) * d, calc_affine_step(from.R, d, U, theta2), U};
}

void ExactPredictor::feed(double s_to_m, double U) noexcept {
  Knot& newest = knots_.back();
  if (!(s_to_m > newest.s) || !std::isfinite(s_to_m)) return;
  U = clamp_fill(U, newest.U);
  if (knots_.size() >= 2) {
    const Knot& before = knots_[knots_.size() - 2];
    const double held_m = newest.s - before.s;
    if (held_m < settings_.ds_min_m) {
      const double mean = (newest.U * held_m + U * (s_to_m - newest.s)) / (s_to_m - before.s);
      newest = calc_knot(before, s_to_m, mean);
      return;
    }
  }
  const Knot next = calc_knot(newest, s_to_m, U);
  if (knots_.full()) {
    knots_.pop_front();
    forgotten_ = true;
  }
  knots_.push_back(next);
}

// Index of the first knot at or after y, @pre y <= newest. From one call to the next y moves about as far as the
// history grows, so the distance from the newest knot is a good first guess; a jump is found by bisection.
std::size_t ExactPredictor::find_stretch(double y) const noexcept {
  const std::size_t last = knots_.size() - 1;
  std::size_t i = last - std::min(hint_, last);
  for (int steps = 0; steps < 4; ++steps) {
    if (knots_[i].s < y) {
      ++i;
    } else if (i > 0 && knots_[i - 1].s >= y) {
      --i;
    } else {
      hint_ = last - i;
      return i;
    }
  }
  std::size_t low = 0, high = last;
  while (low < high) {
    const std::size_t middle = low + (high - low) / 2;
    if (knots_[middle].s < y) {
      low = middle + 1;
    } else {
      high = middle;
    }
  }
  hint_ = last - high;
  return high;
}

Prediction ExactPredictor::predict(double s_measured_m, double x_measured_m,
                                   std::span<const FeedStretch> ahead) const noexcept {
  if (!std::isfinite(s_measured_m) || !std::isfinite(x_measured_m)) return {0.0, PredictionStatus::kBadInput};
  const double L = settings_.length_m;
  Prediction answer{std::clamp(x_measured_m, 0.0, L)};
  double y = s_measured_m - (L - answer.P_m);  // phi: the material that was arriving when x was measured.
  const Knot& newest = knots_.back();
  if (y < newest.s) {
    const std::size_t i = find_stretch(y);
    if (i == 0 && forgotten_) answer.status = PredictionStatus::kHistoryTooShort;
    const Knot phi = calc_knot(knots_[i == 0 ? 0 : i - 1], y, knots_[i].U);
    answer.P_m = newest.R + std::exp(-(newest.A - phi.A)) * (answer.P_m - phi.R);  // (C7)
    y = newest.s;
  }
  double U = newest.U;
  for (const FeedStretch& stretch : ahead) {
    if (!(stretch.s_to_m > y)) continue;
    U = clamp_fill(stretch.U, U);
    answer.P_m = calc_affine_step(answer.P_m, stretch.s_to_m - y, U, settings_.theta2_per_m);
    y = stretch.s_to_m;
  }
  return answer;
}

}  // namespace meltbench::law
