#include "controller/estimator/melt_observer.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace meltbench::estimator {
namespace {

// Grading at 100 cells; other numbers refine all cells alike.
constexpr double kReferenceCells = 100.0;
constexpr double kEndCell = 0.15;  // In units of α/b.
constexpr double kGrowth = 1.3;
constexpr double kFastestFront = 0.95;  // Of b: ds/dt = b St/(1 + St) < b.
constexpr double kFastestRetreat = 3.0;
constexpr double kConductedSpeed_m_per_s = 5e-3;  // A front also moves while the screw stands, by conduction.
constexpr double kTripTravel = 0.5;               // Of s: half a flush.
constexpr double kMinFront_m = 1e-4;

/// Width of cell i before scaling to a sum of one: geometric from both ends up to the largest.
double calc_width(std::size_t i, std::size_t cells, double end_cell, double growth, double largest) {
  return std::min(largest, end_cell * std::pow(growth, static_cast<double>(std::min(i, cells - 1 - i))));
}

std::vector<double> make_nodes(std::size_t cells, double end_cell, double growth) {
  if (cells < 8) throw std::invalid_argument(fmt::format("melt observer: {} cells, must be at least 8", cells));
  const auto sum_for = [&](double largest, double g) {
    double sum = 0.0;
    for (std::size_t i = 0; i < cells; ++i) sum += calc_width(i, cells, end_cell, g, largest);
    return sum;
  };
  while (sum_for(1.0, growth) < 1.0) growth *= 1.01;
  double low = 0.0, high = 1.0;
  for (int i = 0; i < 100; ++i) {
    const double middle = 0.5 * (low + high);
    (sum_for(middle, growth) > 1.0 ? high : low) = middle;
  }
  const double sum = sum_for(low, growth);
  std::vector<double> nodes{0.0};
  for (std::size_t i = 0; i < cells; ++i)
    nodes.push_back(nodes.back() + calc_width(i, cells, end_cell, growth, low) / sum);
  nodes.back() = 1.0;
  return nodes;
}

/// Weights w with f^(order)(at) = Σ w_j f(x_j) for polynomials below x.size(); Fornberg (1988).
template <std::size_t kPoints>
std::array<double, kPoints> calc_weights(const std::array<double, kPoints>& x, double at, int order) {
  std::array<std::array<double, 3>, kPoints> c{};
  c[0][0] = 1.0;
  double product = 1.0;
  for (std::size_t i = 1; i < kPoints; ++i) {
    double next = 1.0;
    for (std::size_t j = 0; j < i; ++j) {
      const double d = x[i] - x[j];
      next *= d;
      if (j + 1 == i) {
        for (int m = 2; m >= 0; --m) {
          const auto k = static_cast<std::size_t>(m);
          c[i][k] = product * ((m > 0 ? m * c[i - 1][k - 1] : 0.0) - (x[i - 1] - at) * c[i - 1][k]) / next;
        }
      }
      for (int m = 2; m >= 0; --m) {
        const auto k = static_cast<std::size_t>(m);
        c[j][k] = ((x[i] - at) * c[j][k] - (m > 0 ? m * c[j][k - 1] : 0.0)) / d;
      }
    }
    product = next;
  }
  std::array<double, kPoints> weights;
  for (std::size_t j = 0; j < kPoints; ++j) weights[j] = c[j][static_cast<std::size_t>(order)];
  return weights;
}

/// A rule on the first nodes and on the slope at the inlet.
struct InletRule {
  std::array<double, 4> of_node{};
  double of_slope = 0.0;
};

/// Near the inlet the profile is T_0 + G x + x² r(x): a rule Σ w_j r(x_j) + w_G G becomes one on values and slope.
InletRule make_inlet_rule(std::span<const double> x, std::span<const double> of_r, double of_slope) {
  InletRule rule;
  rule.of_slope = of_slope;
  for (std::size_t j = 1; j <= of_r.size(); ++j) {
    const double w = of_r[j - 1] / (x[j] * x[j]);
    rule.of_node[j] += w;
    rule.of_node[0] -= w;
    rule.of_slope -= w * x[j];
  }
  return rule;
}

}  // namespace

