#include "plant_emulator/model/melt_scharfetter_gummel.hpp"

#include <cmath>

namespace meltbench::plant {
namespace {

/// Bernoulli function P/(e^P - 1); its series where the quotient loses digits.
double bernoulli(double P) {
  if (std::abs(P) < 1e-3) return 1.0 - 0.5 * P + P * P / 12.0;
  return P / (std::exp(P) - 1.0);
}

}  // namespace

ScharfetterGummelStep::ScharfetterGummelStep(std::size_t node_count)
    : faces_(node_count - 1), upper_(node_count), right_side_(node_count) {}

ScharfetterGummelStep::Slopes ScharfetterGummelStep::solve(const Coefficients& c, std::span<const double> x_old_m,
                                                           std::span<const double> x_new_m,
                                                           std::span<const double> u_old_K,
                                                           std::span<const double> offset_K, const End& first,
                                                           const End& last, std::span<double> u_K) noexcept {
  const std::size_t n = faces_.size() + 1;
  const double alpha = c.diffusivity_m2_per_s;
  const double h = c.exchange_rate_1_per_s;
  const double S = std::sqrt(c.speed_m_per_s * c.speed_m_per_s + 4.0 * alpha * h);
  const double mu = 2.0 * h / (c.speed_m_per_s + S);
  const double dt = c.dt_s;
  const auto node_speed = [&](std::size_t i) { return (x_new_m[i] - x_old_m[i]) / dt; };

  for (std::size_t i = 0; i + 1 < n; ++i) {
    const double dx = x_new_m[i + 1] - x_new_m[i];
    const double P = (S - 0.5 * (node_speed(i) + node_speed(i + 1))) * dx / alpha;
    const double B = bernoulli(P);
    const double shift = std::exp(mu * dx);
    faces_[i] = {alpha / dx * (B + P), alpha / dx * B * shift, shift};
  }

  const auto half_widths = [n](std::span<const double> x, std::size_t i) {
    return 0.5 * ((i + 1 < n ? x[i + 1] : x[i]) - (i > 0 ? x[i - 1] : x[i]));
  };
  const auto old_content = [&](std::size_t i) {
    const double source = offset_K.empty() ? 0.0 : dt * h * offset_K[i] * half_widths(x_new_m, i);
    return half_widths(x_old_m, i) * u_old_K[i] * std::exp(mu * (x_old_m[i] - x_new_m[i])) - source;
  };
  // Flux of θ through an end that moves with speed w: (S - w - αμ) u - α u_x.
  const double through_first = S - node_speed(0) - alpha * mu;
  const double through_last = S - node_speed(n - 1) - alpha * mu;

  for (std::size_t i = 0; i < n; ++i) {  // Elimination from first to last.
    double diagonal = half_widths(x_new_m, i);
    double lower = 0.0;
    double upper = 0.0;
    double y = old_content(i);
    if (i > 0) {
      lower = -dt * faces_[i - 1].out / faces_[i - 1].shift;
      diagonal += dt * faces_[i - 1].back / faces_[i - 1].shift;
    }
    if (i + 1 < n) {
      upper = -dt * faces_[i].back;
      diagonal += dt * faces_[i].out;
    }
    if (i == 0) {
      diagonal -= dt * (through_first - alpha * first.slope_gain_1_per_m);
      y -= dt * alpha * first.slope_K_per_m;
    }
    if (i + 1 == n) {
      diagonal += dt * (through_last - alpha * last.slope_gain_1_per_m);
      y += dt * alpha * last.slope_K_per_m;
    }
    const End* given = i == 0 && first.value_given ? &first : i + 1 == n && last.value_given ? &last : nullptr;
    if (given != nullptr) {
      lower = upper = 0.0;
      diagonal = 1.0;
      y = given->u_K;
    }
    const double pivot = 1.0 / (diagonal - (i > 0 ? lower * upper_[i - 1] : 0.0));
    upper_[i] = upper * pivot;
    right_side_[i] = (y - (i > 0 ? lower * right_side_[i - 1] : 0.0)) * pivot;
  }
  u_K[n - 1] = right_side_[n - 1];
  for (std::size_t i = n - 1; i-- > 0;) u_K[i] = right_side_[i] - upper_[i] * u_K[i + 1];

  Slopes slopes{first.slope_K_per_m + first.slope_gain_1_per_m * u_K[0],
                last.slope_K_per_m + last.slope_gain_1_per_m * u_K[n - 1]};
  if (first.value_given) {
    const double out = faces_[0].out * u_K[0] - faces_[0].back * u_K[1];
    const double in = (half_widths(x_new_m, 0) * u_K[0] - old_content(0)) / dt + out;
    slopes.first_K_per_m = (through_first * u_K[0] - in) / alpha;
  }
  if (last.value_given) {
    const Face& face = faces_[n - 2];
    const double in = (face.out * u_K[n - 2] - face.back * u_K[n - 1]) / face.shift;
    const double out = in - (half_widths(x_new_m, n - 1) * u_K[n - 1] - old_content(n - 1)) / dt;
    slopes.last_K_per_m = (through_last * u_K[n - 1] - out) / alpha;
  }
  return slopes;
}

}  // namespace meltbench::plant
