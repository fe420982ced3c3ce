#pragma once
/// Reading [plant]: which extruder it is, and everything constant about it.

#include <variant>
#include <vector>

#include "plant_emulator/board/settings.hpp"
#include "plant_emulator/coupled_plant.hpp"
#include "plant_emulator/melt_plant.hpp"
#include "plant_emulator/model/bizone_parameters.hpp"
#include "plant_emulator/model/extruder.hpp"
#include "protocols/config/rig.hpp"
#include "protocols/config/section.hpp"

namespace meltbench::emulator {

using PlantSettings = std::variant<plant::BizoneParameters, MeltPlantSettings, plant::ExtruderParameters>;

struct PlantReading {
  PlantSettings plant;
  board::PlantRates rates;
};

/// [plant] kind = "bizone" (the default). Key, range, (default), what:
/// - preset            paper | slow | phys | rad (slow)   how the published speed is read, see MODEL.md
/// - fluctuation_case  none | A | B (A)                   the two published fluctuations of the conveying speed
/// - fluctuation_on    screw | slip (screw)               whether the encoder on the screw sees it
/// - delay_model       transport | paper (the preset's)   true travel time, or the delay as printed
/// - x0_m              0..length (0.1)                    filled length at the start
/// - nominal_x_m       > 0, < length (0.16)               filled length that the feeder's loss-of-master flow leads to
/// - U_before_start    0..0.999 (v(x0))                   filling ratio of what is under way at the start
/// - epsilon           >= 0, < 1 (the case's)             share of the speed that fluctuates
/// - omega_rad_per_s   >= 0 (the case's)                  how fast
/// - phase_rad         any (0)                            phase of the fluctuation at the start
/// - speed_m_per_s     > 0 (the preset's)                 nominal conveying speed
/// - length_m, pitch_m, density_kg_per_m3, pressure_flow_m4, nozzle_kg, area_m2, viscosity_Pa_s
///                     > 0 (model/bizone_parameters.hpp)  geometry and melt
///
/// [plant] kind = "melt". Key, range, (default), what:
/// - preset                     paper | bench (paper)     coupling to the barrel: 2e4 or 9e4 W/(m3 K)
/// - material                   hdpe | pla | ldpe (hdpe)  model/polymer.hpp
/// - barrel_exchange_W_per_m3K  >= 0 (the preset's)       the coupling itself
/// - speed_m_per_s              > 0 (0.002)               b, until a screw drive says otherwise
/// - pitch_m                    > 0 (0.01)                conveyed per turn
/// - length_m                   > 0.01 (0.1)              inlet to nozzle
/// - T_barrel_degC              any (T_m + 10)            the barrel, everywhere and always
/// - nozzle_flux_W_per_m2       any (100)                 q_m
/// - start                      linear | steady (linear)  as the paper starts, or at rest
/// - front0_m                   inside the barrel (0.02; steady: half the length)
/// - T_inlet0_degC              < T_m (T_m - 20)          for start = linear
/// - discretisation             third_order | scharfetter_gummel | coarse_two_point (third_order)
/// - solid_cells, liquid_cells  8..2000 (100, 40)
/// - max_travel_m               > 0 (1e-4)                an Euler step conveys at most so much, two stages 5 x
///
/// [plant] kind = "coupled": the keys of "bizone" (delay_model transport only; density and viscosity from the material,
/// fluctuation_case none by default, x0_m at nominal_x_m or, cold, 0, nominal_x_m 0.08), those of "melt" that are not
/// the barrel's or the start's (preset is the one of "bizone"), and
/// - barrel_exchange_W_per_m3K  >= 0 (9e4)                hbar
/// - start                      running | cold (running)  in production at rest, or everything at T_ambient_degC
/// - front0_m                   inside the barrel (0.08)  for start = running
/// - T_zone0_degC               (T_m + 10)                all zones, for start = running
/// - barrel_zones               1..4 (4)                  and the nozzle
/// - zone_heat_capacity_J_per_K > 0 (600)                 of a zone; the nozzle has a third of it
/// - zone_power_W               >= 0 (500)                of a zone's band; the nozzle's has a third of it
/// - T_ambient_degC             -50..100 (25)
/// - throat_m                   0..length (0.02)          cooled feed throat
/// - T_throat_degC              -50..400 (60)
/// - clogging_m                 > 0 (0.02)                solid this far into the filled zone closes the nozzle
///
/// @throws config::ConfigError for a value out of range.
[[nodiscard]] PlantReading read_plant(const config::Section& section);

/// [[event]] target = "plant": action = "material" with `material`, at at_s.
struct MaterialChange {
  Instant at;
  plant::Polymer polymer;
};

/// Changes of the material in the timeline, in the order of time.
/// @throws config::ConfigError for another action, and for a plant that knows but one polymer.
[[nodiscard]] std::vector<MaterialChange> read_material_changes(const std::vector<config::TimelineEvent>& events,
                                                                const PlantSettings& plant);

}  // namespace meltbench::emulator