MeltObserver::MeltObserver(const MeltObserverModel& model, const MeltObserverNumerics& numerics)
    : model_{model}, numerics_{numerics} {
  if (!(numerics.grid_speed_m_per_s > 0.0 && numerics.max_travel_m > 0.0 && numerics.max_step_s > 0.0)) {
    throw std::invalid_argument(fmt::format("melt observer: grid speed {} m/s, steps of {} m and {} s, must be > 0",
                                            numerics.grid_speed_m_per_s, numerics.max_travel_m, numerics.max_step_s));
  }
  const double coarseness = kReferenceCells / static_cast<double>(numerics.cells);
  const double layer_m = model.diffusivity_m2_per_s / numerics.grid_speed_m_per_s;
  const double end_cell = std::min(kEndCell * coarseness * layer_m / (0.5 * model.length_m), 0.5 / kReferenceCells);
  nodes_ = make_nodes(numerics.cells, end_cell, std::pow(kGrowth, coarseness));

  const std::size_t N = numerics.cells;
  const auto& x = nodes_;
  first_.assign(N, Row{});
  first_back_.assign(N, Row{});
  second_.assign(N, Row{});
  const auto set = [](Row& row, std::size_t i, std::size_t from, std::span<const double> weights) {
    for (std::size_t j = 0; j < weights.size(); ++j) row[from + j + 2 - i] = weights[j];
  };
  const auto take = [&](InletRule rule, std::vector<Row>& rows, std::array<double, 2>& of_slope, std::size_t i) {
    set(rows[i], i, 0, std::span{rule.of_node}.first(i == 0 ? 3 : 4));
    of_slope[i] = rule.of_slope;
  };
  const std::array<double, 2> x12{x[1], x[2]};
  const std::array<double, 3> x123{x[1], x[2], x[3]};
  // T''(0) = 2 r(0);  T'(x1) = G + 2 x1 r + x1² r';  T''(x1) = 2 r + 4 x1 r' + x1² r''.
  auto of_r2 = calc_weights(x12, 0.0, 0);
  for (double& w : of_r2) w *= 2.0;
  take(make_inlet_rule(x, of_r2, 0.0), second_, second_of_slope_, 0);
  of_r2 = calc_weights(x12, x[1], 1);
  for (double& w : of_r2) w *= x[1] * x[1];
  of_r2[0] += 2.0 * x[1];
  take(make_inlet_rule(x, of_r2, 1.0), first_, first_of_slope_, 1);
  auto of_r3 = calc_weights(x123, x[1], 2);
  const auto of_r3_first = calc_weights(x123, x[1], 1);
  for (std::size_t j = 0; j < 3; ++j) of_r3[j] = x[1] * x[1] * of_r3[j] + 4.0 * x[1] * of_r3_first[j];
  of_r3[0] += 2.0;
  take(make_inlet_rule(x, of_r3, 0.0), second_, second_of_slope_, 1);

  for (std::size_t i = 2; i < N; ++i) {
    const std::array<double, 4> upwind{x[i - 2], x[i - 1], x[i], x[i + 1]};
    set(first_[i], i, i - 2, calc_weights(upwind, x[i], 1));
    const std::size_t back = std::min(i - 1, N - 3);  // Row N-1 has no node beyond the front.
    const std::array<double, 4> downwind{x[back], x[back + 1], x[back + 2], x[back + 3]};
    set(first_back_[i], i, back, calc_weights(downwind, x[i], 1));
    if (i + 2 <= N) {
      const std::array<double, 5> around{x[i - 2], x[i - 1], x[i], x[i + 1], x[i + 2]};
      set(second_[i], i, i - 2, calc_weights(around, x[i], 2));
    } else {
      set(second_[i], i, i - 2, calc_weights(upwind, x[i], 2));
    }
  }
  const std::array<double, 6> last{x[N - 5], x[N - 4], x[N - 3], x[N - 2], x[N - 1], x[N]};
  front_slope_ = calc_weights(last, 1.0, 1);
  T_.assign(N + 1, model.T_melt_degC);
  near_.assign(N, 0.0);
  far_.assign(N, 0.0);
  start_linear(0.5 * model.length_m, model.T_melt_degC);
}

void MeltObserver::start_linear(double front_m, double T_inlet_degC) noexcept {
  for (std::size_t i = 0; i < T_.size(); ++i) T_[i] = T_inlet_degC + (model_.T_melt_degC - T_inlet_degC) * nodes_[i];
  front_m_ = std::clamp(front_m, kMinFront_m, model_.length_m);
  front_speed_m_per_s_ = 0.0;
  coasted_m_ = 0.0;
  status_ = MeltObserverStatus::kTracking;
}

