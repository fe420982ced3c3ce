#pragma once
/// What the melting extruder is made of: material, geometry, barrel; the named presets of the melt model.
/// Temperatures are in degrees Celsius throughout the melt model, as in [K19]: only differences enter its equations.

#include <array>
#include <cstddef>

namespace meltbench::plant {

/// One phase of the polymer. hbar is volumetric, W/(m³ K): film coefficient times wetted area per volume.
struct MeltPhase {
  double conductivity_W_per_mK;
  double density_kg_per_m3;
  double heat_capacity_J_per_kgK;
  double barrel_exchange_W_per_m3K;

  /// α = k/(ρ c) [m²/s].
  [[nodiscard]] constexpr double diffusivity_m2_per_s() const {
    return conductivity_W_per_mK / (density_kg_per_m3 * heat_capacity_J_per_kgK);
  }
  /// h = hbar/(ρ c) [1/s].
  [[nodiscard]] constexpr double exchange_rate_1_per_s() const {
    return barrel_exchange_W_per_m3K / (density_kg_per_m3 * heat_capacity_J_per_kgK);
  }
};

/// Everything constant about the melting extruder.
struct MeltParameters {
  MeltPhase solid;
  MeltPhase liquid;
  double T_melt_degC;
  double heat_of_fusion_J_per_kg;
  double length_m;
  double nozzle_flux_W_per_m2;  ///< q_m*, into the melt at x = L.

  /// β = 1/(ρ_s ΔH) [m³/J]: front speed per net heat flux.
  [[nodiscard]] constexpr double front_speed_per_flux_m3_per_J() const {
    return 1.0 / (solid.density_kg_per_m3 * heat_of_fusion_J_per_kg);
  }
};

/// Barrel temperature along the screw: piecewise linear through the centres of equally long zones, constant outside
/// the first and the last centre (the steel conducts, so it has no steps). One zone = uniform, as in [K19].
struct MeltBarrel {
  static constexpr std::size_t kMaxZones = 8;
  std::array<double, kMaxZones> T_zone_degC{};
  std::size_t zone_count = 1;

  [[nodiscard]] static constexpr MeltBarrel uniform(double T_degC) {
    MeltBarrel barrel;
    barrel.T_zone_degC[0] = T_degC;
    return barrel;
  }

  /// Share of zone `index` in the barrel temperature at x/L; the shares at any place sum to one.
  [[nodiscard]] double share(std::size_t index, double x_over_L) const noexcept;
  /// T_b [°C] at x/L.
  [[nodiscard]] double T_degC(double x_over_L) const noexcept;
};

/// High-density polyethylene, [K19] Table 1 (measured values of Tadmor & Gogos), L = 0.1 m, q_m* = 100 W/m².
/// @param barrel_exchange_W_per_m3K  hbar of both phases; [K19] gives no figure.
[[nodiscard]] MeltParameters hdpe_melt_parameters(double barrel_exchange_W_per_m3K);

/// Preset "paper": hbar = 2e4 W/(m³ K), the weak coupling under which [K19]'s statements about open loop and PI hold.
[[nodiscard]] MeltParameters paper_melt_parameters();

/// Preset "bench": hbar = 9e4 W/(m³ K), a textbook film coefficient (450 W/m²K on a 5 mm channel).
[[nodiscard]] MeltParameters bench_melt_parameters();

}  // namespace meltbench::plant
