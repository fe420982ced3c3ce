#pragma once
/// The kinds of checks. Each is a plain struct with a pure judge(); fixtures/scenarios/CHECKS.md explains their keys.
///
/// Common rules: times are since the start of the run; a window holds the rows from `from` to `to`, both included; a
/// value that is not a number satisfies nothing; an empty window fails. Limits are inclusive: margin 0 has held.

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <variant>
#include <vector>

#include "bench/check/check.hpp"
#include "bench/record/recording.hpp"
#include "protocols/time/instant.hpp"

namespace meltbench::check {

/// A span of the run. Never empty by itself: from <= to is checked when read.
struct Window {
  Instant from{};
  Instant to = Instant::never();
};

/// What is judged: a signal, or the difference of two ("plant.x_m minus controller.x_m").
struct Quantity {
  std::string signal;
  std::string minus;  ///< Empty: the signal itself.
};

/// Part of a CheckResult that a kind finds out by itself; name and kind are filled in by CheckSet::judge().
using Outcome = CheckResult;

/// Within `tolerance` of `target` from some moment on, to the end of the window; that moment must lie in
/// [not_before, within]. Margin: seconds to the nearer of both.
struct Settle {
  Quantity quantity;
  double target = 0;
  double tolerance = 0;
  Instant within;
  Instant not_before{};
  Instant until = Instant::never();
  [[nodiscard]] Outcome judge(const record::Recording& recording) const;
};

/// Still leaves the tolerance in the last part of the run: a limit cycle, an offset. Margin: largest deviation in that
/// part minus tolerance.
struct NeverSettles {
  Quantity quantity;
  double target = 0;
  double tolerance = 0;
  Nanos over_last{};
  [[nodiscard]] Outcome judge(const record::Recording& recording) const;
};

/// Stays between min and max. Margin: distance to the nearer one.
struct Band {
  Quantity quantity;
  std::optional<double> min, max;
  Window window;
  [[nodiscard]] Outcome judge(const record::Recording& recording) const;
};

/// Goes beyond the target, seen from its value at the start of the window, by at most max. Starting on the target, both
/// directions count. Margin: max minus what it was.
struct Overshoot {
  Quantity quantity;
  double target = 0;
  double max = 0;
  Window window;
  [[nodiscard]] Outcome judge(const record::Recording& recording) const;
};

/// Largest minus smallest value in the window lies between min and max.
struct PeakToPeak {
  Quantity quantity;
  std::optional<double> min, max;
  Window window;
  [[nodiscard]] Outcome judge(const record::Recording& recording) const;
};

/// First crosses the level, from the side where it starts, in [not_before, within]. Margin in seconds.
/// A signal that starts on the level has crossed it at once.
struct Response {
  Quantity quantity;
  double level = 0;
  Instant from{};
  Instant within;
  Instant not_before{};
  [[nodiscard]] Outcome judge(const record::Recording& recording) const;
};

/// Gaps between the frames of one identifier differ from the period by at most max_deviation; `percentile` of them,
/// 100 = all. Silence up to the end of the window counts as a gap. Margin in seconds.
struct FramePeriod {
  std::uint32_t cob_id = 0;
  Nanos period{};
  Nanos max_deviation{};
  double percentile = 100;
  Window window;
  [[nodiscard]] Outcome judge(const record::Recording& recording) const;
};

/// Longest minus shortest gap between the frames of one identifier; `percentile` cuts the same share off both ends.
struct FrameJitter {
  std::uint32_t cob_id = 0;
  Nanos max{};
  double percentile = 100;
  Window window;
  [[nodiscard]] Outcome judge(const record::Recording& recording) const;
};

/// Share of the time that frames take on the wire, exact bits and interframe spaces counted, in the busiest stretch of
/// the window that is `over` long; all bits at the nominal rate. Needs a bit rate. Margin: share.
struct BusLoad {
  double max = 1;
  Nanos over{};
  Window window;
  [[nodiscard]] Outcome judge(const record::Recording& recording) const;
};

/// A moment in the recording that a reaction starts from or ends with.
struct Moment {
  struct At {
    Instant at;
  };
  struct OnEvent {
    std::string code;
    std::string source;  ///< Empty: any.
  };
  struct OnFrame {
    std::uint32_t cob_id = 0;
    std::vector<std::optional<std::uint8_t>> data;  ///< Leading bytes that must match; no value = any byte.
  };
  struct OnSignal {  ///< The first row where the condition becomes true, having been false (or at the first row).
    Quantity quantity;
    std::optional<double> above, below;
  };
  std::variant<At, OnEvent, OnFrame, OnSignal> what;
};

/// `to` happens at or after `from`, at most `within` later. Margin in seconds. Judges the first `from`, or each one.
struct Reaction {
  Moment from;
  Moment to;
  Nanos within{};
  bool every = false;
  [[nodiscard]] Outcome judge(const record::Recording& recording) const;
};

/// A signal beyond a bound: above only: x >= above; below only: x <= below; both: between them.
struct Condition {
  Quantity quantity;
  std::optional<double> above, below;
};

/// The condition is true in every row of the window (in which `during` is true, if given).
struct Always {
  Condition condition;
  std::optional<Condition> during;
  Window window;
  [[nodiscard]] Outcome judge(const record::Recording& recording) const;
};

/// The condition is true in no row of the window; touching a bound is not yet true.
struct Never {
  Condition condition;
  std::optional<Condition> during;
  Window window;
  [[nodiscard]] Outcome judge(const record::Recording& recording) const;
};

/// An event is reported in the window: at least once, or exactly `count` times. Margin in events.
struct EventOccurs {
  std::string code;
  std::string source;  ///< Empty: any.
  std::optional<std::int64_t> count;
  Window window;
  [[nodiscard]] Outcome judge(const record::Recording& recording) const;
};

/// The gate that every run passes, asked for or not. Finds: events of Severity kWarning and kFault, error counter
/// signals that are not zero at the end, EMCY frames with a code other than 0, error frames, lost frames,
/// and a run that did not come to its end. Whatever is listed in `expect` is no finding:
///   "controller.law-refused"  an event, as source.code       "plant.rejected_feed_count"  an error counter signal
///   "emcy:feeder:8130"        an EMCY, node by name or number, code in hex; "emcy:feeder:*" any code
///   "error-frames"  "lost-frames"
/// Margin: minus the number of findings.
struct HealthGate {
  std::vector<std::string> expect;
  [[nodiscard]] Health judge(const record::Recording& recording) const;
};

}  // namespace meltbench::check
