#pragma once
/// What a bizone extruder is made of: geometry, melt, screw and fluctuation, with the presets that the bench knows.
/// Equation numbers (D..) are those of plant_emulator/MODEL.md, [D17] is the paper named there.

#include <optional>
#include <string_view>

namespace meltbench::plant {

/// Which delay the material has on its way from the feeder to the filled zone.
enum class DelayReading {
  kTransport,  ///< The material's own travel, exact for any speed, (D7).
  kPaper,      ///< [D17] (16), as printed: the speed of the moment is taken for the whole way, (D15).
};

/// Where the speed fluctuation of (D2) comes from, so whether an encoder on the screw can see it.
enum class FluctuationPlace {
  kScrew,  ///< The screw itself turns unevenly: the encoder follows the material.
  kSlip,   ///< The material slips on the screw: the encoder sees the mean speed only.
};

/// [D17] leaves the unit of the screw speed open; each preset is one way to read it. MODEL.md has the table.
enum class Preset {
  kPaper,  ///< 0.9 m/s as the figures of [D17] need it; delay as printed.
  kSlow,   ///< The same run 60 times slower, a real desktop screw: 90 rpm. The bench's default.
  kPhys,   ///< A real screw with the fluctuation as printed: many periods per delay. Stress case.
  kRad,    ///< 90 rpm read as rad/s. For reproduction only.
};

/// The two fluctuations that [D17] simulates, and none.
enum class FluctuationCase {
  kNone,
  kA,  ///< 10 %, 4 rad/s.
  kB,  ///< 40 %, 0.8 rad/s.
};

/// Constants of one extruder. Plain data; check() tells whether they make sense.
struct BizoneParameters {
  double length_m = 0.2;               ///< L, nozzle (z = 0) to feed throat (z = L).
  double pitch_m = 0.01;               ///< xi, conveyed per screw turn.
  double density_kg_per_m3 = 1240.0;   ///< rho0 of the melt (PLA).
  double pressure_flow_m4 = 9.345e-9;  ///< B, geometry of the pressure flow, [D17] (4).
  double nozzle_kg = 2.45e-5;          ///< Kd, nozzle conductance: F_d = Kd dP / eta.
  double area_m2 = 2.2383097e-4;       ///< S_eff, free cross section. Not in [D17]: W H with W = xi, see MODEL.md.
  double viscosity_Pa_s = 1000.0;      ///< eta of the melt. Not in [D17].

  double speed_m_per_s = 0.015;               ///< theta1 = xi N0, nominal conveying speed.
  double fluctuation = 0.1;                   ///< eps, share of the speed, [0, 1).
  double fluctuation_rad_per_s = 4.0 / 60.0;  ///< omega.
  double fluctuation_phase_rad = 0.0;         ///< Phase at t = 0; [D17] has 0.
  FluctuationPlace fluctuation_place = FluctuationPlace::kScrew;

  DelayReading delay_reading = DelayReading::kTransport;
  double x0_m = 0.1;  ///< Filled length at t = 0.
  std::optional<double> U_before_start =
      {};  ///< Inlet filling ratio at all t < 0; default v(x0): the plant is at rest.

  /// theta2 = Kd / (B rho0) [1/m], [D17] (15).
  [[nodiscard]] double theta2_per_m() const { return nozzle_kg / (pressure_flow_m4 * density_kg_per_m3); }

  /// Share of the screw's capacity that leaves through the nozzle at filled length x, (D4): v = theta2 x/(1 + theta2
  /// x).
  [[nodiscard]] double outflow_ratio(double x_m) const {
    const double r = theta2_per_m() * x_m;
    return r / (1.0 + r);
  }

  /// Mass that fills one metre of the channel [kg/m]: rho0 S_eff. F = U c times this, [D17] (3).
  [[nodiscard]] double mass_per_length_kg_per_m() const { return density_kg_per_m3 * area_m2; }

  /// Feed [kg/s] that keeps filled length x at the nominal speed: rho0 S_eff theta1 v(x).
  [[nodiscard]] double holding_feed_kg_per_s(double x_m) const {
    return mass_per_length_kg_per_m() * speed_m_per_s * outflow_ratio(x_m);
  }

  /// @throws std::invalid_argument naming the quantity, its value and its range if a constant is out of range.
  void check() const;
};

/// A preset with one of the fluctuations of [D17]; x0 = 0.1 m, history v(x0).
[[nodiscard]] BizoneParameters make_parameters(Preset preset, FluctuationCase fluctuation);

/// "paper", "slow", "phys", "rad"; empty if there is no such preset.
[[nodiscard]] std::optional<Preset> find_preset(std::string_view name);

/// "none", "A", "B"; empty if there is no such case.
[[nodiscard]] std::optional<FluctuationCase> find_fluctuation_case(std::string_view name);

/// Feed beyond this filling ratio does not fit into the throat. A full channel (1) would make (D7) singular.
inline constexpr double kMaxFillRatio = 0.999;

}  // namespace meltbench::plant
