#pragma once
/// How fast programs and controller responded: wake-up lateness and reaction times, as table and pictures.

#include <optional>
#include <span>
#include <string>
#include <vector>

#include "bench/report/histogram.hpp"
#include "bench/report/report.hpp"
#include "protocols/time/log_histogram.hpp"

namespace meltbench::report {

/// One kind of response of one run.
struct Response {
  std::string name;  ///< "SYNC to command", "controller wakes up late by".
  LogHistogram times;
  std::optional<double> overruns;  ///< Wake-ups that missed their deadline.
};

/// What there is to tell of a run: reactions if a SYNC was followed by a command, wake-ups at wall-clock pace.
[[nodiscard]] std::vector<Response> collect_responses(const record::Recording& recording);

/// Bins of equal ratio, four per octave, over all of them.
/// @returns nothing to show if nothing was counted.
[[nodiscard]] std::optional<Histogram> calc_log_histogram(std::span<const LogHistogram* const> runs);

/// The section of the page; empty if there is nothing to tell.
[[nodiscard]] std::string render_responses(std::span<const Run> runs);

}  // namespace meltbench::report
