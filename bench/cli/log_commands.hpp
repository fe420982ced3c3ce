#pragma once
/// Commands on recorded logs of a bus.

#include <filesystem>

#include "bench/cli/exit_status.hpp"

namespace meltbench::cli {

/// Writes a log in another format; prints what was odd in it. @throws log::LogError
[[nodiscard]] ExitStatus convert_log(const std::filesystem::path& from, const std::filesystem::path& to);

}  // namespace meltbench::cli
