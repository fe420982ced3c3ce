#pragma once

#include "bench/cli/prepare_run.hpp"

namespace meltbench::cli {

/// Carries one run to its end, whatever that is, and leaves the recording in its folder. @pre the run is not used
/// again.
/// @throws std::system_error if the folder cannot be written or a program not be started; link::LinkError.
[[nodiscard]] record::Recording execute(PreparedRun& prepared, const RunRequest& request);

}  // namespace meltbench::cli
