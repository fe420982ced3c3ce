#pragma once
/// The polymer in the barrel while the screw stands: it warms, melts and freezes where it is.

#include <cstddef>
#include <span>
#include <vector>

#include "plant_emulator/model/melt_front.hpp"
#include "plant_emulator/model/melt_material.hpp"

namespace meltbench::plant {

/// Enthalpy along the barrel, cell by cell, (C6) in plant_emulator/MODEL.md:
///
///   rho_s di/dt = hbar (T_b(x) - T(i)),   T = T_m + i/c_s          i < 0       solid
///                                             T_m                  0..dH       melting
///                                             T_m + (i - dH)/c_l   i > dH      melt
///
/// i specific enthalpy above that of the solid at T_m [J/kg]. No conduction along the screw: in the time that a cell
/// needs to follow the barrel (20..100 s) it reaches 3 mm. [K19] has no such state: without advection its granules
/// superheat and its front collapses. The feed throat is cooled: cells in it see T_throat and not the barrel, so that
/// granules are left wherever the screw starts again.
class StandingPolymer {
 public:
  static constexpr std::size_t kCells = 80;

  /// All at one temperature. @param throat_m  length of the cooled feed throat.
  StandingPolymer(const MeltParameters& parameters, double throat_m, double T_throat_degC, double T_degC);

  /// One temperature a cell: kCells of them; above T_m it is molten.
  void set_T_degC(std::span<const double> T_degC);
  /// Takes over the fields of a melt front that has stopped. Granules that the front model has superheated count as
  /// partly molten.
  void take_over(const MeltFront& melt);
  /// Hands over to a melt front: where the granules would end if all that is solid lay at the inlet.
  /// @pre can_start().
  void hand_over(MeltFront& melt) const;
  /// True if there is molten polymer from the nozzle on, kLeastMelt_m at least: the screw can turn.
  [[nodiscard]] bool can_start() const { return molten_from_nozzle_m() >= kLeastMelt_m; }

  void advance(double dt_s, const MeltBarrel& barrel);

  /// Length of polymer that is mostly molten, from the nozzle on, without a gap.
  [[nodiscard]] double molten_from_nozzle_m() const;
  /// Length of all that is solid.
  [[nodiscard]] double solid_m() const;
  /// Between nothing molten and everything: where the molten part begins; else not a number.
  [[nodiscard]] double front_m() const;
  [[nodiscard]] double T_degC(double x_m) const;
  /// Heat that the zones give to the polymer now, per cross-section [W/m²]; the throat's is not theirs.
  void calc_barrel_heat_W_per_m2(const MeltBarrel& barrel, std::span<double> heat_W_per_m2) const;

  static constexpr double kLeastMelt_m = 0.01;

 private:
  [[nodiscard]] double T_of(double enthalpy_J_per_kg) const;
  [[nodiscard]] double enthalpy_of(double T_degC, bool is_melt) const;
  [[nodiscard]] double melt_share(double enthalpy_J_per_kg) const;
  [[nodiscard]] double x_of(std::size_t cell) const { return (static_cast<double>(cell) + 0.5) * dx_m_; }
  [[nodiscard]] double heat_W_per_m3(std::size_t cell, const MeltBarrel& barrel) const;

  MeltParameters parameters_;
  double throat_m_, T_throat_degC_, dx_m_;
  std::vector<double> enthalpy_J_per_kg_;
};

}  // namespace meltbench::plant
