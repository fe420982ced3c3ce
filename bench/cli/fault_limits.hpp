#pragma once

#include <string>
#include <vector>

#include "bench/cli/prepare_run.hpp"
#include "protocols/fault/fault.hpp"

namespace meltbench::cli {

/// What the way in which a run is carried leaves to its faults.
struct FaultLimits {
  enum class Frames : std::uint8_t { kByBench, kByKernel, kByAdapter };

  bool in_virtual_time = true;
  Frames frames = Frames::kByBench;  ///< Who carries them.
  bool has_emulator = true;
  bool has_real_board = false;
  bool controller_joins_late = false;  ///< It is external, and no member of the bus when the run begins.
  std::vector<std::string> ports;      ///< LINE=PORT of all serial lines that are ports of this machine.
};

[[nodiscard]] FaultLimits find_limits(const PreparedRun& prepared, const RunRequest& request);

/// @throws config::ConfigError with the reason why this fault cannot happen in such a run, and what can be done
/// instead.
void require_possible(const fault::Fault& fault, const FaultLimits& limits);

}  // namespace meltbench::cli
