#pragma once
/// Commands on recorded logs of a bus.

#include <filesystem>

#include "bench/cli/exit_status.hpp"
#include "bench/log/log_reader.hpp"

namespace meltbench::cli {

/// Writes a log in another format; prints what was odd in it. @throws log::LogError
[[nodiscard]] ExitStatus convert_log(const std::filesystem::path& from, const std::filesystem::path& to);

/// Tells on standard error what was odd in a log that has been read.
void print_log_warnings(const log::LogReader& reader, const std::filesystem::path& path);

}  // namespace meltbench::cli
