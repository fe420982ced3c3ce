#pragma once
/// Conservative implicit step of one phase by exponentially fitted fluxes.

#include <cstddef>
#include <span>
#include <vector>

namespace meltbench::plant {

/// One implicit Euler step of advection, diffusion and exchange of u = T_b - T on moving nodes:
///
///   u_t = α u_xx - b u_x - h (u + δ);   θ = u e^{μx},  μ = 2h/(b + sqrt(b² + 4 α h)),  S = b + 2 α μ
///   =>  θ_t + (S θ - α θ_x)_x = -h δ e^{μx}
///
/// δ(x) is the local barrel temperature minus T_b; zero under a uniform barrel, and then the scheme is nodally exact at
/// steady state (below some 1 mm/s μ is limited and what is left of h becomes a sink). Each cell face carries the exact
/// flux of the steady problem between its two nodes, with the speed S - w relative to the face's own speed w
/// (Scharfetter & Gummel 1969). θ is kept relative to each node, so no exponential grows with the length. Band (1,1),
/// M-matrix, hence monotone for any dt.
class ScharfetterGummelStep {
 public:
  struct Coefficients {
    double diffusivity_m2_per_s;
    double exchange_rate_1_per_s;
    double speed_m_per_s;
    double dt_s;
  };
  /// What is known at an end: the value u, or the slope u_x = slope + slope_gain u (which gives the flux there).
  struct End {
    bool value_given;
    double u_K;
    double slope_K_per_m;
    double slope_gain_1_per_m;
    [[nodiscard]] static End value(double u_K) { return {true, u_K, 0.0, 0.0}; }
    [[nodiscard]] static End slope(double u_x, double gain = 0.0) { return {false, 0.0, u_x, gain}; }
  };
  /// u_x at both ends after the step; where the value was given it follows from the balance of the end's half cell.
  struct Slopes {
    double first_K_per_m;
    double last_K_per_m;
  };

  explicit ScharfetterGummelStep(std::size_t node_count);

  /// @param x_old, x_new  nodes before and after the step.  @param u_old  state at x_old.
  /// @param offset_K  δ at x_new, or empty for zero.  @param u  result at x_new.  All of node_count values.
  Slopes solve(const Coefficients& c, std::span<const double> x_old_m, std::span<const double> x_new_m,
               std::span<const double> u_old_K, std::span<const double> offset_K, const End& first, const End& last,
               std::span<double> u_K) noexcept;

 private:
  struct Face {  // Flux of θ through the face between nodes i and i+1: out u_i - back u_{i+1}, relative to node i ...
    double out;
    double back;
    double shift;  // ... and e^{μ dx}, which carries it over to node i+1.
  };
  std::vector<Face> faces_;
  std::vector<double> upper_;
  std::vector<double> right_side_;
};

}  // namespace meltbench::plant
