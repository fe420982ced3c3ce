#pragma once
/// Judges a recording: every check says whether it held, and how far it was from failing.

#include <optional>
#include <string>
#include <vector>

#include "bench/record/recording.hpp"

namespace meltbench::check {

/// What one check found.
struct CheckResult {
  std::string name;
  std::string kind;  ///< "settle", "band", ...; "health" for the implicit gate.
  bool held = false;
  double margin = 0;  ///< How far from failing, in `unit`; >= 0 if and only if held. -inf: nothing there to measure.
  std::string unit;
  std::optional<double> at_s;  ///< When it was closest to failing, or failed worst.
  std::string text;            ///< For people, one line: what was seen and what was asked.
  std::string skipped;         ///< Why it could not be judged; empty if it was. A skipped check counts as held.
};

/// What the health gate found, line by line.
struct Health {
  bool held = true;
  std::vector<std::string>
      findings;  ///< Unexpected, each in one line: "controller: warning heartbeat-lost at 3.2 s: ...".
  std::vector<std::string> expected;  ///< Entries of [health] expect that did occur, as written there.
  std::vector<std::string> absent;    ///< Entries of [health] expect that did not occur. Not a failure.
};

/// Everything judged of one run. The health gate is also the last of `checks`.
struct CheckResults {
  std::vector<CheckResult> checks;
  Health health;

  [[nodiscard]] bool held() const;
  [[nodiscard]] std::size_t failed_count() const;
};

}  // namespace meltbench::check
