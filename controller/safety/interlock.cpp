#include "controller/safety/interlock.hpp"

#include <fmt/format.h>

namespace meltbench::safety {

Trip judge(const Limits& limits, const Observation& seen) {
  if (seen.pressure_Pa && *seen.pressure_Pa > limits.max_pressure_Pa) return Trip::kPressureHigh;
  if (seen.filled_length_m && *seen.filled_length_m >= limits.max_filled_length_m) return Trip::kFlooding;
  if (seen.implausible_time > limits.max_implausible_time) return Trip::kMeasurementImplausible;
  if (seen.pressure_age > limits.max_age) return Trip::kMeasurementStale;
  if (seen.screw_age > limits.max_age) return Trip::kScrewStale;
  if (seen.feed_age > limits.max_age) return Trip::kFeedStale;
  return Trip::kNone;
}

std::string_view code_of(Trip trip) {
  switch (trip) {
    case Trip::kNone:
      break;
    case Trip::kPressureHigh:
      return "pressure-high";
    case Trip::kFlooding:
      return "flooding";
    case Trip::kMeasurementImplausible:
      return "measurement-implausible";
    case Trip::kMeasurementStale:
      return "measurement-stale";
    case Trip::kScrewStale:
      return "screw-stale";
    case Trip::kFeedStale:
      return "feed-stale";
  }
  return "none";
}

std::string describe(Trip trip, const Limits& limits, const Observation& seen) {
  constexpr double kPaPerBar = 1e5;
  switch (trip) {
    case Trip::kNone:
      break;
    case Trip::kPressureHigh:
      return fmt::format("melt pressure {:.4g} bar, limit {:.4g} bar; is the nozzle blocked or the melt too cold?",
                         seen.pressure_Pa.value_or(0.0) / kPaPerBar, limits.max_pressure_Pa / kPaPerBar);
    case Trip::kFlooding:
      return fmt::format("filled length {:.4f} m, limit {:.4f} m; melt is about to reach the feed throat",
                         seen.filled_length_m.value_or(0.0), limits.max_filled_length_m);
    case Trip::kMeasurementImplausible:
      return fmt::format(
          "for {:.3f} s no pressure that fits this extruder, limit {:.3f} s; look at the transmitter "
          "and at whether the screw turns",
          to_s(seen.implausible_time), to_s(limits.max_implausible_time));
    case Trip::kMeasurementStale:
      return fmt::format("newest usable pressure is {:.3f} s old, limit {:.3f} s; are the transmitter's PDOs lost?",
                         to_s(seen.pressure_age), to_s(limits.max_age));
    case Trip::kScrewStale:
      return fmt::format("newest encoder sample is {:.3f} s old, limit {:.3f} s; are the drive's PDOs lost?",
                         to_s(seen.screw_age), to_s(limits.max_age));
    case Trip::kFeedStale:
      return fmt::format("newest feeder report is {:.3f} s old, limit {:.3f} s; are the feeder's PDOs lost?",
                         to_s(seen.feed_age), to_s(limits.max_age));
  }
  return "nothing";
}

bool is_survivable_emcy(std::uint16_t code) {
  const unsigned error_class = code >> 8;
  return code == 0 || error_class == 0x81 || error_class == 0x82;
}

}  // namespace meltbench::safety
