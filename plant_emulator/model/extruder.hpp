#pragma once
/// The whole extruder: filled zone, melting front, heated barrel and nozzle, moved by one screw.

#include <array>

#include "plant_emulator/model/barrel.hpp"
#include "plant_emulator/model/bizone_extruder.hpp"
#include "plant_emulator/model/melt_column.hpp"
#include "plant_emulator/model/polymer.hpp"
#include "plant_emulator/model/standing_polymer.hpp"

namespace meltbench::plant {

struct ExtruderParameters {
  BizoneParameters bizone;  ///< Transport reading; its length is the barrel's, its density the melt's.
  Polymer polymer = make_polymer(PolymerKind::kHdpe, 9e4);
  MeltNumerics numerics;
  BarrelParameters barrel = BarrelParameters::with_zones(4);
  double throat_m = 0.02;  ///< Cooled feed throat, at the inlet end.
  double T_throat_degC = 60;
  double clogging_m = 0.02;        ///< l_0 of (C7): solid this far into the filled zone closes the nozzle.
  bool starts_cold = false;        ///< Everything at ambient temperature, else in production:
  double start_front_m = 0.08;     ///< the front here, at rest,
  double T_zone_start_degC = 145;  ///< and all zones at this.

  /// Makes bizone, melt and viscosity agree about length, density and viscosity.
  void set_polymer(const Polymer& of);
  /// @throws std::invalid_argument naming what is wrong.
  void check() const;
};

/// What the polymer in the barrel does.
enum class ExtruderState {
  kStanding,   ///< The screw stands: StandingPolymer.
  kBlocked,    ///< The screw turns, but what is before the nozzle is not molten: StandingPolymer, hardly any flow.
  kConveying,  ///< The screw turns and conveys: MeltFront.
};

/// [D17] and [K19] in one machine, Part 3 of plant_emulator/MODEL.md. Neither paper has the couplings:
///
/// (C4) One screw moves both: b(t) of the melt is c(t) of the filled zone, with its fluctuation.
/// (C1) Zones heat the polymer and are cooled by it: Q_j = int hbar S u (T_bj - T) dx + latent heat at the front.
/// (C5) Viscosity falls with the temperature; the pressure follows the melt at the nozzle, theta2 the ratio of screw to
///      nozzle.
/// (C7) Melt margin m = (L - s) - x: solid that reaches into the filled zone closes the nozzle, Kd clip(1 + m/l_0,
/// 0.05, 1). (C6) Below T_m and without advection [K19] has no solution: while the screw stands, StandingPolymer holds
/// the polymer.
///      The melt model starts when the screw turns and 10 mm before the nozzle are molten; until then it is blocked.
///
/// The expensive part, the melt, is solved when somebody looks or drives, and every kThermalTick; the barrel the same.
/// Heat between polymer and barrel is exchanged in kThermalTick, held between. No allocation but when the screw starts.
class Extruder {
 public:
  static constexpr Nanos kThermalTick = 100ms;
  static constexpr double kLeastSpeed_m_per_s = 1e-4;  ///< Slower is standing.
  static constexpr double kLeastOpening = 0.05;        ///< Of a nozzle with solid before it, (C7).

  /// @throws std::invalid_argument as ExtruderParameters::check().
  explicit Extruder(const ExtruderParameters& parameters);

  void advance_to(Instant to);
  [[nodiscard]] Instant now() const { return bizone_.now(); }

  // From now() on:
  void set_feed_kg_per_s(double feed_kg_per_s) { bizone_.set_feed_kg_per_s(feed_kg_per_s); }
  void set_screw_rev_per_s(double screw_rev_per_s);
  void set_inlet(const MeltInlet& inlet);
  void set_heater_W(std::size_t zone, double power_W);
  /// The barrel holds another polymer now, at the same temperatures: what is above its T_m is molten. As if it had been
  /// taken apart and refilled; a plug of one polymer behind the other is not modelled. Allocates.
  void change_polymer(const Polymer& polymer);
  /// All viscosities times a factor, and a share of the nozzle's conductance that is left. @pre both > 0.
  void disturb_nozzle(double viscosity_factor, double nozzle_open);

  [[nodiscard]] const BizoneExtruder& bizone() const { return bizone_; }
  [[nodiscard]] const Barrel& barrel() const { return barrel_; }
  [[nodiscard]] const MeltFront& melt() const { return column_.melt(); }
  [[nodiscard]] ExtruderState state() const { return state_; }
  [[nodiscard]] const ExtruderParameters& parameters() const { return parameters_; }

  [[nodiscard]] double T_thermocouple_degC(std::size_t zone);
  [[nodiscard]] double T_inlet_degC();
  /// Where the granules end; not a number while there are none, or no melt.
  [[nodiscard]] double front_m();
  /// The same without solving: straight on from the last solution.
  [[nodiscard]] double front_estimate_m() const;
  [[nodiscard]] double T_degC(double x_m) const;  ///< As of the last solution.
  [[nodiscard]] double T_nozzle_degC() const { return T_degC(parameters_.polymer.melt.length_m); }
  [[nodiscard]] InletFlux inlet_flux() const { return column_.flux(now()); }
  [[nodiscard]] double melt_margin_m() const;  ///< m of (C7), with the front straight on.
  [[nodiscard]] double nozzle_opening() const { return opening_; }

 private:
  void solve_melt();
  void solve_barrel();
  void tick();
  void follow_screw();
  void exchange_heat();
  void update_melt_properties();
  [[nodiscard]] double calc_fill(std::size_t zone, double x_m, double u) const;

  ExtruderParameters parameters_;
  double nozzle_kg_;  // Kd of the open nozzle.
  BizoneExtruder bizone_;
  Barrel barrel_;
  Instant barrel_at_{};
  MeltColumn column_;
  StandingPolymer standing_;
  Instant standing_at_{};
  ExtruderState state_ = ExtruderState::kStanding;
  MeltBarrel steel_;  // The zones as the polymer sees them, as of the last tick.
  Instant next_tick_{kThermalTick};
  double screw_m_per_s_;
  double opening_ = 1;
  double viscosity_factor_ = 1, nozzle_open_ = 1;
};

}  // namespace meltbench::plant
