#include <algorithm>
#include <array>
#include <utility>

#include "plant_emulator/model/melt_grid.hpp"
#include "plant_emulator/model/melt_solid.hpp"

namespace meltbench::plant {
namespace {

constexpr std::size_t kSlopePoints = 6;

/// Weights of the five nodes i-2 ... i+2 for every row i, stored column by column so that assembly vectorises.
using Band = std::array<std::vector<double>, 5>;

Band make_band(std::size_t rows) {
  Band band;
  for (auto& column : band) column.assign(rows, 0.0);
  return band;
}

class ThirdOrderSolid final : public MeltSolid {
 public:
  ThirdOrderSolid(const MeltParameters& parameters, std::vector<double> nodes);

 private:
  double solve(const MeltPhaseStep& step, double drive_W_per_m2, double gain_W_per_m2K) noexcept override;
  void assemble(const MeltPhaseStep& step, double drive_W_per_m2, double gain_W_per_m2K) noexcept;
  void eliminate_and_substitute() noexcept;

  std::size_t rows_;  // Unknown nodes 0 ... N-1; node N is the front.
  Band first_;        // d/dξ, biased to the inlet: i-2 ... i+1.
  Band first_back_;   // d/dξ, biased to the front: i-1 ... i+2, for where the mesh outruns the granules.
  Band second_;       // d²/dξ²: i-2 ... i+2 where these exist.
  std::array<double, 2> first_of_slope_{};  // Weight of T_ξ(0) in rows 0 and 1.
  std::array<double, 2> second_of_slope_{};
  std::vector<double> front_slope_weights_;
  Band matrix_;
  std::vector<double> right_side_;
};

ThirdOrderSolid::ThirdOrderSolid(const MeltParameters& parameters, std::vector<double> nodes)
    : MeltSolid{parameters, std::move(nodes)},
      rows_{nodes_.size() - 1},
      first_{make_band(rows_)},
      first_back_{make_band(rows_)},
      second_{make_band(rows_)},
      matrix_{make_band(rows_)},
      right_side_(rows_) {
  const std::span<const double> xi = nodes_;
  const std::size_t N = rows_;
  const auto fill = [](Band& band, std::size_t row, std::size_t first_node, const std::vector<double>& weights,
                       std::size_t count) {
    for (std::size_t j = 0; j < count; ++j) band[first_node + j + 2 - row][row] = weights[j];
  };
  // Rows 0 and 1 know the slope at the inlet as one more datum; row 0 needs no first derivative: it is the datum.
  const auto inlet_second = calc_difference_weights(xi.subspan(0, 3), xi[0], 2, true);
  fill(second_, 0, 0, inlet_second, 3);
  second_of_slope_[0] = inlet_second[3];
  const auto first_at_1 = calc_difference_weights(xi.subspan(0, 3), xi[1], 1, true);
  const auto second_at_1 = calc_difference_weights(xi.subspan(0, 4), xi[1], 2, true);
  fill(first_, 1, 0, first_at_1, 3);
  fill(second_, 1, 0, second_at_1, 4);
  first_of_slope_[1] = first_at_1[3];
  second_of_slope_[1] = second_at_1[4];
  for (std::size_t i = 2; i < N; ++i) {
    fill(first_, i, i - 2, calc_difference_weights(xi.subspan(i - 2, 4), xi[i], 1), 4);
    const std::size_t width = std::min<std::size_t>(5, N + 1 - (i - 2));
    const std::size_t back = std::min(i - 1, N - 3);  // Row N-1 has no node beyond the front.
    fill(first_back_, i, back, calc_difference_weights(xi.subspan(back, 4), xi[i], 1), 4);
    fill(second_, i, i - 2, calc_difference_weights(xi.subspan(i - 2, width), xi[i], 2), width);
  }
  front_slope_weights_ = calc_difference_weights(xi.subspan(N + 1 - kSlopePoints), 1.0, 1);
}

double ThirdOrderSolid::solve(const MeltPhaseStep& step, double drive_W_per_m2, double gain_W_per_m2K) noexcept {
  assemble(step, drive_W_per_m2, gain_W_per_m2K);
  eliminate_and_substitute();
  trial_[rows_] = parameters_.T_melt_degC;
  double slope = 0.0;
  for (std::size_t j = 0; j < kSlopePoints; ++j) {
    slope += front_slope_weights_[j] * trial_[rows_ + 1 - kSlopePoints + j];
  }
  return slope / step.front_new_m;
}

/// Rows of  T - dt (α/s² T_ξξ - (b - ξ ds/dt)/s T_ξ + h (T_b - T)) = T_old  with everything but T_old at the new time.
void ThirdOrderSolid::assemble(const MeltPhaseStep& step, double drive_W_per_m2, double gain_W_per_m2K) noexcept {
  const std::size_t N = rows_;
  const double s = step.front_new_m;
  const double k_s = parameters_.solid.conductivity_W_per_mK;
  const double diffusion = -step.dt_s * parameters_.solid.diffusivity_m2_per_s() / (s * s);
  const double exchange = step.dt_s * parameters_.solid.exchange_rate_1_per_s();
  const double advection = step.dt_s * step.speed_m_per_s / s;
  const double stretching = -step.dt_s * step.front_speed_m_per_s / s;
  const double* xi = nodes_.data();
  // b - ξ ds/dt changes its sign at most once, and only after the screw has slowed faster than the front can.
  std::size_t turn = N;
  if (advection + stretching < 0.0) {
    turn = 2;
    while (turn < N && advection + stretching * xi[turn] >= 0.0) ++turn;
  }
  for (std::size_t k = 0; k < 5; ++k) {
    const double* first = first_[k].data();
    const double* first_back = first_back_[k].data();
    const double* second = second_[k].data();
    double* matrix = matrix_[k].data();
    for (std::size_t i = 0; i < turn; ++i) {
      matrix[i] = diffusion * second[i] + (advection + stretching * xi[i]) * first[i];
    }
    for (std::size_t i = turn; i < N; ++i) {
      matrix[i] = diffusion * second[i] + (advection + stretching * xi[i]) * first_back[i];
    }
  }
  for (std::size_t i = 0; i < N; ++i) matrix_[2][i] += 1.0 + exchange;
  if (step.barrel.zone_count == 1) {
    const double source = exchange * step.barrel.T_zone_degC[0];
    for (std::size_t i = 0; i < N; ++i) right_side_[i] = T_[i] + source;
  } else {
    const double s_over_L = s / parameters_.length_m;
    for (std::size_t i = 0; i < N; ++i) right_side_[i] = T_[i] + exchange * step.barrel.T_degC(xi[i] * s_over_L);
  }

  // Inlet slope T_ξ(0) = s G with G = (gain T_0 - drive)/k_s: its T_0 part joins the matrix, the rest the right side.
  const std::array<double, 2> of_slope{
      diffusion * second_of_slope_[0] * s + step.dt_s * step.speed_m_per_s,
      (diffusion * second_of_slope_[1] + (advection + stretching * xi[1]) * first_of_slope_[1]) * s};
  matrix_[2][0] += of_slope[0] * gain_W_per_m2K / k_s;
  matrix_[1][1] += of_slope[1] * gain_W_per_m2K / k_s;
  right_side_[0] += of_slope[0] * drive_W_per_m2 / k_s;
  right_side_[1] += of_slope[1] * drive_W_per_m2 / k_s;

  right_side_[N - 1] -= matrix_[3][N - 1] * parameters_.T_melt_degC;
  right_side_[N - 2] -= matrix_[4][N - 2] * parameters_.T_melt_degC;
  matrix_[3][N - 1] = matrix_[4][N - 1] = matrix_[4][N - 2] = 0.0;
}

/// Gaussian elimination from both ends towards the middle, where two unknowns meet: two chains of dependent divisions
/// run side by side, which halves the time of one. No pivoting: end cells are dominated by diffusion, others by 1/dt.
void ThirdOrderSolid::eliminate_and_substitute() noexcept {
  const std::size_t N = rows_;
  const std::size_t below = (N - 2) / 2;    // Rows eliminated upwards: N - below ... N - 1.
  const std::size_t above = N - 2 - below;  // Rows eliminated downwards: 0 ... above - 1.
  const double* lower2 = matrix_[0].data();
  const double* lower1 = matrix_[1].data();
  const double* diagonal = matrix_[2].data();
  double* upper1 = matrix_[3].data();
  double* upper2 = matrix_[4].data();
  double* y = right_side_.data();

  struct Row {  // T = y - first T_next - second T_after_next, counted towards the middle.
    double first, second, y;
  };
  const auto combine = [](double far, double near, double centre, double next, double after, double right,
                          const Row& before, const Row& before_that) {
    const double reduced = near - far * before_that.first;
    const double pivot = 1.0 / (centre - far * before_that.second - reduced * before.first);
    return Row{(next - reduced * before.second) * pivot, after * pivot,
               (right - far * before_that.y - reduced * before.y) * pivot};
  };
  Row down{0.0, 0.0, 0.0}, down_before = down, up = down, up_before = down;
  const auto eliminate_down = [&](std::size_t i) {
    const Row row = combine(lower2[i], lower1[i], diagonal[i], upper1[i], upper2[i], y[i], down, down_before);
    upper1[i] = row.first;
    upper2[i] = row.second;
    y[i] = row.y;
    down_before = down;
    down = row;
  };
  const auto eliminate_up = [&](std::size_t i) {
    const Row row = combine(upper2[i], upper1[i], diagonal[i], lower1[i], lower2[i], y[i], up, up_before);
    upper1[i] = row.first;
    upper2[i] = row.second;
    y[i] = row.y;
    up_before = up;
    up = row;
  };
  for (std::size_t k = 0; k < below; ++k) {
    eliminate_down(k);
    eliminate_up(N - 1 - k);
  }
  if (above > below) eliminate_down(below);

  // Rows m and m + 1, with T_{m-1}, T_{m-2} and T_{m+2}, T_{m+3} expressed by T_m and T_{m+1}.
  const std::size_t m = above;
  const double near_m = lower1[m] - lower2[m] * down_before.first;
  const double a11 = diagonal[m] - lower2[m] * down_before.second - near_m * down.first - upper2[m] * up.second;
  const double a12 = upper1[m] - near_m * down.second - upper2[m] * up.first;
  const double r1 = y[m] - lower2[m] * down_before.y - near_m * down.y - upper2[m] * up.y;
  const double near_n = upper1[m + 1] - upper2[m + 1] * up_before.first;
  const double a22 =
      diagonal[m + 1] - upper2[m + 1] * up_before.second - near_n * up.first - lower2[m + 1] * down.second;
  const double a21 = lower1[m + 1] - near_n * up.second - lower2[m + 1] * down.first;
  const double r2 = y[m + 1] - upper2[m + 1] * up_before.y - near_n * up.y - lower2[m + 1] * down.y;
  const double determinant = a11 * a22 - a12 * a21;
  trial_[m] = (r1 * a22 - a12 * r2) / determinant;
  trial_[m + 1] = (a11 * r2 - a21 * r1) / determinant;

  double left1 = trial_[m], left2 = trial_[m + 1], right1 = left2, right2 = left1;
  for (std::size_t k = 0; k < above; ++k) {
    const std::size_t i = m - 1 - k;
    const double T_left = y[i] - upper1[i] * left1 - upper2[i] * left2;
    trial_[i] = T_left;
    left2 = left1;
    left1 = T_left;
    if (k >= below) break;
    const std::size_t j = m + 2 + k;
    const double T_right = y[j] - upper1[j] * right1 - upper2[j] * right2;
    trial_[j] = T_right;
    right2 = right1;
    right1 = T_right;
  }
}

}  // namespace

std::unique_ptr<MeltSolid> make_third_order_solid(const MeltParameters& parameters, std::vector<double> nodes) {
  return std::make_unique<ThirdOrderSolid>(parameters, std::move(nodes));
}

}  // namespace meltbench::plant
