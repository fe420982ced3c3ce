#include "plant_emulator/model/melt_scharfetter_gummel.hpp"

#include <algorithm>
#include <cmath>

namespace meltbench::plant {
namespace {

/// A slow screw makes μ = √(h/α) so large that e^{μx} is no profile any more within one cell of some millimetres.
constexpr double kSteepestWeight_1_per_m = 50.0;

/// Bernoulli function P/(e^P - 1); its series where the quotient loses digits.
double bernoulli(double P) {
  if (P > 50.0) return 0.0;  // 1e-20: nothing comes back against the stream.
  if (std::abs(P) < 1e-3) return 1.0 - 0.5 * P + P * P / 12.0;
  return P / (std::exp(P) - 1.0);
}

/// e^z; the series saves half the step's exponentials, as most cells are short against 1/μ.
double exp_of_short(double z) {
  if (std::abs(z) > 0.01) return std::exp(z);
  return 1.0 + z * (1.0 + z * (1.0 / 2 + z * (1.0 / 6 + z * (1.0 / 24 + z * (1.0 / 120)))));
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
  const double b = c.speed_m_per_s;
  const double mu = std::min(2.0 * h / (b + std::sqrt(b * b + 4.0 * alpha * h)), kSteepestWeight_1_per_m);
  const double S = b + 2.0 * alpha * mu;
  const double sink = h - (alpha * mu + b) * mu;  // What a limited μ leaves of h; else zero but for rounding.
  const double dt = c.dt_s;
  const auto moved = [&](std::size_t i) { return x_new_m[i] - x_old_m[i]; };
  // Flux of θ through an end that moves with speed w: (S - w - αμ) u - α u_x.
  const double through_first = S - moved(0) / dt - alpha * mu;
  const double through_last = S - moved(n - 1) / dt - alpha * mu;

  // Elimination from first to last; a cell's width and the flux at its left face come from the cell before.
  double half_old = 0.0, half_new = 0.0;
  Face left{0.0, 0.0, 1.0};
  double content_first = 0.0, content_last = 0.0, volume_first = 0.0, volume_last = 0.0;
  double upper_before = 0.0, y_before = 0.0;
  for (std::size_t i = 0; i < n; ++i) {
    double volume_old = half_old, volume = half_new;
    Face right{0.0, 0.0, 1.0};
    if (i + 1 < n) {
      const double dx = x_new_m[i + 1] - x_new_m[i];
      half_old = 0.5 * (x_old_m[i + 1] - x_old_m[i]);
      half_new = 0.5 * dx;
      volume_old += half_old;
      volume += half_new;
      const double P = (S - 0.5 * (moved(i) + moved(i + 1)) / dt) * dx / alpha;
      const double B = bernoulli(P);
      const double shift = exp_of_short(mu * dx);
      right = faces_[i] = {alpha / dx * (B + P), alpha / dx * B * shift, shift};
    }
    double content = volume_old * u_old_K[i] * exp_of_short(-mu * moved(i));
    if (!offset_K.empty()) content -= dt * h * offset_K[i] * volume;

    const double per_shift = dt / left.shift;
    double lower = -per_shift * left.out;
    double diagonal = volume * (1.0 + dt * sink) + per_shift * left.back + dt * right.out;
    double upper = -dt * right.back;
    double y = content;
    if (i == 0) {
      content_first = content;
      volume_first = volume;
      diagonal -= dt * (through_first - alpha * first.slope_gain_1_per_m);
      y -= dt * alpha * first.slope_K_per_m;
    }
    if (i + 1 == n) {
      content_last = content;
      volume_last = volume;
      diagonal += dt * (through_last - alpha * last.slope_gain_1_per_m);
      y += dt * alpha * last.slope_K_per_m;
    }
    const End* given = i == 0 && first.value_given ? &first : i + 1 == n && last.value_given ? &last : nullptr;
    if (given != nullptr) {
      lower = upper = 0.0;
      diagonal = 1.0;
      y = given->u_K;
    }
    const double pivot = 1.0 / (diagonal - lower * upper_before);
    upper_[i] = upper_before = upper * pivot;
    right_side_[i] = y_before = (y - lower * y_before) * pivot;
    left = right;
  }
  u_K[n - 1] = right_side_[n - 1];
  for (std::size_t i = n - 1; i-- > 0;) u_K[i] = right_side_[i] - upper_[i] * u_K[i + 1];

  Slopes slopes{first.slope_K_per_m + first.slope_gain_1_per_m * u_K[0],
                last.slope_K_per_m + last.slope_gain_1_per_m * u_K[n - 1]};
  if (first.value_given) {
    const double out = faces_[0].out * u_K[0] - faces_[0].back * u_K[1];
    const double in = (volume_first * (1.0 + dt * sink) * u_K[0] - content_first) / dt + out;
    slopes.first_K_per_m = (through_first * u_K[0] - in) / alpha;
  }
  if (last.value_given) {
    const Face& face = faces_[n - 2];
    const double in = (face.out * u_K[n - 2] - face.back * u_K[n - 1]) / face.shift;
    const double out = in - (volume_last * (1.0 + dt * sink) * u_K[n - 1] - content_last) / dt;
    slopes.last_K_per_m = (through_last * u_K[n - 1] - out) / alpha;
  }
  return slopes;
}

}  // namespace meltbench::plant
