#pragma once

#include <string_view>

namespace meltbench::cli {

/// Set from the project's version by the build.
inline constexpr std::string_view kProgramVersion = "meltbench " MELTBENCH_VERSION;

}  // namespace meltbench::cli
