#include <cmath>
#include <optional>
#include <utility>

#include "bench/check/kinds.hpp"
#include "bench/check/series.hpp"

namespace meltbench::check {
namespace {

/// A row and how far it was from failing there.
struct Nearest {
  std::size_t row = 0;
  double margin = 0;
};

/// The row with the smallest margin; a row without a value wins over all. `margin_of(value)` may be NaN only for NaN.
template <typename MarginOf>
Nearest find_nearest(const Judged& what, MarginOf margin_of) {
  Nearest nearest{what.rows.begin, margin_of(what.series[what.rows.begin])};
  for (std::size_t row = what.rows.begin; row < what.rows.end && !std::isnan(nearest.margin); ++row) {
    const double margin = margin_of(what.series[row]);
    if (margin < nearest.margin || std::isnan(margin)) nearest = {row, margin};
  }
  return nearest;
}

Outcome no_value(Outcome outcome, double at_s) {
  return failed(std::move(outcome), fmt::format("has no value at {} s", at_s), at_s);
}

struct Extremes {
  std::size_t min_row, max_row;
  double min, max;
};

/// @returns nothing if a row has no value; `bad_row` says which.
std::optional<Extremes> find_extremes(const Judged& what, std::size_t& bad_row) {
  const double first = what.series[what.rows.begin];
  Extremes extremes{what.rows.begin, what.rows.begin, first, first};
  for (std::size_t row = what.rows.begin; row < what.rows.end; ++row) {
    const double value = what.series[row];
    if (std::isnan(value)) {
      bad_row = row;
      return std::nullopt;
    }
    if (value < extremes.min) extremes.min = value, extremes.min_row = row;
    if (value > extremes.max) extremes.max = value, extremes.max_row = row;
  }
  return extremes;
}

/// Margin of a moment that must lie in [not_before, within], both from the start of the run.
double moment_margin_s(double moment_s, Instant not_before, Instant within) {
  const double early_s = moment_s - to_s(not_before);
  const double late_s = to_s(within) - moment_s;
  return not_before > Instant{} && early_s < late_s ? early_s : late_s;
}

std::string moment_bounds(Instant not_before, Instant within) {
  return not_before > Instant{} ? fmt::format("asked for: {:.6g} s to {:.6g} s", to_s(not_before), to_s(within))
                                : fmt::format("asked for: by {:.6g} s", to_s(within));
}

/// How deep the value lies in the condition: >= 0 if it is true.
double depth(const Condition& condition, double value) {
  return distance_inside(value, condition.above, condition.below);
}

/// The rows of `rows` in which `during` is true, or all of them.
class Gate {
 public:
  Gate(const record::Recording& recording, const std::optional<Condition>& during, Outcome& outcome) {
    if (!during) return;
    Outcome found = outcome;
    series_ = resolve(recording, during->quantity, found);
    during_ = &*during;
    if (!series_) {
      missing_ = true;
      found.unit = outcome.unit;
      outcome = std::move(found);
    }
  }
  [[nodiscard]] bool missing() const { return missing_; }
  [[nodiscard]] bool lets_through(std::size_t row) const { return !during_ || depth(*during_, (*series_)[row]) >= 0; }

