#pragma once
/// The checks of a scenario: read from [[check]] and [health], then asked to judge a recording.

#include <string>
#include <variant>
#include <vector>

#include "bench/check/check.hpp"
#include "bench/check/kinds.hpp"
#include "bench/record/recording.hpp"
#include "protocols/config/section.hpp"

namespace meltbench::check {

using Kind = std::variant<Settle, NeverSettles, Band, Overshoot, PeakToPeak, Response, FramePeriod, FrameJitter,
                          BusLoad, Reaction, Always, Never, EventOccurs>;

/// One [[check]].
struct Check {
  std::string name;
  Kind kind;
  config::Origin origin;  ///< Of its table, for complaints after reading.
};

/// All that is asked of a run.
struct CheckSet {
  std::vector<Check> checks;
  HealthGate health;

  /// Every signal that a check names, as often as it is named.
  [[nodiscard]] std::vector<std::string> signal_names() const;

  /// Before the run: does every signal that a check names exist?
  /// @param info  says which parts the bench cannot look into: their signals are missing by nature.
  /// @throws config::ConfigError at the check, naming the nearest signal.
  void require_signals(const std::vector<SignalInfo>& signals, const record::RunInfo& info) const;

  /// Before the run: does every check look at times that the run reaches?
  /// @throws config::ConfigError at the check, naming the time.
  void require_times(Nanos duration) const;

  /// After the run. Pure: same recording, same results. The health gate comes last.
  [[nodiscard]] CheckResults judge(const record::Recording& recording) const;
};

/// Reads all [[check]] tables and [health] below `root`. The keys are explained in fixtures/scenarios/CHECKS.md.
/// `variants` of a check is somebody else's (bench/scenario). Finishes each [[check]] and [health], not the root.
/// @throws config::ConfigError: unknown kind or key, a missing bound, a name given twice.
[[nodiscard]] CheckSet read_checks(const config::Section& root);

}  // namespace meltbench::check
