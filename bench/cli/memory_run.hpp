#pragma once

#include <vector>

#include "bench/bus/run_observer.hpp"
#include "bench/bus/virtual_time.hpp"
#include "bench/cli/prepare_run.hpp"
#include "protocols/runtime/participant_port.hpp"

namespace meltbench::cli {

/// A run of both sides in this process, in virtual time, with its faults, on the bus that the rig says; nothing is
/// recorded.
class MemoryRun {
 public:
  /// @throws config::ConfigError as prepare(); also if a part of the machine is not ours.
  explicit MemoryRun(scenario::ResolvedRun run);

  [[nodiscard]] const config::Rig& rig() const { return prepared_.run.rig; }
  /// As rows have them.
  [[nodiscard]] std::vector<SignalInfo> signals() const;
  /// To be called once.
  bus::RunOutcome play(bus::RunObserver& observer);

 private:
  PreparedRun prepared_;
  runtime::InProcessPort controller_;
  runtime::InProcessPort plant_;
};

}  // namespace meltbench::cli
