#pragma once
/// Grids and finite-difference weights of the melt model. Used at construction only: these functions allocate.

#include <cstddef>
#include <span>
#include <vector>

namespace meltbench::plant {

/// Nodes from 0 to 1 whose cells grow geometrically from both ends towards a common largest width.
/// @param cells     number of cells, >= 8.
/// @param end_cell  width of the first and the last cell as a fraction of the whole, in (0, 1).
/// @param growth    width of a cell over that of its outer neighbour, > 1; raised where so few cells do not reach.
/// @returns cells + 1 nodes, the first exactly 0, the last exactly 1.
/// @throws  std::invalid_argument naming the value that is out of range.
[[nodiscard]] std::vector<double> make_graded_nodes(std::size_t cells, double end_cell, double growth);

/// `cells` equal cells from 0 to 1. @throws std::invalid_argument if cells < 8.
[[nodiscard]] std::vector<double> make_uniform_nodes(std::size_t cells);

/// Weights w with Σ w_j f(points_j) = f^(derivative)(at), exact for polynomials below points.size();
/// with slope_at_first, one more weight follows, that of f'(points_0), and the rule is exact one degree higher.
[[nodiscard]] std::vector<double> calc_difference_weights(std::span<const double> points, double at, int derivative,
                                                          bool slope_at_first = false);

/// Weights with Σ w_i f(nodes_i) = ∫ f over the nodes, from the cubic through the four nodes around each cell.
[[nodiscard]] std::vector<double> calc_quadrature_weights(std::span<const double> nodes);

}  // namespace meltbench::plant
