#pragma once

#include "bench/cli/exit_status.hpp"
#include "bench/cli/run_request.hpp"

namespace meltbench::cli {

/// "meltbench run": reads all files first, then carries run after run, judges each, prints the verdicts, and writes one
/// report over all. A single run's files go to `out` itself; of several, to `out`/<scenario>[/<variant>] or
/// `out`/<variant> for the variants of one scenario.
[[nodiscard]] ExitStatus run_scenarios(const RunRequest& request);

}  // namespace meltbench::cli
