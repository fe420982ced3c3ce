#include "controller/safety/interlock.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <limits>

namespace meltbench::safety {

namespace {

constexpr double kPaPerBar = 1e5;
constexpr double kUnknown = std::numeric_limits<double>::quiet_NaN();

/// One line of the interlock table. All of them have the same reaction: the safe state. A limit in seconds is also the
/// time within which it reacts; the others react in the next cycle.
struct Interlock {
  Trip trip{};
  std::string_view code;                ///< Stable, in kebab case: "measurement-stale".
  std::string_view source;              ///< What is looked at.
  std::string_view unit;                ///< Of value and limit, as messages have them.
  double (*value)(const Observation&);  ///< In that unit; not a number: unknown, trips nothing.
  double (*limit)(const Limits&);
  bool at_limit = false;  ///< The limit itself trips already.
  std::string_view hint;  ///< What to look at.
};

constexpr std::array kInterlocks{
    Interlock{Trip::kPressureHigh, "pressure-high", "melt pressure", "bar",
              [](const Observation& seen) { return seen.pressure_Pa.value_or(kUnknown) / kPaPerBar; },
              [](const Limits& limits) { return limits.max_pressure_Pa / kPaPerBar; }, false,
              "is the nozzle blocked or the melt too cold?"},
    Interlock{Trip::kFlooding, "flooding", "filled length", "m",
              [](const Observation& seen) { return seen.filled_length_m.value_or(kUnknown); },
              [](const Limits& limits) { return limits.max_filled_length_m; }, true,
              "melt is about to reach the feed throat"},
    Interlock{Trip::kMeasurementImplausible, "measurement-implausible",
              "time without a pressure that fits this extruder", "s",
              [](const Observation& seen) { return to_s(seen.implausible_time); },
              [](const Limits& limits) { return to_s(limits.max_implausible_time); }, false,
              "look at the transmitter and at whether the screw turns"},
    Interlock{Trip::kMeasurementDisagrees, "measurement-disagrees", "time without agreement of pressure and feed", "s",
              [](const Observation& seen) { return to_s(seen.disagreement_time); },
              [](const Limits& limits) { return to_s(limits.max_disagreement_time); }, false,
              "is the transmitter stuck, does the feeder bridge, is the nozzle clogged?"},
    Interlock{Trip::kScrewWrong, "screw-wrong", "time at another speed than asked for", "s",
              [](const Observation& seen) { return to_s(seen.wrong_speed_time); },
              [](const Limits& limits) { return to_s(limits.max_wrong_speed_time); }, false,
              "is the encoder's cable loose, does the screw slip or stand?"},
    Interlock{Trip::kFeedNotEchoed, "feed-not-echoed", "time with another flow than asked for", "s",
              [](const Observation& seen) { return to_s(seen.unechoed_time); },
              [](const Limits& limits) { return to_s(limits.max_unechoed_time); }, false,
              "are set points lost, or does somebody else command the feeder?"},
    Interlock{Trip::kMeasurementStale, "measurement-stale", "age of the newest usable pressure", "s",
              [](const Observation& seen) { return to_s(seen.pressure_age); },
              [](const Limits& limits) { return to_s(limits.max_age); }, false, "are the transmitter's PDOs lost?"},
    Interlock{Trip::kScrewStale, "screw-stale", "age of the newest encoder sample", "s",
              [](const Observation& seen) { return to_s(seen.screw_age); },
              [](const Limits& limits) { return to_s(limits.max_age); }, false, "are the drive's PDOs lost?"},
    Interlock{Trip::kFeedStale, "feed-stale", "age of the newest feeder report", "s",
              [](const Observation& seen) { return to_s(seen.feed_age); },
              [](const Limits& limits) { return to_s(limits.max_age); }, false, "are the feeder's reports lost?"},
};

const Interlock& find(Trip trip) {
  return *std::find_if(kInterlocks.begin(), kInterlocks.end(), [&](const Interlock& one) { return one.trip == trip; });
}

}  // namespace

Trip judge(const Limits& limits, const Observation& seen) {
  for (const Interlock& one : kInterlocks) {
    const double value = one.value(seen);
    const double limit = one.limit(limits);
    if (value > limit || (one.at_limit && value == limit)) return one.trip;
  }
  return Trip::kNone;
}

std::string_view code_of(Trip trip) {
  return find(trip).code;
}

std::string describe(Trip trip, const Limits& limits, const Observation& seen) {
  const Interlock& one = find(trip);
  return fmt::format("{} {:.4g} {}, limit {:.4g} {}; {}", one.source, one.value(seen), one.unit, one.limit(limits),
                     one.unit, one.hint);
}

bool is_survivable_emcy(std::uint16_t code) {
  const unsigned error_class = code >> 8;
  return code == 0 || error_class == 0x81 || error_class == 0x82;
}

}  // namespace meltbench::safety