void MeltObserver::start(double front_m, std::span<const double> T_degC) {
  if (T_degC.size() != T_.size()) {
    throw std::invalid_argument(fmt::format("melt observer: {} temperatures for {} nodes", T_degC.size(), T_.size()));
  }
  start_linear(front_m, model_.T_melt_degC);
  std::copy(T_degC.begin(), T_degC.end(), T_.begin());
  T_.back() = model_.T_melt_degC;
}

MeltObserverStatus MeltObserver::advance(double dt_s, const MeltObserverInput& input) noexcept {
  if (!(dt_s > 0.0)) return status_;
  const double b = input.speed_m_per_s;
  const double wanted = std::max({1.0, b * dt_s / numerics_.max_travel_m, dt_s / numerics_.max_step_s});
  const int steps = static_cast<int>(std::ceil(wanted - 1e-9));
  const double step_s = dt_s / steps;
  // A measured front is approached evenly over the sample, so mesh velocity and front agree in every step.
  const double measured_rate = input.front_m ? (*input.front_m - front_m_) / dt_s : 0.0;
  for (int i = 0; i < steps; ++i) {
    const double rate = input.front_m ? measured_rate : predict_front_speed_m_per_s(input);
    const double used =
        std::clamp(rate, -kFastestRetreat * b - kConductedSpeed_m_per_s, kFastestFront * b + kConductedSpeed_m_per_s);
    step(step_s, std::clamp(front_m_ + step_s * used, kMinFront_m, model_.length_m), input);
  }
  const bool fresh = input.front_m && input.T_inlet_degC;
  coasted_m_ = fresh ? 0.0 : coasted_m_ + b * dt_s;
  if (status_ != MeltObserverStatus::kTripped) {
    status_ = fresh ? MeltObserverStatus::kTracking : MeltObserverStatus::kCoasting;
    if (coasted_m_ > kTripTravel * front_m_) status_ = MeltObserverStatus::kTripped;
  }
  return status_;
}

double MeltObserver::calc_front_slope_K_per_m() const noexcept {
  double sum = 0.0;
  for (std::size_t j = 0; j < front_slope_.size(); ++j) sum += front_slope_[j] * T_[T_.size() - 6 + j];
  return sum / front_m_;
}

/// (5) solved for ds/dt. The slope belongs to the layer in front of a moving boundary: T_x = g (b - ds/dt), so
/// ds/dt = β (k_s g (b - ds/dt) - K); inserting the last speed on the right instead would oscillate for k_s g β > 1.
double MeltObserver::predict_front_speed_m_per_s(const MeltObserverInput& input) const noexcept {
  const double b = input.speed_m_per_s;
  const double relative = b - front_speed_m_per_s_;
  if (!(relative > 0.01 * b)) return front_speed_m_per_s_;
  const double beta = model_.front_speed_per_flux_m3_per_J;
  const double stefan = beta * model_.conductivity_W_per_mK * calc_front_slope_K_per_m() / relative;
  if (!(stefan > -0.9)) return -kFastestRetreat * b;
  return (stefan * b - beta * input.liquid_front_flux_W_per_m2) / (1.0 + stefan);
}

