#pragma once
/// What a rig says about the controller: the keys of [controller], read strictly into plain structs.

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "controller/law/bizone_model.hpp"
#include "controller/machine/melt_loop.hpp"
#include "controller/machine/sequence.hpp"
#include "controller/machine/zone_settings.hpp"
#include "controller/safety/interlock.hpp"
#include "protocols/config/rig.hpp"
#include "protocols/config/section.hpp"
#include "protocols/modbus/rtu_client.hpp"
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
  config::BoardKind kind{};
  std::string name;  ///< As in [board.NAME].
  std::uint8_t node_id = 0;
  Nanos heartbeat = 100ms;  ///< Producer heartbeat time to ask of it.
  Identity identity;
  std::string line{};     ///< If it is not on CAN: the serial line that it is on,
  std::uint8_t unit = 0;  ///< and its Modbus address there.

  [[nodiscard]] bool is_on_line() const { return !line.empty(); }
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

/// What the timeline asks of the controller at an instant.
struct Order {
  enum class Kind : std::uint8_t {
    kFrontSetPoint,  ///< value = melting front to hold [m].
    kScrewSpeed,     ///< value = speed of the running screw [rev/s], reached by the ramp.
    kZoneSetPoint,   ///< value = set point of all barrel zones [°C]; the nozzle's stays.
    kAutotune,       ///< index = channel of the zone that the heater board shall try out.
    kMaterial,       ///< materials[index] is in the hopper now: model, front, barrel and speed change to it.
    kSequence,       ///< order of the sequence.
  };
  Instant at;
  Kind kind{};
  double value = 0.0;
  std::size_t index = 0;
  SequenceOrder order{};
};

/// How the viscosity of the melt follows its temperature: eta exp(-per_K (T - at_degC)).
struct ViscosityModel {
  double per_K = 0.0;  ///< 0: it does not, and the temperature of the melt is not asked for.
  double at_degC = 0.0;
};

/// What changes with the granules; [controller.material.NAME], keys of [controller.melt.model], T_barrel_degC,
/// front_set_point_m, viscosity_per_K and viscosity_at_degC.
struct MaterialSettings {
  std::string name;
  law::MeltModel model = law::hdpe_melt_model(2e4);
  law::BizoneModel filled;
  ViscosityModel viscosity;
  double T_barrel_degC = 145.0;
  double front_set_m = 0.05;
};

