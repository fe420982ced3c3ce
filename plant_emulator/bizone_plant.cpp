#include "plant_emulator/bizone_plant.hpp"

#include <algorithm>
#include <array>

namespace meltbench::emulator {

namespace {

// In the order of read_bizone_signals().
const std::array kBizoneSignals{
    SignalInfo{"plant.x_m"},
    SignalInfo{"plant.U"},
    SignalInfo{"plant.delay_s"},
    SignalInfo{"plant.delay_rate"},
    SignalInfo{"plant.flow_kg_per_s"},
    SignalInfo{"plant.pressure_Pa"},
    SignalInfo{"plant.speed_m_per_s"},
    SignalInfo{"plant.conveyed_m"},
    SignalInfo{"plant.feed_kg_per_s"},
    SignalInfo{"plant.spill_m"},
    SignalInfo{"plant.mass_residual_m"},
    SignalInfo{"plant.rejected_feed_kg", SignalKind::kErrorCounter},
};

}  // namespace

std::span<const SignalInfo> bizone_signals() {
  return kBizoneSignals;
}

void read_bizone_signals(const plant::BizoneOutputs& p, std::span<double> values) {
  const std::array read{p.x_m,           p.U,           p.delay_s,         p.delay_rate,
                        p.flow_kg_per_s, p.pressure_Pa, p.speed_m_per_s,   p.conveyed_m,
                        p.feed_kg_per_s, p.spill_m,     p.mass_residual_m, p.rejected_feed_kg};
  static_assert(read.size() == kBizoneSignals.size());
  std::copy(read.begin(), read.end(), values.begin());
}

void BizonePlant::advance_to(Instant to) {
  if (to <= extruder_.now()) return;
  extruder_.advance_to(to);
  outputs_.reset();
}

double BizonePlant::encoder_rev() const {
  return extruder_.encoder_m() / extruder_.parameters().pitch_m;
}

double BizonePlant::encoder_rev_per_s() const {
  return outputs().encoder_m_per_s / extruder_.parameters().pitch_m;
}

void BizonePlant::set_feed_kg_per_s(double feed_kg_per_s) {
  extruder_.set_feed_kg_per_s(feed_kg_per_s);
  outputs_.reset();
}

void BizonePlant::set_screw_rev_per_s(double screw_rev_per_s) {
  extruder_.set_screw_rev_per_s(screw_rev_per_s);
  outputs_.reset();
}

void BizonePlant::disturb(const Disturbance& disturbance) {
  extruder_.set_viscosity_Pa_s(nominal_.viscosity_Pa_s * disturbance.viscosity_factor);
  extruder_.set_density_kg_per_m3(nominal_.density_kg_per_m3 * disturbance.density_factor);
  extruder_.set_nozzle_kg(nominal_.nozzle_kg * disturbance.nozzle_open);
  outputs_.reset();
}

void BizonePlant::report(Instant now, Outbox& out) {
  const bool flooded = extruder_.x_m() >= extruder_.parameters().length_m;
  if (flooded && !was_flooded_) {
    out.report(Severity::kWarning, now, "screw-flooded", "the filled zone has reached the feed throat");
  }
  was_flooded_ = flooded;
}

const plant::BizoneOutputs& BizonePlant::outputs() const {
  if (!outputs_) outputs_ = extruder_.outputs();
  return *outputs_;
}

}  // namespace meltbench::emulator