/// One implicit Euler step of (28)-(30). Rows are eliminated from both ends towards the middle as they are assembled:
/// two chains of divisions side by side. The eliminated right side replaces T_.
void MeltObserver::step(double dt_s, double front_new_m, const MeltObserverInput& input) noexcept {
  const std::size_t N = T_.size() - 1;
  const double s = front_new_m;
  const double speed = (front_new_m - front_m_) / dt_s;
  const double k_s = model_.conductivity_W_per_mK;
  const double alpha = model_.diffusivity_m2_per_s;
  const double diffusion = -dt_s * alpha / (s * s);
  const double exchange = dt_s * model_.exchange_rate_1_per_s;
  const double advection_at_inlet = dt_s * input.speed_m_per_s / s;
  const double stretching = -dt_s * speed / s;
  // (29) as That_x(0) = known + gain That(0); without Y2 there is nothing to inject.
  const double gain = input.T_inlet_degC ? input.speed_m_per_s / (2.0 * alpha) : 0.0;
  const double known = -input.inlet_flux_W_per_m2 / k_s - gain * input.T_inlet_degC.value_or(0.0);

  struct Equation {
    Row of;
    double y;
  };
  const auto assemble = [&](std::size_t i) {
    Equation row;
    const double advection = advection_at_inlet + stretching * nodes_[i];
    const Row& first = advection >= 0.0 || i < 2 ? first_[i] : first_back_[i];
    for (std::size_t k = 0; k < 5; ++k) row.of[k] = diffusion * second_[i][k] + advection * first[k];
    row.of[2] += 1.0 + exchange;
    row.y = T_[i] + exchange * input.T_barrel_degC;
    if (i < 2) {  // Row 0: That_x(0) itself is the advected slope.
      const double of_slope = i == 0 ? s * diffusion * second_of_slope_[0] + s * advection
                                     : s * (diffusion * second_of_slope_[1] + advection * first_of_slope_[1]);
      row.of[2 - i] += of_slope * gain;
      row.y -= of_slope * known;
    }
    if (i + 2 >= N) {  // The front is known: to the right side.
      double& of_front = row.of[2 + N - i];
      row.y -= of_front * model_.T_melt_degC;
      of_front = 0.0;
    }
    return row;
  };
  struct Reduced {  // T = y - near T_next - far T_after_next, counted towards the middle.
    double near = 0.0, far = 0.0, y = 0.0;
  };
  const auto reduce = [](double outer2, double outer1, double centre, double inner1, double inner2, double y,
                         const Reduced& last, const Reduced& last_but_one) {
    const double outer = outer1 - outer2 * last_but_one.near;
    const double pivot = 1.0 / (centre - outer2 * last_but_one.far - outer * last.near);
    return Reduced{(inner1 - outer * last.far) * pivot, inner2 * pivot,
                   (y - outer2 * last_but_one.y - outer * last.y) * pivot};
  };
  Reduced down, down_before, up, up_before;
  const auto store = [&](std::size_t i, const Reduced& row) {
    near_[i] = row.near;
    far_[i] = row.far;
    T_[i] = row.y;
  };
  const std::size_t below = (N - 2) / 2;
  const std::size_t middle = N - 2 - below;
  for (std::size_t k = 0; k < middle; ++k) {
    const Equation top = assemble(k);
    const Reduced next = reduce(top.of[0], top.of[1], top.of[2], top.of[3], top.of[4], top.y, down, down_before);
    down_before = down;
    store(k, down = next);
    if (k >= below) break;
    const std::size_t j = N - 1 - k;
    const Equation end = assemble(j);
    const Reduced previous = reduce(end.of[4], end.of[3], end.of[2], end.of[1], end.of[0], end.y, up, up_before);
    up_before = up;
    store(j, up = previous);
  }

  // Two rows are left, for That at `middle` and the node after it.
  const Equation first_left = assemble(middle), second_left = assemble(middle + 1);
  const double outer_1 = first_left.of[1] - first_left.of[0] * down_before.near;
  const double outer_2 = second_left.of[3] - second_left.of[4] * up_before.near;
  const double a11 =
      first_left.of[2] - first_left.of[0] * down_before.far - outer_1 * down.near - first_left.of[4] * up.far;
  const double a12 = first_left.of[3] - outer_1 * down.far - first_left.of[4] * up.near;
  const double a21 = second_left.of[1] - outer_2 * up.far - second_left.of[0] * down.near;
  const double a22 =
      second_left.of[2] - second_left.of[4] * up_before.far - outer_2 * up.near - second_left.of[0] * down.far;
  const double y1 = first_left.y - first_left.of[0] * down_before.y - outer_1 * down.y - first_left.of[4] * up.y;
  const double y2 = second_left.y - second_left.of[4] * up_before.y - outer_2 * up.y - second_left.of[0] * down.y;
  const double determinant = a11 * a22 - a12 * a21;
  T_[middle] = (y1 * a22 - a12 * y2) / determinant;
  T_[middle + 1] = (a11 * y2 - a21 * y1) / determinant;

  for (std::size_t i = middle; i-- > 0;) T_[i] -= near_[i] * T_[i + 1] + far_[i] * T_[i + 2];
  for (std::size_t i = middle + 2; i < N; ++i) T_[i] -= near_[i] * T_[i - 1] + far_[i] * T_[i - 2];
  front_m_ = s;
  front_speed_m_per_s_ = speed;
}

}  // namespace meltbench::estimator
