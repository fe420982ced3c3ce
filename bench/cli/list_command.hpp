#pragma once

#include <filesystem>

#include "bench/cli/exit_status.hpp"

namespace meltbench::cli {

/// The scenarios that come with meltbench: fixtures/scenarios below the working folder, else below the source tree that
/// this program was built in (found from the program's own place).
[[nodiscard]] std::filesystem::path find_scenarios();

/// "meltbench list": one line per scenario below `folder`, with its variants and its title.
/// @throws config::ConfigError for a file that cannot be read.
[[nodiscard]] ExitStatus list_scenarios(const std::filesystem::path& folder);

/// "meltbench list --signals FILE": the signals that the runs of a scenario offer, one per line.
[[nodiscard]] ExitStatus list_signals(const std::filesystem::path& scenario);

}  // namespace meltbench::cli
