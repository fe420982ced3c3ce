#pragma once
/// Made-up runs that look like those of the delay extruder, for the tests of the report.

#include <algorithm>
#include <cmath>
#include <optional>
#include <string>
#include <vector>

#include "bench/check/check.hpp"
#include "bench/record/run_recorder.hpp"
#include "bench/report/report.hpp"

namespace meltbench::report {

struct SampleRun {
  record::Recording recording;
  check::CheckResults results;
};

/// x rises to 0.16 m in its own way: 0 slowly, 1 with a limit cycle, 2 fast.
inline double sample_x_m(int variant, double t_s) {
  if (t_s < 6) return 0.1;
  if (variant == 0) return 0.16 - 0.06 * std::exp(-(t_s - 6) / 40);
  if (variant == 1) return 0.1765 - 0.0765 * std::exp(-(t_s - 6) / 1.5) + 0.0043 * std::sin(1.4 * (t_s - 6));
  return 0.16 - 0.06 * std::exp(-(t_s - 6) / 1.05);
}

inline SampleRun make_sample_run(int variant, double duration_s = 60, const std::string& folder = {}) {
  const char* const names[] = {"open_loop", "uncompensated", "exact_predictor"};
  record::RunInfo info;
  info.scenario = "delay_compensation";
  info.variant = names[variant];
  info.title = "Delay compensation: three laws on the slow extruder <case A>";
  info.seed = 7;
  info.duration = nanos_from_s(duration_s);
  info.participants = {"plant", "controller"};
  info.nodes = {{5, "feeder"}, {6, "screw_drive"}, {7, "melt_pressure"}};
  info.bit_rate_bit_per_s = 500'000;
  info.version = "meltbench 0.1.0";
  info.repeat_command = "meltbench run fixtures/scenarios/delay_compensation.toml --seed 7";
  const std::vector<SignalInfo> signals{{"plant.x_m"},
                                        {"plant.U"},
                                        {"plant.delay_s"},
                                        {"plant.delay_rate"},
                                        {"plant.flow_kg_per_s"},
                                        {"plant.pressure_Pa"},
                                        {"plant.speed_m_per_s"},
                                        {"plant.feed_kg_per_s"},
                                        {"plant.conveyed_m"},
                                        {"plant.spill_m"},
                                        {"plant.rejected_feed_kg", SignalKind::kErrorCounter},
                                        {"feeder.set_point_kg_per_h"},
                                        {"feeder.net_weight_kg"},
                                        {"melt_pressure.reading_Pa"},
                                        {"controller.x_m"},
                                        {"controller.set_point_m"},
                                        {"controller.P_m"},
                                        {"controller.U_command"},
                                        {"controller.state"},
                                        {"controller.slope"}};
  record::RunRecorder recorder{info, signals, folder};

  const auto rows = static_cast<int>(duration_s * 100);
  for (int i = 0; i <= rows; ++i) {
    const Instant at{i * 10ms};
    const double t_s = 0.01 * i;
    const double x = sample_x_m(variant, t_s);
    const double later = sample_x_m(variant, t_s + 5);
    const double c = 0.015 * (1 + 0.1 * std::cos(t_s * 4 / 60));
    const double v = 2.114 * x / (1 + 2.114 * x);
    const double U = variant == 0 ? 0.2528 : std::clamp(0.2528 + 30 * (0.16 - later), 0.0, 0.9);
    const double noise = 2e-4 * std::sin(977.0 * t_s * t_s);
    recorder.row(at, std::vector<double>{x,
                                         U,
                                         (0.2 - x) / c,
                                         -0.02 * std::cos(t_s / 15),
                                         7e-2 * c * v,
                                         2.9e6 * c * v,
                                         c,
                                         7e-2 * c * U,
                                         0.015 * t_s,
                                         0,
                                         0,
                                         252 * c * U,
                                         12 - 0.001 * t_s,
                                         2.9e6 * c * v + 1e4 * noise,
                                         i < 30 ? std::nan("") : x + noise,
                                         0.16,
                                         later,
                                         U,
                                         i < 20 ? 1.0 : 2.0,
                                         variant == 0 ? 0.0 : 36.3194});
    recorder.frame({at, can::make_frame(0x80, {})}, 1);
    const Nanos late = i % 997 == 996 ? 700us : Nanos{(i * 7919LL) % 40 * 1000};
    recorder.frame({at + 120us, can::make_frame(0x185, {1, 2, 3, 4, 5, 6, 7, 8})}, 0);
    recorder.frame({at + 240us + late, can::make_frame(0x187, {1, 2, 3, 4, 5, 6, 7})}, 0);
    recorder.frame({at + 900us, can::make_frame(0x205, {1, 2, 3, 4})}, 1);
    if (i % 10 == 0) recorder.frame({at + 2ms, can::make_frame(0x705, {5})}, 0);
    if (i < 12) recorder.frame({at + 3ms, can::make_frame(0x605, {0x40, 0, 0x10, 0, 0, 0, 0, 0})}, 1);
  }
  recorder.event("controller", {Instant{120ms}, Severity::kInfo, "operational", "all 3 nodes run"});
  recorder.event("bench", {Instant{}, Severity::kInfo, "start", "seed 7"});
  if (variant == 1) {
    recorder.event("controller",
                   {Instant{31s}, Severity::kWarning, "sync-late", "SYNC 12 ms after the last </script>"});
    recorder.event("plant", {Instant{47s}, Severity::kFault, "watchdog", "no set point for 60 ms"});
  }
  record::Ending ending;
  ending.at = Instant{nanos_from_s(duration_s)};

  SampleRun run{recorder.finish(ending), {}};
  const auto add = [&](const char* name, const char* kind, double margin, const char* unit, std::optional<double> at_s,
                       const char* text) {
    run.results.checks.push_back({name, kind, margin >= 0, margin, unit, at_s, text, ""});
  };
  if (variant == 2) {
    add("settles to 0.1 %", "settle", 0.576, "s", 12.324,
        "within ±0.00016 of 0.16 m from 12.324 s on; asked for: 12.2 s to 12.9 s");
    add("overshoot", "overshoot", 0.0000476, "m", 12.9, "2.4e-06 m beyond 0.16; asked for: at most 5e-05");
  } else if (variant == 1) {
    add("does not settle", "never_settles", 0.0042, "m", 58.6,
        "up to 0.00436 m from 0.16 in the last 10 s; asked for: more "
        "than 0.00016");
    add("swings", "peak_to_peak", -0.0001, "m", 52.1, "0.0096 m from 0.1722 to 0.1808; asked for: 0.008 to 0.0095 m");
  } else {
    add("stays in the barrel", "band", 0.04, "m", 60.0, "nearest to its bounds with 0.1595 m; asked for: 0 to 0.2 m");
  }
  add("SYNC period", "frame_period", 0.0005, "s", 0.01,
      "6001 frames 080, period off by up to 0 ms from 10 ms; asked for: 0.5 "
      "ms");
  run.results.checks.push_back({"temperature",
                                "band",
                                true,
                                0,
                                "K",
                                {},
                                "there is no signal plant.T_K in this run",
                                "there is no signal plant.T_K in this run: the plant is real"});
  if (variant == 1) {
    run.results.health.held = false;
    run.results.health.findings = {"controller: warning sync-late at 31 s: SYNC 12 ms after the last </script>",
                                   "plant: fault watchdog at 47 s: no set point for 60 ms"};
    add("health", "health", -2, "findings", {},
        "controller: warning sync-late at 31 s: SYNC 12 ms after the last </script>; plant: fault watchdog at 47 s: no "
        "set "
        "point for 60 ms");
  } else {
    add("health", "health", 0, "findings", {}, "nothing unexpected");
  }
  return run;
}

}  // namespace meltbench::report
