#include "controller/machine/settings.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <numbers>
#include <string_view>

#include "controller/law/melt_materials.hpp"
#include "protocols/canopen/eds.hpp"
#include "protocols/config/toml.hpp"

namespace meltbench::machine {

namespace {

using config::Section;

constexpr double kPaPerBar = 1e5;
constexpr double kSecondsPerMinute = 60.0;
constexpr double kMmPerM = 1e3;

// --- the model of the filled length

struct Preset {
  std::string_view name;
  double speed_m_per_s;
  double omega_scale;  // Times the published angular frequency: runs 60 times slower fluctuate 60 times slower.
};

constexpr std::array kPresets{
    Preset{"paper", 0.9, 1.0}, Preset{"slow", 0.015, 1.0 / 60.0}, Preset{"phys", 0.015, 1.0},
    Preset{"rad", 0.03 * std::numbers::pi, 1.0},  // 90 rpm = 3 pi rad/s, times the pitch of 0.01 m.
};

struct Fluctuation {
  std::string_view name;
  double epsilon;
  double omega_rad_per_s;
};

constexpr std::array kFluctuations{
    Fluctuation{"none", 0.0, 4.0},
    Fluctuation{"A", 0.1, 4.0},
    Fluctuation{"B", 0.4, 0.8},
};

template <class Rows>
const auto& find_row(const Rows& rows, std::string_view name) {
  return *std::find_if(rows.begin(), rows.end(), [&](const auto& row) { return row.name == name; });
}

/// A text of the controller's own section, else of the emulated plant's if the rig has one, else the default.
std::string read_shared_choice(const Section& model, const Section& plant, std::string_view key,
                               std::string_view otherwise, std::initializer_list<std::string_view> allowed) {
  const std::string fallback = plant.has(key) ? plant.choice(key, allowed) : std::string{otherwise};
  return model.choice_or(key, fallback, allowed);
}

double read_shared_number(const Section& model, const Section& plant, std::string_view key, double otherwise,
                          const config::Range& range) {
  const double fallback = plant.has(key) ? plant.number(key, range) : otherwise;
  return model.number_or(key, fallback, range);
}

/// Which extruder the rig emulates; it has no say in the models of another one.
bool is_plant(const Section& plant, std::string_view kind) {
  return plant.has("kind") ? plant.text("kind") == kind : kind == "bizone";
}

/// Density and mass per length of the melt, and all that follows from them.
void set_melt_density(law::BizoneModel& model, double density_kg_per_m3, double pressure_flow_m4, double area_m2) {
  model.theta2_per_m = model.nozzle_kg / (pressure_flow_m4 * density_kg_per_m3);
  model.mass_per_length_kg_per_m = density_kg_per_m3 * area_m2;
}

std::string read_material_name(const Section& section, const Section& plant) {
  return read_shared_choice(section, plant, "material", "hdpe", {"hdpe", "pla", "ldpe"});
}

void read_model(const Section& model, const Section& rig_plant, ControllerSettings& settings) {
  const Section plant = is_plant(rig_plant, "melt") ? Section{} : rig_plant;
  const bool coupled = is_plant(rig_plant, "coupled");
  const Preset& preset =
      find_row(kPresets, read_shared_choice(model, plant, "preset", "slow", {"paper", "slow", "phys", "rad"}));
  const Fluctuation& fluctuation = find_row(
      kFluctuations, read_shared_choice(model, plant, "fluctuation_case", coupled ? "none" : "A", {"none", "A", "B"}));

  law::BizoneModel& m = settings.model;
  constexpr double kDensity_kg_per_m3 = 1240.0, kPressureFlow_m4 = 9.345e-9, kArea_m2 = 2.2383097e-4;
  const double melt_density =
      coupled ? law::find_melt_material(read_material_name(Section{}, plant), 0.0)->liquid.density_kg_per_m3
              : kDensity_kg_per_m3;
  const double density = model.number_or("density_kg_per_m3", melt_density, config::above(0));
  const double pressure_flow = model.number_or("pressure_flow_m4", kPressureFlow_m4, config::above(0));
  m.length_m = model.number_or("length_m", m.length_m, config::above(0));
  m.nozzle_kg = model.number_or("nozzle_kg", m.nozzle_kg, config::above(0));
  m.viscosity_Pa_s = model.number_or("viscosity_Pa_s", m.viscosity_Pa_s, config::above(0));
  set_melt_density(m, density, pressure_flow, model.number_or("area_m2", kArea_m2, config::above(0)));
  m.speed_m_per_s = model.number_or("speed_m_per_s", preset.speed_m_per_s, config::above(0));
  m.fluctuation = read_shared_number(model, plant, "epsilon", fluctuation.epsilon, config::from_below(0, 1));
  m.fluctuation_rad_per_s = read_shared_number(model, plant, "omega_rad_per_s",
                                               fluctuation.omega_rad_per_s * preset.omega_scale, config::at_least(0));
  m.fluctuation_phase_rad = read_shared_number(model, plant, "phase_rad", 0.0, config::any_number());
  settings.pitch_m = model.number_or("pitch_m", settings.pitch_m, config::above(0));
}

// --- the boards

std::uint32_t read_identity_value(const canopen::ObjectDictionary& dictionary, std::uint16_t index, std::uint8_t sub) {
  return static_cast<std::uint32_t>(dictionary.integer_or(index, sub, 0));
}

Identity read_identity(const config::RigBoard& board) {
  try {
    const canopen::Eds eds =
        canopen::read_eds(config::read_text_file(board.eds, board.section.origin()), board.eds.string(), board.node_id);
    return {.device_type = read_identity_value(eds.dictionary, 0x1000, 0),
            .vendor = read_identity_value(eds.dictionary, 0x1018, 1),
            .product = read_identity_value(eds.dictionary, 0x1018, 2),
            .revision = read_identity_value(eds.dictionary, 0x1018, 3)};
  } catch (const canopen::EdsError& error) {
    board.section.fail("eds", fmt::format("must be a usable EDS: {}", error.what()), error.hint());
  }
}

std::vector<BoardSettings> read_boards(const config::Rig& rig) {
  std::vector<BoardSettings> boards;
  for (const config::RigBoard& board : rig.boards) {
    for (const BoardSettings& other : boards) {
      if (other.kind == board.kind) {
        board.section.fail("kind", fmt::format("there is already board.{} of this kind", other.name),
                           "the controller manages one of each kind");
      }
    }
    if (board.is_on_line() && board.kind != config::BoardKind::kFeeder && board.kind != config::BoardKind::kHeater) {
      board.section.fail("line", fmt::format("the controller knows no {} on a serial line", name_of(board.kind)),
                         "give it node_id and eds instead; feeder and heater can be on a line");
    }
    boards.push_back({.kind = board.kind,
                      .name = board.name,
                      .node_id = board.node_id,
                      .heartbeat = board.heartbeat,
                      .identity = board.is_on_line() ? Identity{} : read_identity(board),
                      .line = board.line,
                      .unit = board.unit});
  }
  std::sort(boards.begin(), boards.end(),
            [](const BoardSettings& left, const BoardSettings& right) { return left.kind < right.kind; });
  return boards;
}

/// Boards come in sets that make a loop.
void check_boards(const Section& root, const ControllerSettings& settings) {
  using config::BoardKind;
  const auto has = [&](BoardKind kind) { return settings.find(kind) != nullptr; };
  const auto need = [&](BoardKind kind, std::string_view hint) {
    if (!has(kind)) root.fail_here(fmt::format("no [board.NAME] with kind = \"{}\"", config::name_of(kind)), hint);
  };
  need(BoardKind::kScrewDrive, "every loop of the controller runs in conveyed metres: it needs the screw's encoder");
  constexpr std::string_view kLength = "the filled length needs a feeder and a melt_pressure";
  constexpr std::string_view kFront = "the melting front needs a preconditioner and a melt_camera";
  const bool front = has(BoardKind::kPreconditioner) || has(BoardKind::kMeltCamera);
  const bool length = has(BoardKind::kFeeder) || has(BoardKind::kMeltPressure) || !front;
  if (length) {
    need(BoardKind::kFeeder, kLength);
    need(BoardKind::kMeltPressure, kLength);
  }
  if (front) {
    need(BoardKind::kPreconditioner, kFront);
    need(BoardKind::kMeltCamera, kFront);
  }
}

// --- the controller's own keys

config::Range set_point_range(double length_m) {
  return config::inside(0, length_m, "the filled length to hold lies inside the screw, e.g. set_point_m = 0.16");
}

std::vector<SetPoint> read_first_set_point(const Section& controller, const ControllerSettings& settings) {
  return {{Instant{}, controller.number("set_point_m", set_point_range(settings.model.length_m))}};
}

void read_law(const Section& controller, ControllerSettings& settings) {
  settings.law = controller.choice_or(
      "law", settings.law,
      {"open_loop", "uncompensated", "exact_predictor", "state_only_predictor", "paper_predictor"});
  settings.slope_margin_per_m =
      controller.number_or("slope_margin", settings.slope_margin_per_m,
                           config::above(0, "how much steeper than needed the law is; 30 shows what a delay does"));
  double highest = 0.0;
  for (const SetPoint& set_point : settings.set_points) highest = std::max(highest, set_point.x_m);
  settings.max_fill =
      controller.number_or("v_max", settings.max_fill,
                           config::inside(settings.model.holding_ratio(highest), 1,
                                          "more than what holds the set point, less than a full channel"));
  settings.time_stamped = controller.boolean_or("time_stamped", settings.time_stamped);
  settings.law_starts_at = Instant{controller.duration_or("law_starts_at_s", 0)};
}

/// Pressure over the nozzle with a full screw at nominal speed.
double calc_full_pressure_Pa(const law::BizoneModel& model) {
  const double flow = model.feed_kg_per_s(model.holding_ratio(model.length_m), model.speed_m_per_s);
  return flow * model.viscosity_Pa_s / model.nozzle_kg;
}

void read_safety(const Section& controller, ControllerSettings& settings) {
  safety::Limits& limits = settings.limits;
  const double length_m = settings.model.length_m;
  limits.max_implausible_time = controller.duration_or("implausible_s", 0.2, config::between(0, 60));
  const double full_bar = calc_full_pressure_Pa(settings.model) / kPaPerBar;
  limits.max_pressure_Pa = kPaPerBar * controller.number_or("max_pressure_bar", 2.0 * full_bar, config::above(0));
  limits.max_filled_length_m =
      length_m - controller.number_or("flood_margin_m", 0.002, config::from_below(0, length_m));
  settings.max_disagreement_m = controller.number_or("disagree_m", settings.max_disagreement_m, config::above(0));
  limits.max_disagreement_time = controller.duration_or("disagree_s", 1, config::between(0, 60));
  limits.max_unechoed_time = controller.duration_or("not_echoed_s", 2, config::between(0.1, 60));
  settings.safe_feed = controller.choice_or<SafeFeed>("safe_feed", SafeFeed::kOpenLoop,
                                                      {{"open_loop", SafeFeed::kOpenLoop}, {"stop", SafeFeed::kStop}});
  if (controller.has("feeder_watchdog_ms")) {
    settings.feeder_watchdog_ms =
        static_cast<std::uint16_t>(controller.integer("feeder_watchdog_ms", config::between(1, 65535)));
  }
}

void read_safe_screw(const Section& controller, ControllerSettings& settings) {
  settings.safe_screw = controller.choice_or<SafeScrew>("safe_screw", SafeScrew::kKeep,
                                                        {{"keep", SafeScrew::kKeep}, {"stop", SafeScrew::kStop}});
  const bool feeds = settings.has_length_loop() && settings.safe_feed != SafeFeed::kStop;
  if (settings.safe_screw == SafeScrew::kStop && feeds) {
    controller.fail("safe_screw", "must come with safe_feed = \"stop\"", "feed on a standing screw blocks the throat");
  }
}

void read_times(const Section& controller, ControllerSettings& settings) {
  settings.heartbeat = controller.duration_or("heartbeat_ms", 100, config::between(1, 10'000));
  settings.boot_timeout = controller.duration_or("boot_timeout_s", 5, config::between(0.01, 3600));
  settings.sdo_timeout = controller.duration_or("sdo_timeout_ms", 100, config::between(1, 10'000));
  settings.serial.answer_timeout = controller.duration_or("serial_timeout_ms", 50, config::between(1, 10'000));
  settings.serial.retries = static_cast<unsigned>(controller.integer_or("serial_retries", 2, config::between(0, 10)));
  settings.limits.max_wrong_speed_time = controller.duration_or("wrong_speed_s", 1, config::between(0.1, 60));
  settings.limits.max_age = controller.duration_or("measurement_timeout_s", 2, config::between(0.001, 60));
  settings.screw_ramp_rev_per_s2 =
      controller.number_or("screw_ramp_rpm_per_s", 60, config::above(0)) / kSecondsPerMinute;
}

// --- the melting front

/// Single values of a model, by their names in [K19] Table 1.
void read_melt_values(const Section& section, law::MeltModel& m) {
  const auto positive = [&](std::string_view key, double& value) {
    value = section.number_or(key, value, config::above(0));
  };
  positive("solid_conductivity_W_per_mK", m.solid.conductivity_W_per_mK);
  positive("solid_density_kg_per_m3", m.solid.density_kg_per_m3);
  positive("solid_heat_capacity_J_per_kgK", m.solid.heat_capacity_J_per_kgK);
  positive("liquid_conductivity_W_per_mK", m.liquid.conductivity_W_per_mK);
  positive("liquid_density_kg_per_m3", m.liquid.density_kg_per_m3);
  positive("liquid_heat_capacity_J_per_kgK", m.liquid.heat_capacity_J_per_kgK);
  positive("heat_of_fusion_J_per_kg", m.heat_of_fusion_J_per_kg);
  m.T_melt_degC = section.number_or("T_melt_degC", m.T_melt_degC, config::between(0, 400));
}

/// A material with its machine: keys material, preset, barrel_exchange_W_per_m3K, length_m, nozzle_flux_W_per_m2.
/// @param rig_plant  the emulated plant's section, for defaults.
law::MeltModel read_melt_model(const Section& section, const Section& rig_plant, const ControllerSettings& settings) {
  const Section plant = is_plant(rig_plant, "bizone") ? Section{} : rig_plant;
  const bool coupled = is_plant(rig_plant, "coupled");
  constexpr double kPaper_W_per_m3K = 2e4, kBench_W_per_m3K = 9e4;
  double exchange = kBench_W_per_m3K;
  if (!coupled && read_shared_choice(section, plant, "preset", "paper", {"paper", "bench"}) == "paper") {
    exchange = kPaper_W_per_m3K;
  }
  exchange = read_shared_number(section, plant, "barrel_exchange_W_per_m3K", exchange, config::at_least(0));
  law::MeltModel model = law::find_melt_material(read_material_name(section, plant), exchange).value();
  const double length_m = settings.has_length_loop() ? settings.model.length_m : model.length_m;
  model.length_m = read_shared_number(section, plant, "length_m", length_m, config::above(0.01));
  model.nozzle_flux_W_per_m2 =
      read_shared_number(section, plant, "nozzle_flux_W_per_m2", model.nozzle_flux_W_per_m2, config::any_number());
  read_melt_values(section, model);
  return model;
}

config::Range front_range(double length_m) {
  return config::inside(0, length_m, "the melting front lies inside the barrel, from the inlet, e.g. 0.05");
}

double read_barrel(const Section& section, const Section& plant, const law::MeltModel& model) {
  return read_shared_number(section, plant, "T_barrel_degC", model.T_melt_degC + 10.0, config::between(0, 400));
}

void read_melt_limits(const Section& melt, MeltSettings& settings) {
  safety::MeltLimits& limits = settings.limits;
  limits.max_superheat_K = melt.number_or("max_superheat_K", limits.max_superheat_K, config::above(0));
  limits.max_undercooling_K = melt.number_or("max_undercooling_K", limits.max_undercooling_K, config::above(0));
  limits.max_coasted_share = melt.number_or("max_coasted_share", limits.max_coasted_share, config::above(0));
  limits.T_melt_degC = settings.model.T_melt_degC;
  limits.length_m = settings.model.length_m;
}

/// Neither paper has a viscosity that depends on temperature: an extruder without a melting front has none.
ViscosityModel read_viscosity(const Section& section, std::string_view material, const law::MeltModel& model) {
  constexpr double kBarrelExcess_K = 10.0;
  return {
      .per_K = section.number_or("viscosity_per_K", law::find_viscosity_decay_1_per_K(material), config::at_least(0)),
      .at_degC = section.number_or("viscosity_at_degC", model.T_melt_degC + kBarrelExcess_K, config::any_number())};
}

MeltSettings read_melt(const Section& melt, const Section& rig_plant, ControllerSettings& settings) {
  const Section plant = is_plant(rig_plant, "melt") ? rig_plant : Section{};
  MeltSettings m;
  m.law = melt.choice_or("law", m.law,
                         {"output_feedback", "output_feedback_capped", "output_feedback_direct", "open_loop", "pi"});
  const Section model = melt.section_or_empty("model");
  m.model = read_melt_model(model, rig_plant, settings);
  m.T_barrel_degC = read_barrel(model, plant, m.model);
  if (!settings.has_length_loop()) {
    constexpr double kSlowest_m_per_s = 0.002;
    settings.model.speed_m_per_s =
        read_shared_number(model, plant, "speed_m_per_s", kSlowest_m_per_s, config::above(0));
    settings.pitch_m = read_shared_number(model, plant, "pitch_m", settings.pitch_m, config::above(0));
  }
  m.speed_m_per_s = settings.model.speed_m_per_s;
  m.front_set_m = melt.number("front_set_point_m", front_range(m.model.length_m));
  auto& law = m.backstepping;
  law.convergence_per_travel_1_per_m =
      melt.number_or("c_per_travel_1_per_m", law.convergence_per_travel_1_per_m, config::above(0));
  law.trim_rate_K_per_m2 = melt.number_or("trim_K_per_m2", law.trim_rate_K_per_m2, config::at_least(0));
  law.trim_gate_m = melt.number_or("trim_gate_m", law.trim_gate_m, config::above(0));
  law.trim_limit_K = melt.number_or("trim_limit_K", law.trim_limit_K, config::above(0));
  m.pi.proportional_W_per_m3 =
      melt.number_or("pi_proportional_W_per_m3", m.pi.proportional_W_per_m3, config::any_number());
  m.pi.integral_W_per_m3s = melt.number_or("pi_integral_W_per_m3s", m.pi.integral_W_per_m3s, config::any_number());
  m.observer_cells = static_cast<std::size_t>(melt.integer_or("observer_cells", 100, config::between(20, 400)));
  m.start_below_K = melt.number_or("observer_start_below_K", m.start_below_K, config::at_least(0));
  m.max_gain_ramp_m_per_s2 =
      melt.number_or("gain_ramp_mm_per_s2", kMmPerM * m.max_gain_ramp_m_per_s2, config::above(0)) / kMmPerM;
  read_melt_limits(melt, m);
  return m;
}

std::vector<MaterialSettings> read_materials(const Section& controller, const Section& plant,
                                             const ControllerSettings& settings) {
  std::vector<MaterialSettings> materials;
  const Section all = controller.section_or_empty("material");
  for (const std::string& name : all.keys()) {
    const Section section = all.section(name);
    MaterialSettings material;
    material.name = name;
    material.model = read_melt_model(section, plant, settings);
    material.T_barrel_degC =
        section.number_or("T_barrel_degC", material.model.T_melt_degC + 10.0, config::between(0, 400));
    material.front_set_m =
        section.number_or("front_set_point_m", settings.melt->front_set_m, front_range(material.model.length_m));
    material.filled = settings.model;
    const double denser = material.model.liquid.density_kg_per_m3 / settings.melt->model.liquid.density_kg_per_m3;
    material.filled.theta2_per_m /= denser;
    material.filled.mass_per_length_kg_per_m *= denser;
    material.viscosity = read_viscosity(section, read_material_name(section, plant), material.model);
    materials.push_back(material);
  }
  return materials;
}

// --- zones and sequence

ZoneSettings read_zones(const Section& section) {
  ZoneSettings zones;
  constexpr config::Range kSetPoint = config::between(0, 400, "degrees Celsius, e.g. 145");
  const std::vector<double> barrel = section.numbers("barrel_degC", kSetPoint);
  if (barrel.empty() || barrel.size() >= kNozzleChannel) {
    section.fail("barrel_degC", "must have 1 to 4 numbers", "one for each barrel zone, from the feed throat on");
  }
  for (const double T_degC : barrel) zones.zones.push_back({zones.zones.size() + 1, T_degC});
  if (section.has("nozzle_degC")) zones.zones.push_back({kNozzleChannel, section.number("nozzle_degC", kSetPoint)});
  double highest = 0.0;
  for (const ZoneSettings::Zone& zone : zones.zones) highest = std::max(highest, zone.set_degC);
  constexpr double kHeadroom_K = 40.0;
  zones.band_K = section.number_or("band_K", zones.band_K, config::above(0));
  zones.timeout = section.duration_or("timeout_s", 2, config::above(0));
  safety::ZoneLimits& limits = zones.limits;
  limits.max_degC = section.number_or("max_degC", highest + kHeadroom_K, config::between(highest, 600));
  limits.window = section.duration_or("window_s", to_s(limits.window), config::above(0));
  limits.min_rise_K = section.number_or("min_rise_K", limits.min_rise_K, config::above(0));
  limits.max_still_output = section.number_or("max_still_output", limits.max_still_output, config::above_up_to(0, 1));
  limits.max_step_K = section.number_or("max_step_K", limits.max_step_K, config::above(0));
  limits.max_unasked_rise_K = section.number_or("max_unasked_K", limits.max_unasked_rise_K, config::above(0));
  return zones;
}

SequenceSettings read_sequence(const Section& section, double run_rev_per_s) {
  SequenceSettings sequence;
  const auto rev_per_s = [&](std::string_view key, double fallback_rev_per_s) {
    return section.number_or(key, fallback_rev_per_s * kSecondsPerMinute, config::above(0)) / kSecondsPerMinute;
  };
  sequence.soak = section.duration_or("soak_s", to_s(sequence.soak));
  sequence.fill = section.duration_or("fill_s", to_s(sequence.fill));
  sequence.fill_timeout = section.duration_or("fill_timeout_s", to_s(sequence.fill_timeout), config::above(0));
  sequence.heat_timeout = section.duration_or("heat_timeout_s", to_s(sequence.heat_timeout), config::above(0));
  sequence.hold_rev_per_s = rev_per_s("hold_rpm", 0.5 * run_rev_per_s);
  sequence.purge_rev_per_s = rev_per_s("purge_rpm", run_rev_per_s);
  sequence.purge = section.duration_or("purge_s", to_s(sequence.purge), config::above(0));
  return sequence;
}

// --- the timeline

std::size_t find_material(const Section& event, const ControllerSettings& settings) {
  const std::string name = event.text("name");
  for (std::size_t i = 0; i < settings.materials.size(); ++i) {
    if (settings.materials[i].name == name) return i;
  }
  event.fail("name", "is no [controller.material.NAME]",
             "a material has a table of its own in the rig or the scenario");
}

std::size_t read_zone(const Section& event, const ZoneSettings& zones) {
  const auto channel = static_cast<std::size_t>(event.integer("zone", config::between(1, kMaxZones)));
  const bool there = std::any_of(zones.zones.begin(), zones.zones.end(),
                                 [&](const ZoneSettings::Zone& zone) { return zone.channel == channel; });
  if (!there) event.fail("zone", "is not heated", "zones are counted from the feed throat on, 5 is the nozzle");
  return channel;
}

Order read_order(const config::TimelineEvent& event, const ControllerSettings& settings) {
  const Section& section = event.section;
  Order order{.at = event.at};
  const auto must_have = [&](bool there, std::string_view what) {
    if (!there) section.fail("action", fmt::format("needs {}", what), "this rig has none");
  };
  if (event.action == "front_set_point") {
    must_have(settings.melt.has_value(), "a loop of the melting front");
    order.kind = Order::Kind::kFrontSetPoint;
    order.value = section.number("value", front_range(settings.melt->model.length_m));
  } else if (event.action == "screw_speed") {
    order.kind = Order::Kind::kScrewSpeed;
    order.value = section.number("rpm", config::above(0)) / kSecondsPerMinute;
  } else if (event.action == "zone_set_point") {
    must_have(settings.zones.has_value(), "heated zones");
    order.kind = Order::Kind::kZoneSetPoint;
    order.value = section.number("value", config::between(0, settings.zones->limits.max_degC));
  } else if (event.action == "autotune") {
    must_have(settings.zones.has_value(), "heated zones");
    must_have(!settings.board(config::BoardKind::kHeater).is_on_line(), "a heater on CAN");
    order.kind = Order::Kind::kAutotune;
    order.index = read_zone(section, *settings.zones);
  } else if (event.action == "material") {
    must_have(settings.melt.has_value(), "a loop of the melting front");
    order.kind = Order::Kind::kMaterial;
    order.index = find_material(section, settings);
  } else {
    order.kind = Order::Kind::kSequence;
    order.order = section.choice<SequenceOrder>("action", {{"start", SequenceOrder::kStart},
                                                           {"hold", SequenceOrder::kHold},
                                                           {"purge", SequenceOrder::kPurge},
                                                           {"shut_down", SequenceOrder::kShutDown},
                                                           // Read elsewhere; here for the list of what there is.
                                                           {"set_point", {}},
                                                           {"front_set_point", {}},
                                                           {"screw_speed", {}},
                                                           {"zone_set_point", {}},
                                                           {"autotune", {}},
                                                           {"material", {}}});
    // Without a sequence there is still something to start: a controller that is in its safe state.
    if (order.order != SequenceOrder::kStart) must_have(settings.sequence.has_value(), "a [controller.sequence]");
  }
  return order;
}

void read_timeline(const Section& root, const config::Rig& rig, ControllerSettings& settings) {
  for (const config::TimelineEvent& event : config::read_events(root, rig, "controller")) {
    if (event.action == "set_point") {
      if (!settings.has_length_loop()) event.section.fail("action", "needs a loop of the filled length");
      settings.set_points.push_back(
          {event.at, event.section.number("value", set_point_range(settings.model.length_m))});
    } else {
      settings.orders.push_back(read_order(event, settings));
    }
    event.section.finish();
  }
}

}  // namespace

const BoardSettings* ControllerSettings::find(config::BoardKind kind) const {
  const auto found =
      std::find_if(boards.begin(), boards.end(), [&](const BoardSettings& board) { return board.kind == kind; });
  return found == boards.end() ? nullptr : &*found;
}

ControllerSettings read_settings(const config::Section& root) {
  const config::Rig rig = config::read_rig(root);
  ControllerSettings settings;
  settings.node_id = rig.controller_node_id;
  settings.sync_period = rig.bus.sync_period;
  settings.boards = read_boards(rig);
  check_boards(root, settings);
  for (const config::RigLine& line : rig.lines) {
    const bool used = std::any_of(settings.boards.begin(), settings.boards.end(),
                                  [&](const BoardSettings& board) { return board.line == line.name; });
    if (used) settings.lines.push_back(line);
  }

  const Section controller = root.section("controller");
  const Section plant = root.peek("plant");
  read_times(controller, settings);
  if (settings.has_length_loop()) {
    read_model(controller.section_or_empty("model"), plant, settings);
    settings.set_points = read_first_set_point(controller, settings);
  }
  if (settings.find(config::BoardKind::kMeltCamera) != nullptr) {
    settings.melt = read_melt(controller.section("melt"), plant, settings);
    settings.materials = read_materials(controller, plant, settings);
    if (settings.has_length_loop()) {
      const Section model = controller.section("melt").section_or_empty("model");
      settings.viscosity = read_viscosity(controller, read_material_name(model, plant), settings.melt->model);
    }
  }
  if (settings.find(config::BoardKind::kHeater) != nullptr) settings.zones = read_zones(controller.section("zones"));
  if (controller.has("sequence")) {
    settings.sequence = read_sequence(controller.section("sequence"), settings.run_speed_rev_per_s());
  }
  read_timeline(root, rig, settings);
  if (settings.has_length_loop()) {
    read_law(controller, settings);
    read_safety(controller, settings);
  }
  read_safe_screw(controller, settings);
  root.finish();
  return settings;
}

}  // namespace meltbench::machine
