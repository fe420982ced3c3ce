#pragma once

#include <filesystem>
#include <vector>

#include "bench/cli/exit_status.hpp"

namespace meltbench::cli {

/// "meltbench report": makes report.html anew from run folders; one page over all of them.
/// @param page  where to; empty: report.html in the first folder.
[[nodiscard]] ExitStatus make_report(const std::vector<std::filesystem::path>& folders, std::filesystem::path page);

/// "meltbench check": judges recorded runs again, by the checks in their repro.toml, or by those of another scenario.
/// Writes result.json and junit.xml anew.
/// @param scenario  empty: each folder's own.
[[nodiscard]] ExitStatus check_again(const std::vector<std::filesystem::path>& folders,
                                     const std::filesystem::path& scenario);

}  // namespace meltbench::cli
