#pragma once
/// Runs a machine with faults in memory, to see whether its bus then shows what a log shows.

#include <optional>
#include <string>
#include <vector>

#include "bench/decode/extraction.hpp"
#include "bench/decode/traces.hpp"
#include "bench/scenario/scenario.hpp"

namespace meltbench::cli {

/// What a run showed on its bus.
struct ClosedLoopResult {
  std::vector<decode::Reaction> reactions;
  decode::Traces traces;
  std::vector<std::string> complaints;  ///< What the health gate has to expect: "controller.emcy", error counters.
};

/// A machine with the settings of a scenario, that is run again and again with other faults: no file, no process, no
/// real part, virtual time.
class ClosedLoop {
 public:
  /// @param settings  its rig, events and settings are taken, its faults and checks are not.
  /// @param end       of every run; events behind it are left out.
  ClosedLoop(scenario::ResolvedRun settings, Instant end);

  /// False where a part of the machine is real, or the controller external: nobody can run those in memory.
  [[nodiscard]] bool is_possible() const;
  /// From now on the bus is as the faults need it. @see make_bus
  void take_bus(const decode::Extraction& found);

  /// Whether such a fault is in the vocabulary of this machine.
  [[nodiscard]] bool knows(const config::Table& fault) const;

  /// @param faults  [[fault]] tables.  @throws config::ConfigError for a fault that the machine cannot have.
  [[nodiscard]] ClosedLoopResult run(const std::vector<config::Table>& faults);
  [[nodiscard]] std::size_t runs() const { return runs_; }
  [[nodiscard]] const scenario::ResolvedRun& settings() const { return settings_; }
  [[nodiscard]] Instant end() const { return end_; }

 private:
  scenario::ResolvedRun settings_;
  Instant end_;
  config::Table tree_;  ///< Without faults.
  std::size_t runs_ = 0;
};

/// [bus] keys in place of those of the settings: "bit-timed" for faults of the wire, with the time to restart that the
/// log shows, if the settings have none; "ideal" where the log shows that nothing was destroyed. Often empty.
[[nodiscard]] config::Table make_bus(const decode::Extraction& found, const config::RigBus& bus);

/// A table's fault as people call it: "sensor.zone2 drift at 12.3 s".
[[nodiscard]] std::string describe_fault(const config::Table& fault);

}  // namespace meltbench::cli
