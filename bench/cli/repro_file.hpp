#pragma once

#include "bench/cli/prepare_run.hpp"

namespace meltbench::cli {

/// Writes the one file that the run needs, and that repeats it, into its folder, which is made. In place of an older
/// one at once: whoever reads it sees one or the other.
/// @throws std::system_error if that cannot be done.
void write_repro_file(const PreparedRun& prepared);

}  // namespace meltbench::cli
