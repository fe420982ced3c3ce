#pragma once

#include <string>
#include <string_view>

namespace meltbench::cli {

/// How time passes in a run, as --pace and --in-process say.
struct Pace {
  enum class Kind { kInProcess, kLockstep, kRealTime } kind = Kind::kLockstep;
  double speed = 1.0;  ///< Real time: bench seconds per second.

  [[nodiscard]] bool is_virtual() const { return kind != Kind::kRealTime; }
  /// "in-process", "lockstep", "realtime", "realtime:2".
  [[nodiscard]] std::string text() const;
};

/// Reads "lockstep", "realtime" or "realtime:FACTOR" (0.001..1000).
/// @throws std::invalid_argument in words for the user.
[[nodiscard]] Pace parse_pace(std::string_view text);

}  // namespace meltbench::cli
