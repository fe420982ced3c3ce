#pragma once

#include <filesystem>
#include <vector>

#include "bench/cli/exit_status.hpp"

namespace meltbench::cli {

/// "meltbench report": makes report.html anew from run folders, or from folders of run folders; one page over all.
/// @param page  where to; empty: report.html in the one folder given, or beside the first of several.
[[nodiscard]] ExitStatus make_report(const std::vector<std::filesystem::path>& folders, std::filesystem::path page);

/// "meltbench check": judges recorded runs again, by the checks in their repro.toml, and writes their result.json,
/// junit.xml and report.html anew; or by those of another scenario, and then writes nothing.
/// @param scenario  empty: each folder's own.
[[nodiscard]] ExitStatus check_again(const std::vector<std::filesystem::path>& folders,
                                     const std::filesystem::path& scenario);

}  // namespace meltbench::cli
