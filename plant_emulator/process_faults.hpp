#pragma once
/// Sensors and actuators that fail: stands between the boards and the plant, so that the boards' firmware does not
/// know.

#include <array>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <optional>
#include <vector>

#include "plant_emulator/board/board.hpp"
#include "plant_emulator/plant.hpp"
#include "protocols/config/rig.hpp"
#include "protocols/fault/fault.hpp"

namespace meltbench::emulator {

/// What boards measure, in the order of the numbers below.
enum class Sensor : std::uint8_t { kPressure, kMeltTemperature, kEncoder, kFront, kInletTemperature, kZone };
/// What boards move. Zones and nozzle are kZone + channel.
enum class Actuator : std::uint8_t { kFeed, kScrew, kInletFlux, kZone };

/// The process as the boards see it. Values go through the faults that are on, in the order in which they began;
/// without any they go through as they are. Chance is a function of seed and instant alone, so that looking twice
/// changes nothing. Real time: no allocation but when a fault begins, and for the memory of a delayed sensor.
class ProcessFaults final : public board::Process {
 public:
  static constexpr Nanos kStep = 10ms;  ///< Of what moves by itself: a lagging actuator, a surging screw.

  /// @param plant  outlives this.
  ProcessFaults(Plant& plant, std::uint64_t seed) : plant_{plant}, seed_{seed} {}

  /// @param number  the same when it ends. Faults of boards are not for here: ignored.
  void begin(std::size_t number, const fault::Fault& fault);
  void end(std::size_t number);

  /// A board without power: what it moves stands, is cold, delivers nothing.
  void cut_power(config::BoardKind kind) { set_powered(kind, false); }
  void restore_power(config::BoardKind kind) { set_powered(kind, true); }
  /// A board that hangs: what it moves stays as it is.
  void freeze(config::BoardKind kind, bool on);

  void advance_to(Instant to);
  /// As board::Board::next_touch() and touch().
  [[nodiscard]] Instant next_touch(Instant until) const;
  void touch(Instant at);

  [[nodiscard]] double pressure_Pa() const override;
  [[nodiscard]] double encoder_rev() const override;
  [[nodiscard]] double encoder_rev_per_s() const override;
  [[nodiscard]] double front_m() override;
  [[nodiscard]] double T_inlet_degC() override;
  [[nodiscard]] double T_melt_degC() override;
  [[nodiscard]] double T_zone_degC(std::size_t channel) const override;
  void set_feed_kg_per_s(double feed_kg_per_s) override;
  void set_screw_rev_per_s(double screw_rev_per_s) override;
  void set_inlet(const plant::MeltInlet& inlet) override;
  [[nodiscard]] plant::InletFlux inlet_flux() const override { return plant_.inlet_flux(); }
  void set_heater(std::size_t channel, double share) override;
  void set_heater_supply(bool closed) override;
  [[nodiscard]] double fed_kg_per_s(double asked_kg_per_s) const override;
  [[nodiscard]] bool is_hopper_empty() const override { return hopper_empty_; }

 private:
  static constexpr std::size_t kZones = 5;
  static constexpr std::size_t kActuators = static_cast<std::size_t>(Actuator::kZone) + kZones;
  /// Nothing has been asked yet.
  [[nodiscard]] static std::array<double, kActuators> unasked() {
    std::array<double, kActuators> values{};
    values.fill(kNothing);
    return values;
  }

  struct SensorFault {
    std::size_t number = 0;
    std::size_t place = 0;  // Sensor, zones by channel.
    fault::Fault fault;
    Instant began;
    std::uint64_t seed = 0;
    std::optional<double> held;
    struct Seen {
      Instant at;
      double value = 0.0;
    };
    std::deque<Seen> seen;  // Delayed: newest last.
  };
  struct ActuatorFault {
    std::size_t number = 0;
    std::size_t place = 0;
    fault::Fault fault;
    double held = 0.0;  // What it was when the fault began; what a lagging one has come to.
  };
  struct PlantFault {
    std::size_t number = 0;
    fault::Fault fault;
    Instant began;
  };

  [[nodiscard]] double sense(std::size_t place, double truth) const;
  [[nodiscard]] double distort(SensorFault& fault, double value) const;
  [[nodiscard]] bool is_encoder_stuck() const;
  void set_powered(config::BoardKind kind, bool on);
  void begin_sensor(std::size_t number, const fault::Fault& fault);
  void begin_actuator(std::size_t number, const fault::Fault& fault);
  [[nodiscard]] double limit(std::size_t place, double value) const;
  void ask(std::size_t place, double value);
  void drive(std::size_t place);
  void give(std::size_t place, double value);
  void drive_all();
  void drive_inlet();
  void apply();
  void update_plant();
  [[nodiscard]] const PlantFault* find(fault::Kind kind) const;
  [[nodiscard]] bool moves_by_itself() const;

  Plant& plant_;
  std::uint64_t seed_;
  Instant now_;
  mutable std::vector<SensorFault> sensors_;  // Looking at a sensor notes what it shows.
  std::vector<ActuatorFault> actuators_;
  std::vector<PlantFault> plants_;
  std::array<double, kActuators> asked_ = unasked();
  std::array<double, kActuators> given_ = unasked();
  std::array<bool, kActuators> powered_{true, true, true, true, true, true, true, true};
  std::array<bool, kActuators> frozen_{};
  std::optional<plant::MeltInlet> inlet_asked_;
  bool heater_supply_ = true;
  bool hopper_empty_ = false;
  double encoder_lost_rev_ = 0.0;  // Turns that a stuck encoder has not counted.
  double encoder_held_rev_ = 0.0;
  std::optional<Instant> next_step_;
};

}  // namespace meltbench::emulator
