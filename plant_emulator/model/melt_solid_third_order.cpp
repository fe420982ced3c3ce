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

  std::size_t rows_;                        // Unknown nodes 0 ... N-1; node N is the front.
  Band first_;                              // d/dξ, upwind-biased: i-2 ... i+1.
  Band second_;                             // d²/dξ²: i-2 ... i+2 where these exist.
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
  for (std::size_t k = 0; k < 5; ++k) {
    const double* first = first_[k].data();
    const double* second = second_[k].data();
    double* matrix = matrix_[k].data();
    for (std::size_t i = 0; i < N; ++i) {
      matrix[i] = diffusion * second[i] + (advection + stretching * xi[i]) * first[i];
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
}

/// Gaussian elimination without pivoting: end cells are dominated by diffusion, the others by 1/dt.
void ThirdOrderSolid::eliminate_and_substitute() noexcept {
  const std::size_t N = rows_;
  double* upper1 = matrix_[3].data();
  double* upper2 = matrix_[4].data();
  double* y = right_side_.data();
  double u1_1 = 0.0, u2_1 = 0.0, y_1 = 0.0;  // Scaled row i-1.
  double u1_2 = 0.0, u2_2 = 0.0, y_2 = 0.0;  // Scaled row i-2.
  for (std::size_t i = 0; i < N; ++i) {
    const double lower2 = matrix_[0][i];
    const double lower1 = matrix_[1][i] - lower2 * u1_2;
    const double pivot = 1.0 / (matrix_[2][i] - lower2 * u2_2 - lower1 * u1_1);
    const double u1 = (upper1[i] - lower1 * u2_1) * pivot;
    const double u2 = upper2[i] * pivot;
    const double yi = (y[i] - lower2 * y_2 - lower1 * y_1) * pivot;
    upper1[i] = u1;
    upper2[i] = u2;
    y[i] = yi;
    u1_2 = u1_1, u2_2 = u2_1, y_2 = y_1;
    u1_1 = u1, u2_1 = u2, y_1 = yi;
  }
  double after1 = 0.0, after2 = 0.0;
  for (std::size_t i = N; i-- > 0;) {
    const double T = y[i] - (i + 1 < N ? upper1[i] * after1 : 0.0) - (i + 2 < N ? upper2[i] * after2 : 0.0);
    trial_[i] = T;
    after2 = after1;
    after1 = T;
  }
}

}  // namespace

std::unique_ptr<MeltSolid> make_third_order_solid(const MeltParameters& parameters, std::vector<double> nodes) {
  return std::make_unique<ThirdOrderSolid>(parameters, std::move(nodes));
}

}  // namespace meltbench::plant
