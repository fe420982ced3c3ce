#include "plant_emulator/model/melt_grid.hpp"

#include <catch2/catch.hpp>
#include <cmath>
#include <stdexcept>

namespace meltbench::plant {
namespace {

TEST_CASE("Melt grid: graded nodes rise from 0 to 1 with the wanted end cells and growth", "[plant][melt]") {
  const double end_cell = 1.2e-5;
  const double growth = 1.3;
  const auto nodes = make_graded_nodes(100, end_cell, growth);
  REQUIRE(nodes.size() == 101);
  CHECK(nodes.front() == 0.0);
  CHECK(nodes.back() == 1.0);
  CHECK(nodes[1] == Approx(end_cell).epsilon(1e-9));
  CHECK(1.0 - nodes[99] == Approx(end_cell).epsilon(1e-9));
  for (std::size_t i = 1; i + 1 < nodes.size(); ++i) {
    const double left = nodes[i] - nodes[i - 1], right = nodes[i + 1] - nodes[i];
    CHECK(left > 0.0);
    CHECK(std::max(left / right, right / left) < growth * (1.0 + 1e-9));
  }
}

TEST_CASE("Melt grid: too few cells for the growth are stretched further rather than refused", "[plant][melt]") {
  const auto nodes = make_graded_nodes(12, 1e-6, 1.3);
  REQUIRE(nodes.size() == 13);
  CHECK(nodes[1] == Approx(1e-6).epsilon(1e-6));
  CHECK(nodes.back() == 1.0);
}

TEST_CASE("Melt grid: nonsense is refused by name and value", "[plant][melt]") {
  CHECK_THROWS_WITH(make_graded_nodes(4, 0.01, 1.3), Catch::Matchers::Contains("4 cells"));
  CHECK_THROWS_WITH(make_graded_nodes(100, 0.0, 1.3), Catch::Matchers::Contains("end cell = 0"));
  CHECK_THROWS_WITH(make_graded_nodes(100, 0.01, 1.0), Catch::Matchers::Contains("growth = 1"));
}

TEST_CASE("Melt grid: difference weights are exact for polynomials on uneven nodes", "[plant][melt]") {
  const std::vector<double> x{0.0, 1e-5, 3e-5, 7e-5, 1.5e-4};
  const auto cubic = [](double t) { return 2.0 - 3e3 * t + 4e8 * t * t - 5e12 * t * t * t; };
  const auto slope = [](double t) { return -3e3 + 8e8 * t - 15e12 * t * t; };
  const auto curvature = [](double t) { return 8e8 - 30e12 * t; };
  const auto apply = [&](const std::vector<double>& w) {
    double sum = 0.0;
    for (std::size_t j = 0; j < x.size(); ++j) sum += w[j] * cubic(x[j]);
    return w.size() > x.size() ? sum + w.back() * slope(0.0) : sum;
  };
  CHECK(apply(calc_difference_weights(x, x[2], 1)) == Approx(slope(x[2])).epsilon(1e-9));
  CHECK(apply(calc_difference_weights(x, x[2], 2)) == Approx(curvature(x[2])).epsilon(1e-9));
  CHECK(apply(calc_difference_weights(x, x[0], 2, true)) == Approx(curvature(0.0)).epsilon(1e-9));
  CHECK(apply(calc_difference_weights(x, x[1], 1, true)) == Approx(slope(x[1])).epsilon(1e-9));
}

TEST_CASE("Melt grid: quadrature weights integrate cubics exactly", "[plant][melt]") {
  const auto nodes = make_graded_nodes(20, 1e-3, 1.4);
  const auto weights = calc_quadrature_weights(nodes);
  double sum = 0.0;
  for (std::size_t i = 0; i < nodes.size(); ++i) sum += weights[i] * std::pow(nodes[i], 3);
  CHECK(sum == Approx(0.25).epsilon(1e-12));
}

}  // namespace
}  // namespace meltbench::plant
