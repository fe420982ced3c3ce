#pragma once
/// Conservative implicit step of one phase by exponentially fitted fluxes.

#include <cstddef>
#include <span>
#include <vector>

namespace meltbench::plant {

/// Advection, diffusion and exchange of u = T_b - T on a moving grid:
///
///   u_t = α u_xx - b u_x - h u;   θ = u e^{μx},  μ = 2h/(b + S),  S = sqrt(b² + 4 α h)   =>   θ_t + (S θ - α θ_x)_x = 0
///
/// Each cell face carries the exact flux of the steady problem between its two nodes, with the speed S - w relative to
/// the face's own speed w. θ is kept relative to each node, so no exponential grows. Band (1,1), M-matrix.
class ScharfetterGummelStep {
 public:
  struct Coefficients {
    double diffusivity_m2_per_s;
    double exchange_rate_1_per_s;
    double speed_m_per_s;
    double dt_s;
  };

  explicit ScharfetterGummelStep(std::size_t node_count);

  /// Computes volumes, fluxes and matrix for nodes that move from x_old to x_new in dt, linearly. Ends are faces.
  void assemble(const Coefficients& c, std::span<const double> x_old_m, std::span<const double> x_new_m) noexcept;
  /// Solves for u with u(last) given and the slope at the first node u_x = slope + slope_gain u. u_old, u same size.
  void solve_given_last(std::span<const double> u_old_K, double slope_K_per_m, double slope_gain_1_per_m,
                        std::span<const double> source_K, double u_last_K, std::span<double> u_K) noexcept;
  /// Solves for u with u(first) given and the slope u_x at the last node given.
  void solve_given_first(std::span<const double> u_old_K, double slope_K_per_m, std::span<const double> source_K,
                         double u_first_K, std::span<double> u_K) noexcept;
  /// u_x at the end whose value was given, from the balance of its half cell [K/m].
  [[nodiscard]] double slope_last_K_per_m(std::span<const double> u_old_K, std::span<const double> source_K,
                                          std::span<const double> u_K) const noexcept;
  [[nodiscard]] double slope_first_K_per_m(std::span<const double> u_old_K, std::span<const double> source_K,
                                           std::span<const double> u_K) const noexcept;
};

}  // namespace meltbench::plant
