#include "bench/check/series.hpp"

#include <algorithm>
#include <utility>

#include "protocols/config/section.hpp"

namespace meltbench::check {
namespace {

std::optional<std::size_t> find(const record::Recording& recording, const std::string& name, Outcome& outcome) {
  const auto column = recording.find_signal(name);
  if (column) return column;
  if (recording.info.is_unseen(name)) {
    outcome = skipped(std::move(outcome), name);
    return std::nullopt;
  }
  outcome.margin = kNothingMeasured;
  std::vector<std::string> names;
  for (const SignalInfo& signal : recording.signals) names.push_back(signal.name);
  const std::string_view near = config::nearest(name, names);
  outcome.text = near.empty() ? fmt::format("there is no signal {} in this run", name)
                              : fmt::format("there is no signal {} in this run; the nearest is {}", name, near);
  return std::nullopt;
}

}  // namespace

std::optional<Series> resolve(const record::Recording& recording, const Quantity& quantity, Outcome& outcome) {
  outcome.unit = record::unit_of_signal(quantity.signal);
  const auto column = find(recording, quantity.signal, outcome);
  if (!column) return std::nullopt;
  if (quantity.minus.empty()) return Series{recording, *column, std::nullopt};
  const auto minus = find(recording, quantity.minus, outcome);
  if (!minus) return std::nullopt;
  return Series{recording, *column, minus};
}

Rows rows_of(const record::Recording& recording, const Window& window) {
  const auto& times = recording.row_times;
  const auto begin = std::lower_bound(times.begin(), times.end(), window.from);
  const auto end = std::upper_bound(begin, times.end(), window.to);
  return {static_cast<std::size_t>(begin - times.begin()), static_cast<std::size_t>(end - times.begin())};
}

std::optional<Judged> open(const record::Recording& recording, const Quantity& quantity, const Window& window,
                           Outcome& outcome) {
  const auto series = resolve(recording, quantity, outcome);
  if (!series) return std::nullopt;
  const Rows rows = rows_of(recording, window);
  if (rows.empty()) {
    outcome = failed(std::move(outcome), fmt::format("the run has no row from {} s on", to_s(window.from)));
    return std::nullopt;
  }
  return Judged{*series, rows};
}

Outcome skipped(Outcome outcome, std::string_view name) {
  outcome.held = true;
  outcome.margin = 0;
  outcome.skipped = fmt::format("{} is not known in this run: {} is no part of the bench, only its frames are seen",
                                name, name.substr(0, name.find('.')));
  outcome.text = outcome.skipped;
  return outcome;
}

Outcome failed(Outcome outcome, std::string text, std::optional<double> at_s) {
  outcome.held = false;
  outcome.margin = kNothingMeasured;
  outcome.at_s = at_s;
  outcome.text = std::move(text);
  return outcome;
}

Outcome judged(Outcome outcome, double margin, double at_s, std::string text) {
  outcome.held = margin >= 0;
  outcome.margin = margin;
  outcome.at_s = at_s;
  outcome.text = std::move(text);
  return outcome;
}

std::string bounds_text(std::optional<double> min, std::optional<double> max, const std::string& unit) {
  if (min && max) return fmt::format("{:.6g} to {}", *min, with_unit(*max, unit));
  return min ? "at least " + with_unit(*min, unit) : "at most " + with_unit(*max, unit);
}

double distance_inside(double value, std::optional<double> min, std::optional<double> max) {
  if (!max) return value - *min;
  if (!min) return *max - value;
  const double to_min = value - *min;
  const double to_max = *max - value;
  return to_min < to_max ? to_min : to_max;
}

}  // namespace meltbench::check
