#pragma once
/// The parts of the page that are plain HTML.

#include <span>
#include <string>
#include <vector>

#include "bench/record/bus_statistics.hpp"
#include "bench/report/report.hpp"

namespace meltbench::report {

/// Short names of the runs: the variants if all are of one scenario, else scenario.variant.
[[nodiscard]] std::vector<std::string> name_runs(std::span<const Run> runs);

/// What the page is called: the title of the run, or what the titles of all runs begin with ("Step: fast", "Step:
/// slow").
[[nodiscard]] std::string make_title(std::span<const Run> runs);

/// 0.00028 and "m" -> "280 µm": four digits, with a prefix where the unit takes one.
[[nodiscard]] std::string format_quantity(double value, const std::string& unit);

[[nodiscard]] std::string render_title(std::span<const Run> runs);   ///< Heading, verdict banner, what it shows.
[[nodiscard]] std::string render_checks(std::span<const Run> runs);  ///< Verdict table of each run.
[[nodiscard]] std::string render_what_was_run(std::span<const Run> runs);
[[nodiscard]] std::string render_events(std::span<const Run> runs);
[[nodiscard]] std::string render_frame_timing(std::span<const Run> runs);
[[nodiscard]] std::string render_bus(std::span<const Run> runs);
/// Traffic of each identifier.
[[nodiscard]] std::string render_bus_table(const record::BusStatistics& bus);

}  // namespace meltbench::report
