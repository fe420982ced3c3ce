#pragma once
/// What a rig says about the controller: the keys of [controller], read strictly into plain structs.

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "controller/law/bizone_model.hpp"
#include "controller/safety/interlock.hpp"
#include "protocols/config/rig.hpp"
#include "protocols/config/section.hpp"
#include "protocols/time/instant.hpp"

namespace meltbench::machine {

/// Who a node must be before it is started: 0x1000 and 0x1018 of the EDS that the rig names.
struct Identity {
  std::uint32_t device_type = 0;
  std::uint32_t vendor = 0;
  std::uint32_t product = 0;
  std::uint32_t revision = 0;
};

/// One board to be managed.
struct BoardSettings {
  std::string name;  ///< As in [board.NAME].
  std::uint8_t node_id = 0;
  Nanos heartbeat = 100ms;  ///< Producer heartbeat time to ask of it.
  Identity identity;
};

/// Filled length to hold from an instant on.
struct SetPoint {
  Instant from;
  double x_m = 0.16;
};

/// What the feeder is asked for in the safe state.
enum class SafeFeed : std::uint8_t {
  kOpenLoop,  ///< The rate that leads to the set point and stays there, v(x*): safe for ever.
  kStop,
};

/// What the screw does in the safe state.
enum class SafeScrew : std::uint8_t {
  kKeep,  ///< Turns on: melt does not burn in the barrel.
  kStop,  ///< Quick stop; only with SafeFeed::kStop.
};

/// Everything the controller is told before it runs.
///
/// Keys of [controller]: key, range, (default), what and why:
/// - node_id               1..127 (127)         id of its heartbeat
/// - heartbeat_ms          1..10000 (100)       its heartbeat; boards miss it after three times as long
/// - law                   (exact_predictor)    open_loop | uncompensated | exact_predictor | state_only_predictor |
///                                              paper_predictor
/// - set_point_m           > 0 and < L          filled length to hold; no default: a forgotten one must not feed
/// - slope_margin          > 0 [1/m] (30)       S - Smin of the bang-bang law
/// - v_max                 > v(x*), < 1 (0.9)   largest filling ratio asked of the feeder
/// - time_stamped          (true)               false takes every measurement for one of now: for negative tests
/// - law_starts_at_s       >= 0 (0)             before it the feed holds the filled length of the start
/// - boot_timeout_s        0.01..3600 (5)       per node, from power-up to configured
/// - sdo_timeout_ms        1..10000 (100)       per transfer; the node is then configured anew
/// - measurement_timeout_s 0.001..60 (2)        oldest pressure, encoder sample or feeder report to control with
/// - implausible_s         0..60 (0.2)          how long the pressure may make no sense
/// - max_pressure_bar      > 0 (2 x full screw) above it: safe state
/// - flood_margin_m        0..L (0.002)         filled length this near to the feed throat: safe state
/// - safe_feed             (open_loop)          open_loop | stop
/// - safe_screw            (keep)               keep | stop; stop only with safe_feed = "stop"
/// - feeder_watchdog_ms    1..65535 (board's)   time without set point after which the feeder falls to the safe feed
///
/// Keys of [controller.model], what the controller believes the extruder to be: preset and fluctuation_case (those of
/// [plant], else slow and A), and to change single values: speed_m_per_s, length_m, pitch_m, density_kg_per_m3,
/// pressure_flow_m4, nozzle_kg, area_m2, viscosity_Pa_s, epsilon, omega_rad_per_s,
/// phase_rad (the latter three: those of [plant], else those of the case, 0).
///
/// [[event]] with target = "controller": action = "set_point", value = filled length in m.
struct ControllerSettings {
  std::uint8_t node_id = 127;
  Nanos heartbeat = 100ms;
  Nanos sync_period = 10ms;
  BoardSettings feeder, screw_drive, melt_pressure;

  std::string law = "exact_predictor";
  law::BizoneModel model;
  double pitch_m = 0.01;  ///< Conveyed per screw turn.
  double slope_margin_per_m = 30.0;
  double max_fill = 0.9;
  std::vector<SetPoint> set_points;  ///< In the order of time, the first one from the start of the run.
  bool time_stamped = true;
  Instant law_starts_at;

  Nanos boot_timeout = 5s;
  Nanos sdo_timeout = 100ms;
  safety::Limits limits;
  SafeFeed safe_feed = SafeFeed::kOpenLoop;
  SafeScrew safe_screw = SafeScrew::kKeep;
  std::optional<std::uint16_t> feeder_watchdog_ms;
};

/// Reads [bus], [board.NAME], [controller] and the controller's events, opens the boards' EDS files, and checks that
/// nothing unknown is in the sections that are the controller's.
/// @throws config::ConfigError: also if the rig has not exactly one feeder, one screw drive and one melt pressure, or
/// an
///         EDS cannot be used.
[[nodiscard]] ControllerSettings read_settings(const config::Section& root);

}  // namespace meltbench::machine
