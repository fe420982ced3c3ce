#include "plant_emulator/model/melt_grid.hpp"

#include <fmt/format.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace meltbench::plant {
namespace {

double sum_of_widths(std::vector<double>& widths, double end_cell, double growth, double largest) {
  const std::size_t n = widths.size();
  double sum = 0.0;
  for (std::size_t i = 0; i < n; ++i) {
    const auto from_end = static_cast<double>(std::min(i, n - 1 - i));
    widths[i] = std::min(end_cell * std::pow(growth, from_end), largest);
    sum += widths[i];
  }
  return sum;
}

/// Root of an increasing function by bisection.
template <typename Function>
double bisect(double low, double high, Function is_too_large) {
  for (int i = 0; i < 200; ++i) {
    const double middle = 0.5 * (low + high);
    (is_too_large(middle) ? high : low) = middle;
  }
  return 0.5 * (low + high);
}

}  // namespace

std::vector<double> make_graded_nodes(std::size_t cells, double end_cell, double growth) {
  if (cells < 8) throw std::invalid_argument(fmt::format("melt grid: {} cells, must be at least 8", cells));
  if (!(end_cell > 0.0 && end_cell < 1.0)) {
    throw std::invalid_argument(fmt::format("melt grid: end cell = {} of the length, must be in (0, 1)", end_cell));
  }
  if (!(growth > 1.0)) throw std::invalid_argument(fmt::format("melt grid: growth = {}, must be > 1", growth));
  const double end = std::min(end_cell, 1.0 / static_cast<double>(cells));

  std::vector<double> widths(cells);
  if (sum_of_widths(widths, end, growth, 1.0) < 1.0) {
    growth = bisect(growth, 1e6, [&](double g) { return sum_of_widths(widths, end, g, 1.0) > 1.0; });
  }
  const double largest = bisect(0.0, 1.0, [&](double w) { return sum_of_widths(widths, end, growth, w) > 1.0; });
  const double sum = sum_of_widths(widths, end, growth, largest);

  std::vector<double> nodes(cells + 1, 0.0);
  for (std::size_t i = 0; i < cells; ++i) nodes[i + 1] = nodes[i] + widths[i] / sum;
  nodes.back() = 1.0;
  return nodes;
}

std::vector<double> make_uniform_nodes(std::size_t cells) {
  if (cells < 8) throw std::invalid_argument(fmt::format("melt grid: {} cells, must be at least 8", cells));
  std::vector<double> nodes(cells + 1);
  for (std::size_t i = 0; i <= cells; ++i) nodes[i] = static_cast<double>(i) / static_cast<double>(cells);
  return nodes;
}

std::vector<double> calc_difference_weights(std::span<const double> points, double at, int derivative,
                                            bool slope_at_first) {
  // Moments of the monomials of z = (x - at)/scale; the scale keeps the system well conditioned on graded nodes.
  double scale = 0.0;
  for (const double x : points) scale = std::max(scale, std::abs(x - at));
  const auto values = static_cast<Eigen::Index>(points.size());
  const Eigen::Index n = values + (slope_at_first ? 1 : 0);
  Eigen::MatrixXd moments(n, n);
  for (Eigen::Index row = 0; row < n; ++row) {
    for (Eigen::Index j = 0; j < values; ++j) {
      moments(row, j) = std::pow((points[static_cast<std::size_t>(j)] - at) / scale, static_cast<double>(row));
    }
    if (slope_at_first) {
      const double z = (points[0] - at) / scale;
      const double power = static_cast<double>(row);
      moments(row, values) = row == 0 ? 0.0 : power * std::pow(z, power - 1.0) / scale;
    }
  }
  Eigen::VectorXd wanted = Eigen::VectorXd::Zero(n);
  wanted(derivative) = std::tgamma(derivative + 1.0) / std::pow(scale, derivative);
  const Eigen::VectorXd weights = moments.fullPivLu().solve(wanted);
  return {weights.data(), weights.data() + n};
}

std::vector<double> calc_quadrature_weights(std::span<const double> nodes) {
  const std::size_t count = nodes.size();
  std::vector<double> weights(count, 0.0);
  for (std::size_t cell = 0; cell + 1 < count; ++cell) {
    const std::size_t first = std::min(cell == 0 ? 0 : cell - 1, count - 4);
    const double origin = nodes[cell];
    const double width = nodes[cell + 1] - nodes[cell];
    Eigen::Matrix4d moments;
    Eigen::Vector4d integrals;
    for (Eigen::Index power = 0; power < 4; ++power) {
      for (Eigen::Index j = 0; j < 4; ++j) {
        const double z = (nodes[first + static_cast<std::size_t>(j)] - origin) / width;
        moments(power, j) = std::pow(z, static_cast<double>(power));
      }
      integrals(power) = width / static_cast<double>(power + 1);
    }
    const Eigen::Vector4d share = moments.fullPivLu().solve(integrals);
    for (Eigen::Index j = 0; j < 4; ++j) weights[first + static_cast<std::size_t>(j)] += share(j);
  }
  return weights;
}

}  // namespace meltbench::plant
