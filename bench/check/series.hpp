#pragma once
/// Helpers shared by the kinds of checks: a quantity resolved in a recording, rows of a window, small wordings.

#include <fmt/format.h>

#include <cstddef>
#include <limits>
#include <optional>
#include <string>

#include "bench/check/kinds.hpp"
#include "bench/record/recording.hpp"

namespace meltbench::check {

/// The margin of a check that found nothing to measure.
inline constexpr double kNothingMeasured = -std::numeric_limits<double>::infinity();

/// The values of a quantity, row by row. Borrows the recording.
class Series {
 public:
  Series(const record::Recording& recording, std::size_t column, std::optional<std::size_t> minus)
      : recording_{&recording}, column_{column}, minus_{minus} {}
  [[nodiscard]] double operator[](std::size_t row) const {
    const double value = recording_->value(row, column_);
    return minus_ ? value - recording_->value(row, *minus_) : value;
  }

 private:
  const record::Recording* recording_;
  std::size_t column_;
  std::optional<std::size_t> minus_;
};

/// Finds the quantity's signals. If one is missing, the outcome says so: skipped where the bench cannot look into the
/// part that it belongs to, else failed.
[[nodiscard]] std::optional<Series> resolve(const record::Recording& recording, const Quantity& quantity,
                                            Outcome& outcome);

/// Rows [begin, end) of a window.
struct Rows {
  std::size_t begin = 0;
  std::size_t end = 0;
  [[nodiscard]] bool empty() const { return begin >= end; }
};
[[nodiscard]] Rows rows_of(const record::Recording& recording, const Window& window);

/// Series and rows of a check on one quantity over one window; nothing if the outcome is settled already, because the
/// signal is missing or the window is empty.
struct Judged {
  Series series;
  Rows rows;
};
[[nodiscard]] std::optional<Judged> open(const record::Recording& recording, const Quantity& quantity,
                                         const Window& window, Outcome& outcome);

/// Seconds of a row.
[[nodiscard]] inline double row_s(const record::Recording& recording, std::size_t row) {
  return to_s(recording.row_times[row]);
}

/// An outcome of a check that needs a signal or an event of a part that the bench only knows by its frames.
[[nodiscard]] Outcome skipped(Outcome outcome, std::string_view name);

/// An outcome that failed without a measurement.
[[nodiscard]] Outcome failed(Outcome outcome, std::string text, std::optional<double> at_s = std::nullopt);

/// An outcome with a margin: held if it is >= 0.
[[nodiscard]] Outcome judged(Outcome outcome, double margin, double at_s, std::string text);

/// For a failure whose size is a lower bound that could round to nothing: at most -1 ns or its like.
[[nodiscard]] inline double strictly_negative(double margin) {
  return margin < -1e-9 ? margin : -1e-9;
}

/// "0.16 m": six digits and the unit.
[[nodiscard]] inline std::string with_unit(double value, const std::string& unit) {
  return unit.empty() ? fmt::format("{:.6g}", value) : fmt::format("{:.6g} {}", value, unit);
}

/// "min to max m", "at least min m", "at most max m".
[[nodiscard]] std::string bounds_text(std::optional<double> min, std::optional<double> max, const std::string& unit);

/// Distance to the nearer bound, < 0 outside, NaN for NaN. @pre one of both is there.
[[nodiscard]] double distance_inside(double value, std::optional<double> min, std::optional<double> max);

}  // namespace meltbench::check
