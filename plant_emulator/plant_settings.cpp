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

BizoneParameters read_bizone(const Section& section) {
  const auto preset = section.choice_or<plant::Preset>("preset", plant::Preset::kSlow,
                                                       {{"paper", plant::Preset::kPaper},
                                                        {"slow", plant::Preset::kSlow},
                                                        {"phys", plant::Preset::kPhys},
                                                        {"rad", plant::Preset::kRad}});
  const auto fluctuation = section.choice_or<plant::FluctuationCase>(
      "fluctuation_case", plant::FluctuationCase::kA,
      {{"none", plant::FluctuationCase::kNone}, {"A", plant::FluctuationCase::kA}, {"B", plant::FluctuationCase::kB}});
  BizoneParameters p = plant::make_parameters(preset, fluctuation);
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

board::PlantRates calc_rates(const Section& section, const BizoneParameters& p) {
  const double nominal_x_m = section.number_or("nominal_x_m", 0.8 * p.length_m, config::inside(0, p.length_m));
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

}  // namespace

PlantReading read_plant(const Section& section) {
  const std::string kind = section.choice_or("kind", "bizone", {"bizone", "melt"});
  if (kind == "melt") {
    const MeltPlantSettings plant = read_melt(section);
    return {plant, calc_rates(plant)};
  }
  const BizoneParameters plant = read_bizone(section);
  return {plant, calc_rates(section, plant)};
}

}  // namespace meltbench::emulator
