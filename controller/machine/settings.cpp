#include "controller/machine/settings.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <numbers>
#include <string_view>

#include "protocols/canopen/eds.hpp"
#include "protocols/config/toml.hpp"

namespace meltbench::machine {

namespace {

using config::Section;

constexpr double kPaPerBar = 1e5;

// --- the model

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

void read_model(const Section& model, const Section& plant, ControllerSettings& settings) {
  const Preset& preset =
      find_row(kPresets, read_shared_choice(model, plant, "preset", "slow", {"paper", "slow", "phys", "rad"}));
  const Fluctuation& fluctuation =
      find_row(kFluctuations, read_shared_choice(model, plant, "fluctuation_case", "A", {"none", "A", "B"}));

  law::BizoneModel& m = settings.model;
  constexpr double kDensity_kg_per_m3 = 1240.0, kPressureFlow_m4 = 9.345e-9, kArea_m2 = 2.2383097e-4;
  const double density = model.number_or("density_kg_per_m3", kDensity_kg_per_m3, config::above(0));
  const double pressure_flow = model.number_or("pressure_flow_m4", kPressureFlow_m4, config::above(0));
  m.length_m = model.number_or("length_m", m.length_m, config::above(0));
  m.nozzle_kg = model.number_or("nozzle_kg", m.nozzle_kg, config::above(0));
  m.viscosity_Pa_s = model.number_or("viscosity_Pa_s", m.viscosity_Pa_s, config::above(0));
  m.theta2_per_m = m.nozzle_kg / (pressure_flow * density);
  m.mass_per_length_kg_per_m = density * model.number_or("area_m2", kArea_m2, config::above(0));
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

BoardSettings read_board(const Section& root, const config::Rig& rig, config::BoardKind kind) {
  const config::RigBoard* found = nullptr;
  for (const config::RigBoard& board : rig.boards) {
    if (board.kind != kind) continue;
    if (found != nullptr) {
      board.section.fail("kind", fmt::format("there is already board.{} of this kind", found->name),
                         "the controller manages one of each kind");
    }
    found = &board;
  }
  if (found == nullptr) {
    root.fail_here(fmt::format("no [board.NAME] with kind = \"{}\"", config::name_of(kind)),
                   "the controller needs a feeder, a screw_drive and a melt_pressure");
  }
  return {
      .name = found->name, .node_id = found->node_id, .heartbeat = found->heartbeat, .identity = read_identity(*found)};
}

// --- the controller's own keys

config::Range set_point_range(double length_m) {
  return config::inside(0, length_m, "the filled length to hold lies inside the screw, e.g. set_point_m = 0.16");
}

void read_set_points(const Section& root, const config::Rig& rig, const Section& controller,
                     ControllerSettings& settings) {
  const config::Range range = set_point_range(settings.model.length_m);
  settings.set_points = {{Instant{}, controller.number("set_point_m", range)}};
  for (const config::TimelineEvent& event : config::read_events(root, rig, "controller")) {
    if (event.action != "set_point") {
      event.section.fail("action", "must be \"set_point\"", "it is all that a timeline can ask of the controller");
    }
    settings.set_points.push_back({event.at, event.section.number("value", range)});
    event.section.finish();
  }
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
  limits.max_age = controller.duration_or("measurement_timeout_s", 2, config::between(0.001, 60));
  limits.max_implausible_time = controller.duration_or("implausible_s", 0.2, config::between(0, 60));
  const double full_bar = calc_full_pressure_Pa(settings.model) / kPaPerBar;
  limits.max_pressure_Pa = kPaPerBar * controller.number_or("max_pressure_bar", 2.0 * full_bar, config::above(0));
  limits.max_filled_length_m =
      length_m - controller.number_or("flood_margin_m", 0.002, config::from_below(0, length_m));
  settings.safe_feed = controller.choice_or<SafeFeed>("safe_feed", SafeFeed::kOpenLoop,
                                                      {{"open_loop", SafeFeed::kOpenLoop}, {"stop", SafeFeed::kStop}});
  settings.safe_screw = controller.choice_or<SafeScrew>("safe_screw", SafeScrew::kKeep,
                                                        {{"keep", SafeScrew::kKeep}, {"stop", SafeScrew::kStop}});
  if (settings.safe_screw == SafeScrew::kStop && settings.safe_feed != SafeFeed::kStop) {
    controller.fail("safe_screw", "must come with safe_feed = \"stop\"", "feed on a standing screw blocks the throat");
  }
  if (controller.has("feeder_watchdog_ms")) {
    settings.feeder_watchdog_ms =
        static_cast<std::uint16_t>(controller.integer("feeder_watchdog_ms", config::between(1, 65535)));
  }
}

void read_times(const Section& controller, ControllerSettings& settings) {
  settings.heartbeat = controller.duration_or("heartbeat_ms", 100, config::between(1, 10'000));
  settings.boot_timeout = controller.duration_or("boot_timeout_s", 5, config::between(0.01, 3600));
  settings.sdo_timeout = controller.duration_or("sdo_timeout_ms", 100, config::between(1, 10'000));
}

}  // namespace

ControllerSettings read_settings(const config::Section& root) {
  const config::Rig rig = config::read_rig(root);
  ControllerSettings settings;
  settings.node_id = rig.controller_node_id;
  settings.sync_period = rig.bus.sync_period;
  settings.feeder = read_board(root, rig, config::BoardKind::kFeeder);
  settings.screw_drive = read_board(root, rig, config::BoardKind::kScrewDrive);
  settings.melt_pressure = read_board(root, rig, config::BoardKind::kMeltPressure);

  const Section controller = root.section("controller");
  read_model(controller.section_or_empty("model"), root.peek("plant"), settings);
  read_set_points(root, rig, controller, settings);
  read_law(controller, settings);
  read_safety(controller, settings);
  read_times(controller, settings);
  root.finish();
  return settings;
}

}  // namespace meltbench::machine
