#include "plant_emulator/plant_settings.hpp"

#include <stdexcept>

#include "plant_emulator/model/polymer.hpp"

namespace meltbench::emulator {

namespace {

using config::above;
using config::Section;
using plant::BizoneParameters;

constexpr double kSecondsPerHour = 3600.0;

plant::FluctuationPlace read_place(const Section& section) {
  return section.choice_or<plant::FluctuationPlace>(
      "fluctuation_on", plant::FluctuationPlace::kScrew,
      {{"screw", plant::FluctuationPlace::kScrew}, {"slip", plant::FluctuationPlace::kSlip}});
}

/// @param base  defaults of everything that is not the preset's or the case's.
BizoneParameters read_bizone(const Section& section, plant::FluctuationCase usual_case, const BizoneParameters& base) {
  const auto preset = section.choice_or<plant::Preset>("preset", plant::Preset::kSlow,
                                                       {{"paper", plant::Preset::kPaper},
                                                        {"slow", plant::Preset::kSlow},
                                                        {"phys", plant::Preset::kPhys},
                                                        {"rad", plant::Preset::kRad}});
  const auto fluctuation = section.choice_or<plant::FluctuationCase>(
      "fluctuation_case", usual_case,
      {{"none", plant::FluctuationCase::kNone}, {"A", plant::FluctuationCase::kA}, {"B", plant::FluctuationCase::kB}});
  BizoneParameters p = plant::make_parameters(preset, fluctuation);
  p.density_kg_per_m3 = base.density_kg_per_m3;
  p.viscosity_Pa_s = base.viscosity_Pa_s;
  p.x0_m = base.x0_m;
  p.fluctuation_place = read_place(section);
  p.delay_reading = section.choice_or<plant::DelayReading>(
      "delay_model", p.delay_reading,
      {{"transport", plant::DelayReading::kTransport}, {"paper", plant::DelayReading::kPaper}});
  const auto positive = [&](std::string_view key, double& value) { value = section.number_or(key, value, above(0)); };
  positive("length_m", p.length_m);
  positive("pitch_m", p.pitch_m);
  positive("density_kg_per_m3", p.density_kg_per_m3);
  positive("pressure_flow_m4", p.pressure_flow_m4);
  positive("nozzle_kg", p.nozzle_kg);
  positive("area_m2", p.area_m2);
  positive("viscosity_Pa_s", p.viscosity_Pa_s);
  positive("speed_m_per_s", p.speed_m_per_s);
  p.fluctuation = section.number_or("epsilon", p.fluctuation, config::from_below(0, 1));
  p.fluctuation_rad_per_s = section.number_or("omega_rad_per_s", p.fluctuation_rad_per_s, config::at_least(0));
  p.fluctuation_phase_rad = section.number_or("phase_rad", p.fluctuation_phase_rad);
  p.x0_m = section.number_or("x0_m", p.x0_m, config::between(0, p.length_m, "inside the screw: 0..length_m"));
  if (section.has("U_before_start")) {
    p.U_before_start = section.number("U_before_start", config::between(0, plant::kMaxFillRatio));
  }
  try {
    p.check();
  } catch (const std::invalid_argument& error) {
    section.fail_here(error.what());
  }
  return p;
}

board::PlantRates calc_rates(const BizoneParameters& p, double nominal_x_m) {
  return {.start_flow_kg_per_h = p.holding_feed_kg_per_s(p.x0_m) * kSecondsPerHour,
          .hold_flow_kg_per_h = p.holding_feed_kg_per_s(nominal_x_m) * kSecondsPerHour,
          .throat_flow_kg_per_h = p.mass_per_length_kg_per_m() * p.speed_m_per_s * kSecondsPerHour,
          .screw_rev_per_s = p.speed_m_per_s / p.pitch_m};
}

plant::PolymerKind read_material(const Section& section) {
  return section.choice_or<plant::PolymerKind>(
      "material", plant::PolymerKind::kHdpe,
      {{"hdpe", plant::PolymerKind::kHdpe}, {"pla", plant::PolymerKind::kPla}, {"ldpe", plant::PolymerKind::kLdpe}});
}

double read_barrel_exchange(const Section& section, double fallback_W_per_m3K) {
  return section.number_or("barrel_exchange_W_per_m3K", fallback_W_per_m3K, config::at_least(0));
}

void read_numerics(const Section& section, plant::MeltNumerics& numerics) {
  const auto cells = [&](std::string_view key, std::size_t fallback) {
    return static_cast<std::size_t>(
        section.integer_or(key, static_cast<std::int64_t>(fallback), config::between(8, 2000)));
  };
  numerics.solid = section.choice_or<plant::MeltDiscretisation>(
      "discretisation", numerics.solid,
      {{"third_order", plant::MeltDiscretisation::kThirdOrderUpwind},
       {"scharfetter_gummel", plant::MeltDiscretisation::kScharfetterGummel},
       {"coarse_two_point", plant::MeltDiscretisation::kCoarseTwoPointSlope}});
  numerics.solid_cells = cells("solid_cells", numerics.solid_cells);
  numerics.liquid_cells = cells("liquid_cells", numerics.liquid_cells);
  numerics.max_travel_m = section.number_or("max_travel_m", numerics.max_travel_m, above(0));
}

MeltPlantSettings read_melt(const Section& section) {
  MeltPlantSettings p;
  const std::string preset = section.choice_or("preset", "paper", {"paper", "bench"});
  const plant::PolymerKind material = read_material(section);
  p.melt = plant::make_polymer(material, read_barrel_exchange(section, preset == "paper" ? 2e4 : 9e4)).melt;
  p.speed_m_per_s = section.number_or("speed_m_per_s", p.speed_m_per_s, config::above_up_to(0, 1));
  p.pitch_m = section.number_or("pitch_m", p.pitch_m, above(0));
  p.melt.length_m = section.number_or("length_m", p.melt.length_m, above(0.01));
  p.T_barrel_degC = section.number_or("T_barrel_degC", p.melt.T_melt_degC + 10, config::between(-50, 400));
  p.melt.nozzle_flux_W_per_m2 = section.number_or("nozzle_flux_W_per_m2", p.melt.nozzle_flux_W_per_m2);
  p.start =
      section.choice_or<MeltStart>("start", p.start, {{"linear", MeltStart::kLinear}, {"steady", MeltStart::kSteady}});
  p.start_front_m =
      section.number_or("front0_m", p.start == MeltStart::kLinear ? 0.02 : 0.5 * p.melt.length_m,
                        config::inside(plant::MeltFront::kMinLength_m, p.melt.length_m - plant::MeltFront::kMinLength_m,
                                       "inside the barrel, 1 mm from its ends"));
  p.start_T_inlet_degC =
      section.number_or("T_inlet0_degC", p.melt.T_melt_degC - 20, config::between(-50, p.melt.T_melt_degC));
  p.numerics.grid_speed_m_per_s = p.speed_m_per_s;
  read_numerics(section, p.numerics);
  return p;
}

board::PlantRates calc_rates(const MeltPlantSettings& p) {
  board::PlantRates rates;
  rates.screw_rev_per_s = p.speed_m_per_s / p.pitch_m;
  if (p.start == MeltStart::kSteady) {
    rates.start_flux_W_per_m2 =
        plant::calc_melt_steady_state(p.melt, p.T_barrel_degC, p.speed_m_per_s, p.start_front_m).inlet_flux_W_per_m2;
  }
  return rates;
}

plant::BarrelParameters read_barrel(const Section& section) {
  auto barrel = plant::BarrelParameters::with_zones(
      static_cast<std::size_t>(section.integer_or("barrel_zones", 4, config::between(1, 4))));
  const plant::HeatedZone usual;
  const double capacity = section.number_or("zone_heat_capacity_J_per_K", usual.heat_capacity_J_per_K, above(0));
  const double power_W = section.number_or("zone_power_W", usual.max_power_W, config::at_least(0));
  for (plant::HeatedZone& zone : barrel.zones) {
    zone.heat_capacity_J_per_K *= capacity / usual.heat_capacity_J_per_K;
    zone.max_power_W *= power_W / usual.max_power_W;
  }
  barrel.T_ambient_degC = section.number_or("T_ambient_degC", barrel.T_ambient_degC, config::between(-50, 100));
  return barrel;
}

plant::ExtruderParameters read_coupled(const Section& section, double nominal_x_m) {
  plant::ExtruderParameters p;
  p.starts_cold = section.choice_or("start", "running", {"running", "cold"}) == "cold";
  p.polymer = plant::make_polymer(read_material(section), read_barrel_exchange(section, 9e4));
  p.set_polymer(p.polymer);
  p.bizone.x0_m = p.starts_cold ? 0.0 : nominal_x_m;
  p.bizone = read_bizone(section, plant::FluctuationCase::kNone, p.bizone);
  p.polymer.viscosity.at_reference_Pa_s = p.bizone.viscosity_Pa_s;
  plant::MeltParameters& melt = p.polymer.melt;
  melt.length_m = p.bizone.length_m;
  melt.nozzle_flux_W_per_m2 = section.number_or("nozzle_flux_W_per_m2", melt.nozzle_flux_W_per_m2);
  p.barrel = read_barrel(section);
  const double end_m = plant::MeltFront::kMinLength_m;
  p.start_front_m = section.number_or("front0_m", p.start_front_m, config::inside(end_m, melt.length_m - end_m));
  p.T_zone_start_degC = section.number_or("T_zone0_degC", melt.T_melt_degC + 10, config::between(-50, 400));
  p.throat_m = section.number_or("throat_m", p.throat_m, config::from_below(0, melt.length_m));
  p.T_throat_degC = section.number_or("T_throat_degC", p.T_throat_degC, config::between(-50, 400));
  p.clogging_m = section.number_or("clogging_m", p.clogging_m, above(0));
  p.numerics.grid_speed_m_per_s = p.bizone.speed_m_per_s;
  read_numerics(section, p.numerics);
  try {
    p.check();
  } catch (const std::invalid_argument& error) {
    section.fail_here(error.what());
  }
  return p;
}

board::PlantRates calc_rates(const plant::ExtruderParameters& p, double nominal_x_m) {
  const plant::Extruder extruder{p};
  board::PlantRates rates = calc_rates(extruder.bizone().parameters(), nominal_x_m);
  rates.barrel_zones = p.barrel.zone_count - 1;
  rates.starts_cold = p.starts_cold;
  if (p.starts_cold) {
    rates.start_flow_kg_per_h = 0;
    return rates;
  }
  rates.start_flux_W_per_m2 = extruder.inlet_flux().now_W_per_m2;
  const std::size_t zones = p.barrel.zone_count;
  for (std::size_t i = 0; i < zones; ++i) {
    const std::size_t channel = i + 1 == zones ? rates.zones.size() - 1 : i;
    const double power_W = p.barrel.zones[i].max_power_W;
    rates.zones.at(channel) = {p.T_zone_start_degC, power_W > 0 ? extruder.barrel().heater_W(i) / power_W : 0.0};
  }
  return rates;
}

}  // namespace

PlantReading read_plant(const Section& section) {
  const std::string kind = section.choice_or("kind", "bizone", {"bizone", "melt", "coupled"});
  if (kind == "melt") {
    const MeltPlantSettings plant = read_melt(section);
    return {plant, calc_rates(plant)};
  }
  const double length_m = section.number_or("length_m", BizoneParameters{}.length_m, above(0));
  const double nominal_x_m =
      section.number_or("nominal_x_m", (kind == "bizone" ? 0.8 : 0.4) * length_m, config::inside(0, length_m));
  if (kind == "coupled") {
    const plant::ExtruderParameters plant = read_coupled(section, nominal_x_m);
    return {plant, calc_rates(plant, nominal_x_m)};
  }
  const BizoneParameters plant = read_bizone(section, plant::FluctuationCase::kA, {});
  return {plant, calc_rates(plant, nominal_x_m)};
}

std::vector<MaterialChange> read_material_changes(const std::vector<config::TimelineEvent>& events,
                                                  const PlantSettings& plant) {
  std::vector<MaterialChange> changes;
  for (const config::TimelineEvent& event : events) {
    if (event.action != "material")
      event.section.fail("action", "must be \"material\"", "it is the only one that a plant knows");
    const auto* extruder = std::get_if<plant::ExtruderParameters>(&plant);
    if (extruder == nullptr) {
      event.section.fail("action", "needs a plant of kind = \"coupled\"", "the others know but one material");
    }
    static_cast<void>(event.section.text("material"));  // Here it has no default.
    const double exchange = extruder->polymer.melt.solid.barrel_exchange_W_per_m3K;
    changes.push_back({event.at, plant::make_polymer(read_material(event.section), exchange)});
    event.section.finish();
  }
  return changes;
}

}  // namespace meltbench::emulator
