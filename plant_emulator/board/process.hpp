#pragma once
/// The process as field devices see it.

#include <cstddef>
#include <limits>

#include "plant_emulator/model/inlet_flux.hpp"
#include "plant_emulator/model/melt_inlet.hpp"

namespace meltbench::board {

/// What the boards measure and drive, at the instant to which it has been advanced.
///
/// Not every plant has everything: one that does not melt says kNothing (not a number) for what it has not, and takes
/// no notice of what would drive it. A broken thermocouple reads kNothing too.
class Process {
 public:
  static constexpr double kNothing = std::numeric_limits<double>::quiet_NaN();

  virtual ~Process() = default;
  [[nodiscard]] virtual double pressure_Pa() const = 0;          ///< Over the nozzle.
  [[nodiscard]] virtual double encoder_rev() const = 0;          ///< Turns of the screw since the start.
  [[nodiscard]] virtual double encoder_rev_per_s() const = 0;    ///< Its rate.
  virtual void set_feed_kg_per_s(double feed_kg_per_s) = 0;      ///< Held until set again.
  virtual void set_screw_rev_per_s(double screw_rev_per_s) = 0;  ///< Held until set again.

  // Not const: a plant may solve for its temperature field only when it is asked.
  [[nodiscard]] virtual double front_m() { return kNothing; }               ///< Melting front, from the inlet.
  [[nodiscard]] virtual double T_inlet_degC() { return kNothing; }          ///< Surface of the granules at the inlet.
  [[nodiscard]] virtual double T_melt_degC() { return kNothing; }           ///< Melt at the nozzle.
  virtual void set_inlet(const plant::MeltInlet& /*inlet*/) {}              ///< Held until set again.
  [[nodiscard]] virtual plant::InletFlux inlet_flux() const { return {}; }  ///< Up to now.
  /// Thermocouple of a heated zone; channels 0..3 are the barrel from the feed throat on, 4 is the nozzle.
  [[nodiscard]] virtual double T_zone_degC(std::size_t /*channel*/) const { return kNothing; }
  /// Share of its full power that a heater band gets, 0..1; held until set again.
  virtual void set_heater(std::size_t /*channel*/, double /*share*/) {}
  /// The contactor before all heater bands: open, none gets power, whatever its relay does. Closed at the start.
  virtual void set_heater_supply(bool /*closed*/) {}
  /// What the feeder's screw really brings when it is asked for so much, and whether its hopper has run empty.
  [[nodiscard]] virtual double fed_kg_per_s(double asked_kg_per_s) const { return asked_kg_per_s; }
  [[nodiscard]] virtual bool is_hopper_empty() const { return false; }
};

}  // namespace meltbench::board
