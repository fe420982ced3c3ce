#pragma once
/// Frame timing as small pictures: how the gaps between the frames of an identifier are spread.

#include <span>
#include <string>
#include <vector>

namespace meltbench::report {

/// Equal bins over the periods of all runs.
struct Histogram {
  double from_s = 0;
  double to_s = 0;
  std::vector<std::vector<std::size_t>> counts;  ///< Per run, per bin.
};

/// @param periods_s  per run. The range covers all of them; if they are all but equal it is 1 % of the period to both
/// sides.
/// @pre at least one period.
[[nodiscard]] Histogram calc_histogram(std::span<const std::vector<double>> periods_s, std::size_t bins = 41);

/// An <svg> of it, heights logarithmic so that one late frame in ten thousand can be seen. Colours by class "run0",
/// "run1", ...
[[nodiscard]] std::string render_histogram(const Histogram& histogram);

}  // namespace meltbench::report
