#pragma once
/// What a report plots: which signals share a plot, on which common time axis, thinned to what a screen can show.

#include <span>
#include <string>
#include <vector>

#include "bench/report/report.hpp"

namespace meltbench::report {

/// One line in a plot.
struct PlotSeries {
  std::string signal;
  int run = 0;                ///< -1: the same in all runs, drawn once.
  std::vector<float> values;  ///< One per time; NaN = no value (a gap), +inf = no sample here (the line goes on).
};

struct Plot {
  std::string title;
  std::string unit;
  std::vector<PlotSeries> series;  ///< Signal by signal, each with its runs in order.
  bool stepped = false;            ///< A value holds until the next.
};

struct Plots {
  std::vector<double> times_s;  ///< Common to all.
  std::vector<Plot> plots;
  std::vector<std::string> still;  ///< Signals that kept one value in all runs: "plant.spill_m = 0 m".
  bool thinned = false;            ///< Buckets of minimum and maximum instead of every row.
};

/// Names of the signals of all runs, each once, in the order of the recordings.
[[nodiscard]] std::vector<std::string> all_signals(std::span<const Run> runs);

/// Groups and thins the signals of the runs. What belongs together shares a plot, the closed loop first; a signal that
/// we do not know has a plot of its own. The points of a profile (profiles.hpp) are left out.
///
/// If all runs have the same rows and they fit, every row is kept. Else each run is cut into equal buckets of time,
/// of which the smallest and the largest value are kept in their order, so no peak is lost.
/// @param max_values  of all series together; 4 bytes each.
[[nodiscard]] Plots make_plots(std::span<const Run> runs, std::size_t max_values = 300'000);

/// {"t": [...], "plots": [{title, unit, stepped, series: [{signal, run, data: base64 of little-endian float32}]}]}
[[nodiscard]] std::string write_plots_json(const Plots& plots);

}  // namespace meltbench::report
