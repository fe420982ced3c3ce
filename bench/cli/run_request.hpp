#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "bench/cli/pace.hpp"
#include "bench/tap/tap.hpp"

namespace meltbench::cli {

/// What the user asks of "meltbench run".
struct RunRequest {
  std::vector<std::filesystem::path> scenarios;
  std::filesystem::path out;          ///< Folder of the results.
  std::optional<std::uint64_t> seed;  ///< Instead of the scenario's.
  bool quiet = false;                 ///< Verdict and report only.
  Pace pace;
  bool pace_given = false;     ///< By the user; else a run on a kernel bus or with real parts takes wall-clock pace.
  std::string can;             ///< Bus name; empty: an embedded bus of this run alone.
  std::string controller_can;  ///< Kernel interface of the controller, if it has another one than the boards.
  std::vector<std::string>
      lines;  ///< LINE=PORT: ports of the boards on serial lines; if they are real, of the controller.
  std::vector<std::string> controller_lines;  ///< LINE=PORT: ports of the controller, where the boards have others.
  std::optional<int> rt_priority;             ///< SCHED_FIFO priority of the programs and of the bench, 1..99.
  tap::TapOptions tap;                        ///< Who else may come on the embedded bus.
  std::size_t tap_wait = 0;                   ///< The run begins when so many of them look at it.
};

}  // namespace meltbench::cli
