#pragma once
/// [plant] kind = "coupled": filled zone, melting front, barrel and nozzle in one machine.

#include <vector>

#include "plant_emulator/melt_plant.hpp"
#include "plant_emulator/model/extruder.hpp"
#include "plant_emulator/plant.hpp"

namespace meltbench::emulator {

/// The whole extruder as the boards see it. Heater channels 0..3 are the barrel zones, 4 is the nozzle, however many
/// zones there are.
class CoupledPlant final : public Plant {
 public:
  /// @throws std::invalid_argument as Extruder.
  explicit CoupledPlant(const plant::ExtruderParameters& parameters);

  void advance_to(Instant to) override { extruder_.advance_to(to); }
  [[nodiscard]] std::span<const SignalInfo> signals() const override { return signals_; }
  void read_signals(std::span<double> values) const override;
  void report(Instant now, Outbox& out) override;

  /// From now on, see Extruder::change_polymer().
  void change_polymer(const plant::Polymer& polymer) override;
  void disturb(const Disturbance& disturbance) override;

  [[nodiscard]] double pressure_Pa() const override { return extruder_.bizone().pressure_Pa(); }
  [[nodiscard]] double encoder_rev() const override;
  [[nodiscard]] double encoder_rev_per_s() const override;
  void set_feed_kg_per_s(double feed_kg_per_s) override { extruder_.set_feed_kg_per_s(feed_kg_per_s); }
  void set_screw_rev_per_s(double screw_rev_per_s) override { extruder_.set_screw_rev_per_s(screw_rev_per_s); }
  [[nodiscard]] double front_m() override { return extruder_.front_m(); }
  [[nodiscard]] double T_inlet_degC() override { return extruder_.T_inlet_degC(); }
  [[nodiscard]] double T_melt_degC() override { return extruder_.T_nozzle_degC(); }
  void set_inlet(const plant::MeltInlet& inlet) override { extruder_.set_inlet(inlet); }
  [[nodiscard]] plant::InletFlux inlet_flux() const override { return extruder_.inlet_flux(); }
  [[nodiscard]] double T_zone_degC(std::size_t channel) const override;
  void set_heater(std::size_t channel, double share) override;

 private:
  static constexpr std::size_t kNozzleChannel = 4;

  /// Zone of the model behind a channel of the heater; none: as many as there are zones.
  [[nodiscard]] std::size_t zone_of(std::size_t channel) const;

  void fill_with_polymer();

  plant::Polymer nominal_;  // What the rig or an event says is in the barrel.
  Disturbance disturbance_;
  mutable plant::Extruder extruder_;  // Reading a thermocouple solves the barrel up to now.
  std::vector<SignalInfo> signals_;
  MeltStatusReport status_;
  plant::ExtruderState told_;
  bool was_flooded_ = false;
  bool was_clogged_ = false;
};

}  // namespace meltbench::emulator
