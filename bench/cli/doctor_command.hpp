#pragma once

#include <filesystem>
#include <string>

#include "bench/cli/exit_status.hpp"

namespace meltbench::cli {

/// What "meltbench doctor" is asked beside its usual questions.
struct Examination {
  std::filesystem::path rig;  ///< Empty: none. Else its bit rate is compared, and its boards are looked for.
  std::string can;            ///< Empty: listen to nothing. Else a kernel interface to listen to for two seconds.
};

/// "meltbench doctor": what this machine offers, and how to get what is missing; with a rig and an interface also who
/// is on that bus. It only listens, so it may be asked while the bus works.
/// @returns kHeld, or kFailed if a board of the rig was not heard.
/// @throws config::ConfigError, link::LinkError for a rig or an interface that cannot be read.
[[nodiscard]] ExitStatus examine_machine(const Examination& examination);

}  // namespace meltbench::cli
