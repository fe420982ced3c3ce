#pragma once

#include "bench/cli/exit_status.hpp"

namespace meltbench::cli {

/// "meltbench doctor": what this machine offers, and how to get what is missing. Always kHeld: nothing here is an
/// error.
[[nodiscard]] ExitStatus examine_machine();

}  // namespace meltbench::cli