 private:
  const Condition* during_ = nullptr;
  std::optional<Series> series_;
  bool missing_ = false;
};

std::string condition_text(const Condition& condition, const std::string& unit) {
  return bounds_text(condition.above, condition.below, unit);
}

}  // namespace

Outcome Settle::judge(const record::Recording& recording) const {
  Outcome outcome;
  const auto what = open(recording, quantity, Window{Instant{}, until}, outcome);
  if (!what) return outcome;
  const std::string unit = std::exchange(outcome.unit, "s");  // The margin is a time.

  std::size_t settled = what->rows.end;
  while (settled > what->rows.begin && std::abs(what->series[settled - 1] - target) <= tolerance) --settled;
  const std::string band = fmt::format("±{:.6g} of {}", tolerance, with_unit(target, unit));
  const std::string asked = moment_bounds(not_before, within);
  if (settled == what->rows.end) {
    const double last_s = row_s(recording, settled - 1);
    return judged(std::move(outcome), strictly_negative(to_s(within) - last_s), last_s,
                  fmt::format("still outside {} at {:.6g} s: {}; {}", band, last_s,
                              with_unit(what->series[settled - 1], unit), asked));
  }
  const double settled_s = row_s(recording, settled);
  return judged(std::move(outcome), moment_margin_s(settled_s, not_before, within), settled_s,
                fmt::format("within {} from {:.6g} s on; {}", band, settled_s, asked));
}

Outcome NeverSettles::judge(const record::Recording& recording) const {
  Outcome outcome;
  if (recording.row_times.empty()) return failed(std::move(outcome), "the run has no rows");
  const auto what = open(recording, quantity, Window{recording.row_times.back() - over_last}, outcome);
  if (!what) return outcome;
  const Nearest worst = find_nearest(*what, [&](double value) { return -std::abs(value - target); });
  if (std::isnan(worst.margin)) return no_value(std::move(outcome), row_s(recording, worst.row));
  // Exactly on the tolerance is settled: the margin of what does not settle must be > 0.
  const double margin = -worst.margin - tolerance;
  std::string text = fmt::format("up to {} from {:.6g} in the last {:.6g} s; asked for: more than {:.6g}",
                                 with_unit(-worst.margin, outcome.unit), target, to_s(over_last), tolerance);
  return judged(std::move(outcome), margin > 0 ? margin : strictly_negative(margin), row_s(recording, worst.row),
                std::move(text));
}

Outcome Band::judge(const record::Recording& recording) const {
  Outcome outcome;
  const auto what = open(recording, quantity, window, outcome);
  if (!what) return outcome;
  const Nearest nearest = find_nearest(*what, [&](double value) { return distance_inside(value, min, max); });
  if (std::isnan(nearest.margin)) return no_value(std::move(outcome), row_s(recording, nearest.row));
  std::string text =
      fmt::format("nearest to its bounds with {}; asked for: {}", with_unit(what->series[nearest.row], outcome.unit),
                  bounds_text(min, max, outcome.unit));
  return judged(std::move(outcome), nearest.margin, row_s(recording, nearest.row), std::move(text));
}

Outcome Overshoot::judge(const record::Recording& recording) const {
  Outcome outcome;
  const auto what = open(recording, quantity, window, outcome);
  if (!what) return outcome;
  const double start = what->series[what->rows.begin];
  const Nearest farthest = find_nearest(*what, [&](double value) {
    if (start == target) return -std::abs(value - target);
    return start < target ? target - value : value - target;
  });
  if (std::isnan(farthest.margin)) return no_value(std::move(outcome), row_s(recording, farthest.row));
  const double overshoot = farthest.margin < 0 ? -farthest.margin : 0.0;
  std::string text =
      fmt::format("{} beyond {:.6g}; asked for: at most {:.6g}", with_unit(overshoot, outcome.unit), target, max);
  return judged(std::move(outcome), max - overshoot, row_s(recording, farthest.row), std::move(text));
}

Outcome PeakToPeak::judge(const record::Recording& recording) const {
  Outcome outcome;
  const auto what = open(recording, quantity, window, outcome);
  if (!what) return outcome;
  std::size_t bad_row = 0;
  const auto extremes = find_extremes(*what, bad_row);
  if (!extremes) return no_value(std::move(outcome), row_s(recording, bad_row));
  const double span = extremes->max - extremes->min;
  std::string text = fmt::format("{} from {:.6g} to {:.6g}; asked for: {}", with_unit(span, outcome.unit),
                                 extremes->min, extremes->max, bounds_text(min, max, outcome.unit));
  return judged(std::move(outcome), distance_inside(span, min, max), row_s(recording, extremes->max_row),
                std::move(text));
}

Outcome Response::judge(const record::Recording& recording) const {
  Outcome outcome;
  const auto what = open(recording, quantity, Window{from}, outcome);
  if (!what) return outcome;
  const std::string unit = std::exchange(outcome.unit, "s");
  const double start = what->series[what->rows.begin] - level;
  const std::string asked = moment_bounds(not_before, within);
  for (std::size_t row = what->rows.begin; row < what->rows.end; ++row) {
    const double beyond = what->series[row] - level;
    const bool crossed = start < 0 ? beyond >= 0 : beyond <= 0;
    if (!crossed) continue;
    const double at_s = row_s(recording, row);
    return judged(std::move(outcome), moment_margin_s(at_s, not_before, within), at_s,
                  fmt::format("reaches {} at {:.6g} s; {}", with_unit(level, unit), at_s, asked));
  }
  const double last_s = row_s(recording, what->rows.end - 1);
  return judged(std::move(outcome), strictly_negative(to_s(within) - last_s), last_s,
                fmt::format("does not reach {} by the end, {:.6g} s; {}", with_unit(level, unit), last_s, asked));
}

Outcome Always::judge(const record::Recording& recording) const {
  Outcome outcome;
  const auto what = open(recording, condition.quantity, window, outcome);
  if (!what) return outcome;
  const Gate gate{recording, during, outcome};
  if (gate.missing()) return outcome;
  std::optional<Nearest> worst;
  for (std::size_t row = what->rows.begin; row < what->rows.end; ++row) {
    if (!gate.lets_through(row)) continue;
    const double margin = depth(condition, what->series[row]);
    if (std::isnan(margin)) return no_value(std::move(outcome), row_s(recording, row));
    if (!worst || margin < worst->margin) worst = Nearest{row, margin};
  }
  if (!worst) return failed(std::move(outcome), "\"during\" was never true, so nothing was judged");
  std::string text =
      fmt::format("nearest to its bound with {}; asked for: always {}",
                  with_unit(what->series[worst->row], outcome.unit), condition_text(condition, outcome.unit));
  return judged(std::move(outcome), worst->margin, row_s(recording, worst->row), std::move(text));
}

Outcome Never::judge(const record::Recording& recording) const {
  Outcome outcome;
  const auto what = open(recording, condition.quantity, window, outcome);
  if (!what) return outcome;
  const Gate gate{recording, during, outcome};
  if (gate.missing()) return outcome;
  std::optional<Nearest> worst;
  bool any_row = false;
  for (std::size_t row = what->rows.begin; row < what->rows.end; ++row) {
    if (!gate.lets_through(row)) continue;
    any_row = true;
    const double margin = -depth(condition, what->series[row]);
    if (!std::isnan(margin) && (!worst || margin < worst->margin)) worst = Nearest{row, margin};
  }
  if (!any_row) return failed(std::move(outcome), "\"during\" was never true, so nothing was judged");
  if (!worst) return failed(std::move(outcome), "has no value in the whole window");
  std::string text =
      fmt::format("nearest with {}; asked for: never {}", with_unit(what->series[worst->row], outcome.unit),
                  condition_text(condition, outcome.unit));
  // -0.0 is a touch of the bound, and held.
  return judged(std::move(outcome), worst->margin + 0.0, row_s(recording, worst->row), std::move(text));
}

}  // namespace meltbench::check
