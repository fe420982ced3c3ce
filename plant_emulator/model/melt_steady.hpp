#pragma once
/// Steady state of the melting extruder, (11)-(19) of [K19], in a form that cannot overflow.

#include "plant_emulator/model/melt_material.hpp"

namespace meltbench::plant {

/// The one steady state that holds the front at s_r, for a uniform barrel and a constant screw speed.
///
///   T_l(x) = T_b + P1L e^{q1 (x-L)} + p2 e^{q2 (x-s_r)},  x >= s_r                             (M11)
///   T_s(x) = T_b + p3 e^{q3 (x-s_r)} + p4 e^{q4 (x-s_r)}, x <= s_r
///
/// P1L = p1 e^{q1 (L-s_r)}: p1 itself is below the smallest double at every speed of interest.
struct MeltSteadyState {
  double front_m;        ///< s_r.
  double T_barrel_degC;  ///< T_b.
  double length_m;
  double q1_1_per_m, q2_1_per_m, q3_1_per_m, q4_1_per_m;  ///< (12), (13).
  double P1L_K, p2_K, p3_K, p4_K;                         ///< (14)-(17).
  double front_flux_W_per_m2;                             ///< K of (18): heat crossing the front.
  double inlet_flux_W_per_m2;                             ///< q_f* of (19), with the factor -k_s that (19) lost.

  /// T_s,eq(x) [°C]. @pre 0 <= x <= front_m.
  [[nodiscard]] double T_solid_degC(double x_m) const noexcept;
  /// T_l,eq(x) [°C]. @pre front_m <= x <= length_m.
  [[nodiscard]] double T_liquid_degC(double x_m) const noexcept;
  /// T_s,eq(0) [°C].
  [[nodiscard]] double T_inlet_degC() const noexcept { return T_solid_degC(0.0); }
};

/// @param speed_m_per_s  advection speed b > 0.  @param front_m  s_r in (0, L).
/// @throws std::invalid_argument naming the value that is out of range.
[[nodiscard]] MeltSteadyState calc_melt_steady_state(const MeltParameters& parameters, double T_barrel_degC,
                                                     double speed_m_per_s, double front_m);

/// Lemma 1, (20)-(22): the steady state respects (6) and (7) while  lower_K <= T_b - T_m <= upper_K.
struct MeltBarrelWindow {
  double lower_K;  ///< -q of (20); zero where it is below the smallest double.
  double upper_K;  ///< q-bar of (21).
};
/// @throws as calc_melt_steady_state().
[[nodiscard]] MeltBarrelWindow calc_melt_barrel_window(const MeltParameters& parameters, double speed_m_per_s,
                                                       double front_m);

}  // namespace meltbench::plant
