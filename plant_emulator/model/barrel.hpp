#pragma once
/// The heated steel: barrel zones and nozzle, with heater bands outside and thermocouples inside.

#include <array>
#include <cstddef>
#include <span>

namespace meltbench::plant {

/// One zone of the barrel, or the nozzle.
struct HeatedZone {
  double heat_capacity_J_per_K = 600.0;  ///< C: 1.25 kg of steel.
  double to_ambient_W_per_K = 1.2;       ///< G, losses.
  double to_next_W_per_K = 2.0;          ///< G_next, to the zone downstream; the last one's has no meaning.
  double heater_lag_s = 12.0;            ///< Band and mica: from the wire to the steel.
  double thermocouple_lag_s = 6.0;       ///< Steel to reading.
  double max_power_W = 500.0;            ///< Of the band.
};

struct BarrelParameters {
  static constexpr std::size_t kMaxZones = 5;  ///< Four barrel zones and the nozzle.
  std::array<HeatedZone, kMaxZones> zones{};
  std::size_t zone_count = kMaxZones;  ///< Including the nozzle, which is the last one.
  double T_ambient_degC = 25.0;

  /// `barrel_zones` equal zones and a nozzle of a third of their size.
  [[nodiscard]] static BarrelParameters with_zones(std::size_t barrel_zones);
  /// @throws std::invalid_argument naming the quantity, its value and its range.
  void check() const;
};

/// The steel, (C1) to (C3) in plant_emulator/MODEL.md:
///
///   C_j dT_j/dt = P_j - G_j (T_j - T_amb) - G_jk (T_j - T_k) - ... - Q_j                      (C1)
///   lag_h dP_j/dt = W_j - P_j,   lag_t dY_j/dt = T_j - Y_j                                     (C2), (C3)
///
/// T steel [degC], P heat that reaches it [W], W electric power [W], Q heat that the polymer takes [W], Y thermocouple.
/// RK4 in steps of at most kMaxStep_s; the time constants are seconds to minutes. It is linear in the states, so the
/// energy account closes to rounding whatever the step. No allocation. About 0.15 us a step.
class Barrel {
 public:
  static constexpr double kMaxStep_s = 0.25;

  /// All at one temperature, heaters off and cold. @throws as BarrelParameters::check().
  Barrel(const BarrelParameters& parameters, double T_degC);

  /// As in production: all zones at these temperatures, heated with what keeps them there under the given heat to the
  /// polymer. @pre sizes are zone_count().
  void start_at(std::span<const double> T_degC, std::span<const double> to_polymer_W);

  /// Electric power of a zone's band from now on; cut to 0..max.
  void set_heater_W(std::size_t zone, double power_W);
  /// Heat that the polymer takes from a zone from now on; negative if it warms the steel.
  void set_to_polymer_W(std::size_t zone, double heat_W) { to_polymer_W_[zone] = heat_W; }

  void advance(double dt_s);

  [[nodiscard]] std::size_t zone_count() const { return parameters_.zone_count; }
  [[nodiscard]] double T_degC(std::size_t zone) const { return state_.T_degC[zone]; }
  [[nodiscard]] double T_thermocouple_degC(std::size_t zone) const { return state_.Y_degC[zone]; }
  [[nodiscard]] double heater_W(std::size_t zone) const { return heater_W_[zone]; }
  [[nodiscard]] double to_polymer_W(std::size_t zone) const { return to_polymer_W_[zone]; }
  [[nodiscard]] const BarrelParameters& parameters() const { return parameters_; }

  [[nodiscard]] double heated_J() const { return heated_J_; }          ///< From the wires, since the start.
  [[nodiscard]] double lost_J() const { return state_.lost_J; }        ///< To the surroundings.
  [[nodiscard]] double to_polymer_J() const { return to_polymer_J_; }  ///< To the polymer.
  /// Stored in steel and bands since the start, minus what the flows say: 0 but for rounding.
  [[nodiscard]] double energy_residual_J() const;

 private:
  using Zones = std::array<double, BarrelParameters::kMaxZones>;
  struct State {
    Zones T_degC{}, P_W{}, Y_degC{};
    double lost_J = 0;
  };

  void step(double dt_s);
  [[nodiscard]] State calc_rate(const State& state) const;
  [[nodiscard]] double stored_J() const;

  BarrelParameters parameters_;
  State state_;
  Zones heater_W_{}, to_polymer_W_{};
  double stored_at_start_J_ = 0;
  double heated_J_ = 0;
  double to_polymer_J_ = 0;
};

}  // namespace meltbench::plant