/// Everything the controller is told before it runs.
///
/// Loops are there as the boards are: feeder and melt_pressure for the filled length, preconditioner and melt_camera
/// for the melting front, heater for the zones. The screw drive is always there.
///
/// Keys of [controller]: key, range, (default), what and why:
/// - node_id               1..127 (127)         id of its heartbeat
/// - heartbeat_ms          1..10000 (100)       its heartbeat; boards miss it after three times as long
/// - boot_timeout_s        0.01..3600 (5)       per node, from power-up to configured
/// - sdo_timeout_ms        1..10000 (100)       per transfer; the node is then configured anew
/// - serial_timeout_ms     1..10000 (50)        for an answer of a board on a serial line; then it is asked again,
/// - serial_retries        0..10 (2)            so many times, before it is lost
/// - measurement_timeout_s 0.001..60 (2)        oldest pressure, encoder sample or feeder report to control with
/// - wrong_speed_s         0.1..60 (1)          the encoder may show another speed than asked for so long
/// - safe_screw            (keep)               keep | stop; stop only with safe_feed = "stop" if there is a feeder
/// - screw_ramp_rpm_per_s  > 0 (60)             how fast the controller changes the speed of a screw that it moves
///
/// With a loop of the filled length:
/// - law                   (exact_predictor)    open_loop | uncompensated | exact_predictor | state_only_predictor |
///                                              paper_predictor
/// - set_point_m           > 0 and < L          filled length to hold; no default: a forgotten one must not feed
/// - slope_margin          > 0 [1/m] (30)       S - Smin of the bang-bang law
/// - v_max                 > v(x*), < 1 (0.9)   largest filling ratio asked of the feeder
/// - time_stamped          (true)               false takes every measurement for one of now: for negative tests
/// - law_starts_at_s       >= 0 (0)             before it the feed holds the filled length of the start
/// - implausible_s         0..60 (0.2)          how long the pressure may make no sense
/// - max_pressure_bar      > 0 (2 x full screw) above it: safe state
/// - flood_margin_m        0..L (0.002)         filled length this near to the feed throat: safe state
/// - disagree_m            > 0 (0.02)           pressure and what was fed may tell filled lengths this far apart
/// - disagree_s            0..60 (1)            for so long; such a pressure is not used meanwhile. Not watched if the
///                                              screw conveys more than 1 mm per cycle
/// - not_echoed_s          0.1..60 (2)          the feeder may report another flow than asked for so long
/// - safe_feed             (open_loop)          open_loop | stop
/// - feeder_watchdog_ms    1..65535 (board's)   time without set point after which the feeder falls to the safe feed
/// and where there is a melting front as well, so that the melt's temperature decides the pressure:
/// - viscosity_per_K       >= 0 (material's)    k [1/K] of eta exp(-k (T - viscosity_at_degC)), T measured; 0 =
/// constant
/// - viscosity_at_degC     (T_m + 10)           where the model's viscosity holds
/// and [controller.model], what it believes the extruder to be: preset and fluctuation_case (those of [plant], else
/// slow and A), and to change single values: speed_m_per_s, length_m, pitch_m, density_kg_per_m3, pressure_flow_m4,
/// nozzle_kg, area_m2, viscosity_Pa_s, epsilon, omega_rad_per_s, phase_rad (the latter three: those of [plant], else
/// those of the case, 0).
///
/// Keys of [controller.melt], with a loop of the melting front: law (output_feedback) open_loop | pi | output_feedback
/// | output_feedback_capped | output_feedback_direct; front_set_point_m > 0 and < L, no default; c_per_travel_1_per_m >
/// 0 (100); pi_proportional_W_per_m3 (300); pi_integral_W_per_m3s (4.5); trim_K_per_m2 >= 0 (0: off), trim_gate_m > 0
/// (0.002), trim_limit_K > 0 (5); observer_cells 20..400 (100); observer_start_below_K >= 0 (20);
/// gain_ramp_mm_per_s2 > 0 (10); max_superheat_K > 0 (10); max_undercooling_K > 0 (10); max_coasted_share > 0 (0.5),
/// of s/b.
/// Keys of [controller.melt.model]: material (the plant's, else HDPE), barrel_exchange_W_per_m3K, T_barrel_degC,
/// speed_m_per_s, length_m, nozzle_flux_W_per_m2, and those of MeltModel one by one.
///
/// Keys of [controller.zones], with a heater: zone_settings.hpp. Keys of [controller.sequence]: sequence.hpp.
///
/// [[event]] with target = "controller", action and its keys:
/// - set_point        value = filled length in m
/// - front_set_point  value = melting front in m
/// - screw_speed      rpm
/// - zone_set_point   value = degrees Celsius of all barrel zones
/// - autotune         zone = 1..4 from the feed throat on, 5 the nozzle: the heater board tries it out, and tunes it
/// - material         name of a [controller.material.NAME]
/// - start | hold | purge | shut_down   start needs no sequence: it ends the safe state and the state of fault
struct ControllerSettings {
  std::uint8_t node_id = 127;
  Nanos heartbeat = 100ms;
  Nanos sync_period = 10ms;
  std::vector<BoardSettings> boards;  ///< At most one of each kind, in the order of BoardKind.

  // The loop of the filled length.
  std::string law = "exact_predictor";
  law::BizoneModel model;
  double pitch_m = 0.01;  ///< Conveyed per screw turn.
  double slope_margin_per_m = 30.0;
  double max_fill = 0.9;
  std::vector<SetPoint> set_points;  ///< In the order of time, the first one from the start of the run.
  bool time_stamped = true;
  Instant law_starts_at;
  ViscosityModel viscosity;

  std::optional<MeltSettings> melt;
  std::vector<MaterialSettings> materials;
  std::optional<ZoneSettings> zones;
  std::optional<SequenceSettings> sequence;  ///< None: everything runs from the start, as in the middle of production.
  std::vector<Order> orders;                 ///< In the order of time.

  Nanos boot_timeout = 5s;
  Nanos sdo_timeout = 100ms;
  modbus::ClientTimes serial{.answer_timeout = 50ms};
  std::vector<config::RigLine> lines;  ///< That have boards on them.
  safety::Limits limits;
  double max_disagreement_m = 0.02;  ///< Of pressure and mass balance.
  SafeFeed safe_feed = SafeFeed::kOpenLoop;
  SafeScrew safe_screw = SafeScrew::kKeep;
  std::optional<std::uint16_t> feeder_watchdog_ms;
  double screw_ramp_rev_per_s2 = 1.0;

  /// The board of a kind, or nothing.
  [[nodiscard]] const BoardSettings* find(config::BoardKind kind) const;
  /// @pre there is one.
  [[nodiscard]] const BoardSettings& board(config::BoardKind kind) const { return *find(kind); }
  [[nodiscard]] bool has_length_loop() const { return find(config::BoardKind::kFeeder) != nullptr; }
  [[nodiscard]] double run_speed_rev_per_s() const { return model.speed_m_per_s / pitch_m; }
};

/// Reads [bus], [board.NAME], [controller] and the controller's events, opens the boards' EDS files, and checks that
/// nothing unknown is in the sections that are the controller's.
/// @throws config::ConfigError: also if the boards of the rig make no loop, or an EDS cannot be used.
[[nodiscard]] ControllerSettings read_settings(const config::Section& root);

}  // namespace meltbench::machine
