#pragma once
/// The page of `meltbench replay --to`: what was said now against what was recorded, in the look of report.html.

#include <cstdint>
#include <string>
#include <vector>

#include "bench/report/plots.hpp"

namespace meltbench::report {

/// One answer that differs.
struct ReplayDifference {
  double at_s = 0;
  std::string kind;  ///< "missing", "changed"...
  std::string text;
  std::string place;  ///< In the log.
};

/// How well one signal was met.
struct ReplayFit {
  std::string board;
  std::string object;  ///< "0x2000:0".
  std::string name;
  std::string unit;
  std::uint64_t compared = 0;
  std::uint64_t differing = 0;
  double largest = 0;
  double rms = 0;
  double at_s = 0;         ///< Of the largest, if any differs.
  std::uint64_t line = 0;  ///< Likewise, in the log.
};

struct ReplayPage {
  std::string title;
  std::string summary;                        ///< For the banner, behind the verdict.
  std::uint64_t count = 0;                    ///< Answers that differ.
  std::vector<ReplayDifference> differences;  ///< In the order of time; perhaps not all.
  std::vector<ReplayFit> fits;
  Plots plots;                         ///< Run 0: recorded, run 1: replayed.
  std::uint64_t signals_left_out = 0;  ///< For which there was no room in the plots.
  std::string version;
};

/// @returns the page, the first difference marked in its plots.  @throws ReportError as render_report().
[[nodiscard]] std::string render_replay_page(ReplayPage page);

}  // namespace meltbench::report
