#include "bench/report/histogram.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>

namespace meltbench::report {

Histogram calc_histogram(std::span<const std::vector<double>> periods_s, std::size_t bins) {
  double min = std::numeric_limits<double>::infinity();
  double max = -min;
  for (const std::vector<double>& run : periods_s) {
    for (const double period_s : run) {
      min = std::min(min, period_s);
      max = std::max(max, period_s);
    }
  }
  const double half_width = std::max({(max - min) / 2, 0.01 * (max + min) / 2, 1e-6});
  const double middle = (max + min) / 2;
  Histogram histogram{middle - half_width, middle + half_width, {}};
  for (const std::vector<double>& run : periods_s) {
    std::vector<std::size_t> counts(bins, 0);
    for (const double period_s : run) {
      const double place =
          (period_s - histogram.from_s) / (histogram.to_s - histogram.from_s) * static_cast<double>(bins);
      ++counts[static_cast<std::size_t>(std::clamp(place, 0.0, static_cast<double>(bins) - 1))];
    }
    histogram.counts.push_back(std::move(counts));
  }
  return histogram;
}

std::string render_histogram(const Histogram& histogram) {
  constexpr double kWidth = 320;
  constexpr double kHeight = 90;
  std::size_t most = 1;
  for (const auto& counts : histogram.counts) most = std::max(most, *std::max_element(counts.begin(), counts.end()));
  const double scale = kHeight / std::log1p(static_cast<double>(most));

  std::string svg =
      fmt::format("<svg viewBox=\"0 0 {} {}\" preserveAspectRatio=\"none\" aria-hidden=\"true\">", kWidth, kHeight);
  for (std::size_t run = 0; run < histogram.counts.size(); ++run) {
    const std::vector<std::size_t>& counts = histogram.counts[run];
    const double bin_width = kWidth / static_cast<double>(counts.size());
    // Runs stand side by side within a bin.
    const double bar_width = (bin_width - 1) / static_cast<double>(histogram.counts.size());
    svg += fmt::format("<g class=\"run{}\">", run % 8);
    for (std::size_t bin = 0; bin < counts.size(); ++bin) {
      if (counts[bin] == 0) continue;
      const double height = scale * std::log1p(static_cast<double>(counts[bin]));
      svg += fmt::format("<rect x=\"{:.2f}\" y=\"{:.2f}\" width=\"{:.2f}\" height=\"{:.2f}\"/>",
                         static_cast<double>(bin) * bin_width + static_cast<double>(run) * bar_width, kHeight - height,
                         bar_width, height);
    }
    svg += "</g>";
  }
  return svg + "</svg>";
}

}  // namespace meltbench::report
