#pragma once
/// What the melt laws aim at: the steady profile for a set point of the front, and the gains that belong to it.

#include <optional>

namespace meltbench::law {

/// One phase of the polymer, as the controller believes it to be.
struct MeltPhaseModel {
  double conductivity_W_per_mK;
  double density_kg_per_m3;
  double heat_capacity_J_per_kgK;
  double barrel_exchange_W_per_m3K;  ///< hbar, volumetric.

  [[nodiscard]] constexpr double diffusivity_m2_per_s() const {
    return conductivity_W_per_mK / (density_kg_per_m3 * heat_capacity_J_per_kgK);
  }
  [[nodiscard]] constexpr double exchange_rate_1_per_s() const {
    return barrel_exchange_W_per_m3K / (density_kg_per_m3 * heat_capacity_J_per_kgK);
  }
};

/// The controller's model of the melting extruder. Temperatures in degrees Celsius, as in [K19].
struct MeltModel {
  MeltPhaseModel solid;
  MeltPhaseModel liquid;
  double T_melt_degC;
  double heat_of_fusion_J_per_kg;
  double length_m;
  double nozzle_flux_W_per_m2;  ///< q_m*.
};

/// High-density polyethylene of [K19] Table 1 with hbar in both phases; L = 0.1 m, q_m* = 100 W/m².
[[nodiscard]] MeltModel hdpe_melt_model(double barrel_exchange_W_per_m3K);

/// Steady state and gain coefficients for one set point and one screw speed, controller/MODEL.md Part 2.
///
///   x <= s_r: T_s,eq(x) = T_b + p3 e^{q3 (x - s_r)} + p4 e^{q4 (x - s_r)}                      (K1), [K19] (11)
///   x >  s_r: T_s,eq(x) = T_b + (p3 + p4) e^{q4 (x - s_r)}       (K1), ours: (11) has one e-fold per α/b there
struct MeltReference {
  double front_m;        ///< s_r.
  double speed_m_per_s;  ///< b.
  double T_barrel_degC;
  double q3_1_per_m, q4_1_per_m, p3_K, p4_K;
  double inlet_flux_W_per_m2;            ///< q_f* of (19), with its missing factor -k_s.
  double T_inlet_degC;                   ///< T_s,eq(0).
  double front_flux_W_per_m2;            ///< K = C of (18), (63).
  double A_1_per_s;                      ///< (64).
  double d1_1_per_m, d2_1_per_m;         ///< (69).
  double gamma_1_per_m;                  ///< γ = b/(2 α_s), (73).
  double loop_gain_W_per_m2K;            ///< γ k_s = ρ_s c_s b/2: gain from inlet temperature to flux in (82).
  double diffusivity_m2_per_s;           ///< α_s.
  double conductivity_W_per_mK;          ///< k_s.
  double front_speed_per_flux_m3_per_J;  ///< β = 1/(ρ_s ΔH).

  /// T_s,eq(x), continued beyond s_r [°C].
  [[nodiscard]] double T_degC(double x_m) const noexcept;
};

/// Computes the reference: some fifteen elementary functions, so it may follow the measured screw speed every sample.
/// @returns nothing unless speed > 0 and 0 < front < L.
[[nodiscard]] std::optional<MeltReference> calc_melt_reference(const MeltModel& model, double T_barrel_degC,
                                                               double speed_m_per_s, double front_m) noexcept;

}  // namespace meltbench::law
