#include "plant_emulator/coupled_plant.hpp"

#include <fmt/format.h>

#include "plant_emulator/bizone_plant.hpp"

namespace meltbench::emulator {

namespace {

std::string_view text(plant::ExtruderState state) {
  switch (state) {
    case plant::ExtruderState::kStanding:
      return "the screw stands";
    case plant::ExtruderState::kBlocked:
      return "the screw turns against polymer that is not molten";
    case plant::ExtruderState::kConveying:
      return "the screw conveys";
  }
  return "?";
}

}  // namespace

CoupledPlant::CoupledPlant(const plant::ExtruderParameters& parameters)
    : nominal_{parameters.polymer},
      extruder_{parameters},
      signals_{bizone_signals().begin(), bizone_signals().end()},
      told_{extruder_.state()} {
  for (const char* name : {"plant.melt_margin_m", "plant.state", "plant.nozzle_opening", "plant.viscosity_Pa_s"}) {
    signals_.push_back({name});
  }
  signals_.insert(signals_.end(), melt_signals().begin(), melt_signals().end());
  const std::size_t zones = extruder_.barrel().zone_count();
  for (std::size_t i = 0; i < zones; ++i) {
    const std::string zone = i + 1 == zones ? "nozzle" : fmt::format("zone{}", i + 1);
    signals_.push_back({fmt::format("barrel.T_{}_degC", zone)});
    signals_.push_back({fmt::format("barrel.power_{}_W", zone)});
    signals_.push_back({fmt::format("barrel.to_polymer_{}_W", zone)});
  }
  for (const char* name : {"barrel.heated_J", "barrel.lost_J", "barrel.to_polymer_J", "barrel.energy_residual_J"}) {
    signals_.push_back({name});
  }
  signals_.push_back({"melt.length_m"});  // What a report needs to draw the profile and the front to scale.
  signals_.push_back({"melt.T_melt_degC"});
}

std::size_t CoupledPlant::zone_of(std::size_t channel) const {
  const std::size_t zones = extruder_.barrel().zone_count();
  if (channel == kNozzleChannel) return zones - 1;
  return channel + 1 < zones ? channel : zones;
}

double CoupledPlant::encoder_rev() const {
  return extruder_.bizone().encoder_m() / extruder_.parameters().bizone.pitch_m;
}

double CoupledPlant::encoder_rev_per_s() const {
  return extruder_.bizone().encoder_m_per_s() / extruder_.parameters().bizone.pitch_m;
}

double CoupledPlant::T_zone_degC(std::size_t channel) const {
  const std::size_t zone = zone_of(channel);
  return zone < extruder_.barrel().zone_count() ? extruder_.T_thermocouple_degC(zone) : kNothing;
}

void CoupledPlant::set_heater(std::size_t channel, double share) {
  const std::size_t zone = zone_of(channel);
  if (zone >= extruder_.barrel().zone_count()) return;
  extruder_.set_heater_W(zone, share * extruder_.barrel().parameters().zones[zone].max_power_W);
}

void CoupledPlant::change_polymer(const plant::Polymer& polymer) {
  nominal_ = polymer;
  fill_with_polymer();
}

void CoupledPlant::fill_with_polymer() {
  plant::Polymer polymer = nominal_;
  polymer.melt.T_melt_degC += disturbance_.melting_point_shift_K;
  polymer.melt.solid.density_kg_per_m3 *= disturbance_.density_factor;
  polymer.melt.liquid.density_kg_per_m3 *= disturbance_.density_factor;
  extruder_.change_polymer(polymer);
}

void CoupledPlant::disturb(const Disturbance& disturbance) {
  if (disturbance == disturbance_) return;
  const bool same_polymer = disturbance.density_factor == disturbance_.density_factor &&
                            disturbance.melting_point_shift_K == disturbance_.melting_point_shift_K;
  disturbance_ = disturbance;
  if (!same_polymer) fill_with_polymer();
  extruder_.disturb_nozzle(disturbance.viscosity_factor, disturbance.nozzle_open);
}

void CoupledPlant::report(Instant now, Outbox& out) {
  status_.tell(extruder_.melt().status(), now, out);
  if (const plant::ExtruderState state = extruder_.state(); state != told_) {
    told_ = state;
    const bool blocked = state == plant::ExtruderState::kBlocked;
    out.report(blocked ? Severity::kFault : Severity::kInfo, now, blocked ? "screw-blocked" : "screw-state",
               std::string{text(state)});
  }
  const bool flooded = extruder_.bizone().x_m() >= extruder_.parameters().bizone.length_m;
  if (flooded && !was_flooded_) {
    out.report(Severity::kWarning, now, "screw-flooded", "the filled zone has reached the feed throat");
  }
  was_flooded_ = flooded;
  const bool clogged = extruder_.state() == plant::ExtruderState::kConveying && extruder_.nozzle_opening() < 1;
  if (clogged && !was_clogged_) {
    out.report(Severity::kWarning, now, "nozzle-clogging", "granules reach into the filled zone");
  }
  was_clogged_ = clogged;
}

void CoupledPlant::read_signals(std::span<double> values) const {
  const plant::ExtruderParameters& p = extruder_.parameters();
  read_bizone_signals(extruder_.bizone().outputs(), values);
  values = values.subspan(bizone_signals().size());
  const bool conveys = extruder_.state() == plant::ExtruderState::kConveying;
  values[0] = extruder_.melt_margin_m();
  values[1] = static_cast<double>(extruder_.state());
  values[2] = extruder_.nozzle_opening();
  values[3] = p.polymer.viscosity.at_Pa_s(extruder_.T_nozzle_degC());
  values = values.subspan(4);
  const double length_m = p.bizone.length_m;
  if (conveys) {
    read_melt_signals(extruder_.melt(), length_m, extruder_.front_estimate_m(), extruder_.inlet_flux().now_W_per_m2,
                      values);
  } else {
    read_standing_signals([this](double x_m) { return extruder_.T_degC(x_m); }, length_m, extruder_.front_estimate_m(),
                          values);
  }
  values = values.subspan(melt_signals().size());
  const plant::Barrel& barrel = extruder_.barrel();
  for (std::size_t i = 0; i < barrel.zone_count(); ++i) {
    values[3 * i] = barrel.T_degC(i);
    values[3 * i + 1] = barrel.heater_W(i);
    values[3 * i + 2] = barrel.to_polymer_W(i);
  }
  values = values.subspan(3 * barrel.zone_count());
  values[0] = barrel.heated_J();
  values[1] = barrel.lost_J();
  values[2] = barrel.to_polymer_J();
  values[3] = barrel.energy_residual_J();
  values[4] = length_m;
  values[5] = p.polymer.melt.T_melt_degC;
}

}  // namespace meltbench::emulator
