#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "bench/cli/pace.hpp"

namespace meltbench::cli {

/// What the user asks of "meltbench run".
struct RunRequest {
  std::vector<std::filesystem::path> scenarios;
  std::filesystem::path out;          ///< Folder of the results.
  std::optional<std::uint64_t> seed;  ///< Instead of the scenario's.
  bool quiet = false;                 ///< Verdict and report only.
  Pace pace;
  std::string can;  ///< Bus name; empty: an embedded bus of this run alone.
};

}  // namespace meltbench::cli
