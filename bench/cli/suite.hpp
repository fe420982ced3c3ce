#pragma once

#include "bench/cli/exit_status.hpp"
#include "bench/cli/run_request.hpp"

namespace meltbench::cli {

/// The request names a folder of scenarios in place of files.
[[nodiscard]] bool is_suite(const RunRequest& request);

/// Runs all scenarios of a folder, several at a time, prints what was tried on what, and writes suite.html, a page with
/// a cell per fault that is linked to its run.
/// @throws as run_scenarios().
[[nodiscard]] ExitStatus run_suite(const RunRequest& request);

}  // namespace meltbench::cli
