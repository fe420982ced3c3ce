#pragma once
/// [plant] kind = "bizone": the delay extruder alone.

#include <optional>
#include <vector>

#include "plant_emulator/model/bizone_extruder.hpp"
#include "plant_emulator/plant.hpp"

namespace meltbench::emulator {

/// Names and values of the delay extruder's signals, for the plants that have one.
[[nodiscard]] std::span<const SignalInfo> bizone_signals();
void read_bizone_signals(const plant::BizoneOutputs& outputs, std::span<double> values);

/// The delay extruder as the boards see it. Outputs are computed at most once per instant.
class BizonePlant final : public Plant {
 public:
  /// @throws std::invalid_argument as BizoneExtruder.
  explicit BizonePlant(const plant::BizoneParameters& parameters) : extruder_{parameters}, nominal_{parameters} {}

  void advance_to(Instant to) override;
  [[nodiscard]] std::span<const SignalInfo> signals() const override { return bizone_signals(); }
  void read_signals(std::span<double> values) const override { read_bizone_signals(outputs(), values); }
  void report(Instant now, Outbox& out) override;
  /// It has no melting point.
  void disturb(const Disturbance& disturbance) override;

  [[nodiscard]] double pressure_Pa() const override { return extruder_.pressure_Pa(); }
  [[nodiscard]] double encoder_rev() const override;
  [[nodiscard]] double encoder_rev_per_s() const override;
  void set_feed_kg_per_s(double feed_kg_per_s) override;
  void set_screw_rev_per_s(double screw_rev_per_s) override;

 private:
  [[nodiscard]] const plant::BizoneOutputs& outputs() const;

  plant::BizoneExtruder extruder_;
  plant::BizoneParameters nominal_;
  mutable std::optional<plant::BizoneOutputs> outputs_;
  bool was_flooded_ = false;
};

}  // namespace meltbench::emulator
