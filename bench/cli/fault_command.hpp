#pragma once

#include <string>
#include <vector>

#include "bench/cli/exit_status.hpp"

namespace meltbench::cli {

/// What the user asks of "meltbench fault".
struct FaultRequest {
  std::vector<std::string> words;  ///< [BENCH] FAULT; with clear or list [BENCH].
  std::string clear;               ///< Name of the fault to end; empty: none.
  bool list = false;
};

/// Gives a fault to a running bench, ends one, or tells which are on and what can fail. Waits for the answer as long as
/// the bench lives.
/// @throws std::invalid_argument for words that do not fit, if there is no such bench, or several to choose from;
/// link::LinkError.
[[nodiscard]] ExitStatus give_fault(const FaultRequest& request);

}  // namespace meltbench::cli
