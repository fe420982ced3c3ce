#pragma once
/// The page of `meltbench show`: what happened on a recorded bus, in the look of report.html.

#include <cstdint>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "bench/record/bus_statistics.hpp"
#include "bench/report/plots.hpp"

namespace meltbench::report {

enum class Weight : std::uint8_t { kInfo, kWarning, kFault };

/// One line of the story.
struct StoryLine {
  double at_s = 0;
  Weight weight = Weight::kInfo;
  std::string kind;  ///< For people and for the filter, e.g. "heartbeat lost".
  std::string node;  ///< Likewise; empty: of the bus.
  std::string text;
  std::vector<std::string> details;  ///< Folded away, e.g. the transfers of a dialogue.
};

struct LogPage {
  std::string title;
  std::vector<std::pair<std::string, std::string>> facts;  ///< Name and value, e.g. "frames", "12,345".
  std::vector<StoryLine> lines;                            ///< In the order of time.
  std::uint64_t left_out = 0;                              ///< Findings that are not among the lines.
  record::BusStatistics bus;
  Plots plots;
  std::uint64_t signals_left_out = 0;  ///< That no plot shows.
  std::string version;
};

/// Lines of the story that the page shows; of more than that, the ones of most weight.
inline constexpr std::size_t kMaxStoryLines = 3000;

/// @returns a page of some megabytes at most, however long the log was.  @throws ReportError as render_report().
[[nodiscard]] std::string render_log_page(LogPage page);

}  // namespace meltbench::report
