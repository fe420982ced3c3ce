#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "bench/cli/exit_status.hpp"

namespace meltbench::cli {

struct TortureRequest {
  std::vector<std::filesystem::path> scenarios;  ///< Machines and durations to torture.
  std::string seeds = "1..100";                  ///< N or FIRST..LAST.
  std::filesystem::path out;                     ///< Where scenarios of failed seeds go.
  unsigned jobs = 0;                             ///< Threads; 0: one per processor.
};

/// Runs each scenario with faults by chance, one run per seed, in this process and in memory, and asks of every one:
/// does it come to its end, does nothing leave its bounds, are heaters off and the feed safe once the controller has
/// let go? What fails is written as a scenario, with the command that repeats it.
/// @throws config::ConfigError, std::invalid_argument for seeds that are none.
[[nodiscard]] ExitStatus torture(const TortureRequest& request);

}  // namespace meltbench::cli
