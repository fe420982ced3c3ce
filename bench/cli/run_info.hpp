#pragma once

#include "bench/cli/prepare_run.hpp"

namespace meltbench::cli {

inline constexpr const char* kController = "controller";
inline constexpr const char* kPlant = "plant";

/// What a recording says about its run; of what the bench cannot see in it, too.
[[nodiscard]] record::RunInfo make_info(const PreparedRun& prepared, const RunRequest& request);

}  // namespace meltbench::cli
