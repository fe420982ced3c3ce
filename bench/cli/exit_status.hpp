#pragma once

namespace meltbench::cli {

/// What meltbench tells the shell.
enum class ExitStatus : int {
  kHeld = 0,    ///< All checks held.
  kFailed = 1,  ///< A check failed.
  kUsage = 2,   ///< Bad usage, or a file that cannot be used.
  kLost = 3,    ///< A link or a process was lost, or the user interrupted.
};

}  // namespace meltbench::cli
