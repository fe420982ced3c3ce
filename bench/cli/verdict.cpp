#include "bench/cli/verdict.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstdio>

namespace meltbench::cli {
namespace {

/// The margin; what was seen is said where the check failed, and else in the report.
std::string margin_text(const check::CheckResult& result) {
  if (!result.skipped.empty()) return "skipped: " + result.skipped;
  if (result.kind == "health" || !std::isfinite(result.margin)) return result.text;
  std::string text = fmt::format("margin {:.4g}{}{}", result.margin, result.unit.empty() ? "" : " ", result.unit);
  if (result.at_s) text += fmt::format(" at {:.4g} s", *result.at_s);
  if (!result.held) text += fmt::format("; {}", result.text);
  return text;
}

std::string_view verdict_word(const check::CheckResult& result) {
  if (!result.skipped.empty()) return "skipped";
  return result.held ? "held" : "FAILED";
}

}  // namespace

void print_verdict(const record::Recording& recording, const check::CheckResults& results, double speed, bool quiet) {
  if (!quiet || !results.held()) {
    fmt::print("{}  {:.6g} s", recording.info.label(), to_s(recording.ending.at));
    if (speed > 0) fmt::print(", {:.3g} x real time", speed);
    fmt::print("\n");
  }
  std::size_t width = 0;
  for (const check::CheckResult& result : results.checks) width = std::max(width, result.name.size());
  for (const check::CheckResult& result : results.checks) {
    if (quiet && result.held) continue;
    fmt::print("  {:<8}{:<{}}  {}\n", verdict_word(result), result.name, width, margin_text(result));
  }
  if (recording.ending.reason != record::EndReason::kCompleted)
    fmt::print("  ended early: {}\n", recording.ending.text);
  std::fflush(stdout);
}

void Tally::add(const check::CheckResults& results) {
  ++runs;
  for (const check::CheckResult& result : results.checks) {
    if (!result.skipped.empty())
      ++skipped;
    else
      ++(result.held ? held : failed);
  }
}

void print_tally(const Tally& tally) {
  fmt::print("{} run{}: {} check{} held, {} failed", tally.runs, tally.runs == 1 ? "" : "s", tally.held,
             tally.held == 1 ? "" : "s", tally.failed);
  if (tally.skipped > 0) fmt::print(", {} skipped", tally.skipped);
  fmt::print("\n");
}

}  // namespace meltbench::cli
