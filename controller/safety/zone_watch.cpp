#include "controller/safety/zone_watch.hpp"

#include <fmt/format.h>

#include <cmath>

namespace meltbench::safety {

ZoneWatch::Heater ZoneWatch::classify(const ZoneReport& report) const {
  if (report.output >= limits_.full_output) return Heater::kOn;
  if (report.output <= limits_.no_output) return Heater::kOff;
  return Heater::kBetween;
}

bool ZoneWatch::is_stuck(Instant at, const ZoneReport& report) {
  const bool begins = still_from_ == Instant::never() || report.T_degC != still_degC_ || at - still_from_ > kStillFor;
  if (begins) {
    still_degC_ = report.T_degC;
    still_from_ = at;
    still_output_ = report.output;
  }
  if (std::abs(report.output - still_output_) <= limits_.max_still_output) {
    moved_at_ = Instant::never();
    return false;
  }
  if (moved_at_ == Instant::never()) moved_at_ = at;
  return at - moved_at_ >= limits_.window;
}

ZoneTrip ZoneWatch::add(Instant at, const ZoneReport& report, std::optional<double> set_point_degC) {
  if (!report.sensor_good) return ZoneTrip::kSensorOpen;
  if (!(report.T_degC <= limits_.max_degC)) return ZoneTrip::kOverTemperature;  // NaN is no temperature either.
  const double before_degC = last_degC_.value_or(report.T_degC);
  last_degC_ = report.T_degC;
  if (report.T_degC < limits_.min_degC || std::abs(report.T_degC - before_degC) > limits_.max_step_K) {
    return ZoneTrip::kImplausible;
  }
  const bool stuck = is_stuck(at, report);
  const ZoneTrip trip = judge_window(at, report, set_point_degC);
  return stuck && trip == ZoneTrip::kNone ? ZoneTrip::kStuck : trip;
}

ZoneTrip ZoneWatch::judge_window(Instant at, const ZoneReport& report, std::optional<double> set_point_degC) {
  const Heater heater = classify(report);
  if (heater != heater_) {
    heater_ = heater;
    window_from_ = at;
    window_T_degC_ = report.T_degC;
    return ZoneTrip::kNone;
  }
  if (heater == Heater::kBetween || at - window_from_ < limits_.window) return ZoneTrip::kNone;
  rise_K_ = report.T_degC - window_T_degC_;
  window_from_ = at;
  window_T_degC_ = report.T_degC;
  if (heater == Heater::kOn) return rise_K_ < limits_.min_rise_K ? ZoneTrip::kNotRising : ZoneTrip::kNone;
  const bool asked = set_point_degC && report.T_degC <= *set_point_degC + limits_.max_unasked_rise_K;
  return !asked && rise_K_ > limits_.max_unasked_rise_K ? ZoneTrip::kRisingUnasked : ZoneTrip::kNone;
}

std::string_view code_of(ZoneTrip trip) {
  switch (trip) {
    case ZoneTrip::kNone:
      break;
    case ZoneTrip::kOverTemperature:
      return "zone-over-temperature";
    case ZoneTrip::kSensorOpen:
      return "zone-sensor-open";
    case ZoneTrip::kImplausible:
      return "zone-implausible";
    case ZoneTrip::kNotRising:
      return "zone-not-rising";
    case ZoneTrip::kStuck:
      return "zone-stuck";
    case ZoneTrip::kRisingUnasked:
      return "zone-rising-unasked";
  }
  return "none";
}

std::string describe(ZoneTrip trip, const ZoneWatch& watch, std::string_view zone, const ZoneReport& report) {
  const ZoneLimits& limits = watch.limits();
  switch (trip) {
    case ZoneTrip::kNone:
      break;
    case ZoneTrip::kOverTemperature:
      return fmt::format("{}: {:.1f} C, limit {:.1f} C; is its relay welded?", zone, report.T_degC, limits.max_degC);
    case ZoneTrip::kSensorOpen:
      return fmt::format("{}: thermocouple open or not trusted by its board; look at the plug of the sensor", zone);
    case ZoneTrip::kImplausible:
      return fmt::format(
          "{}: {:.1f} C is no temperature that it can have now, a step of more than {:.0f} K or below "
          "{:.0f} C; has the thermocouple fallen out?",
          zone, report.T_degC, limits.max_step_K, limits.min_degC);
    case ZoneTrip::kNotRising:
      return fmt::format(
          "{}: {:+.1f} K in {:.0f} s of full power, at least {:.1f} K expected; look at the heater band, "
          "its fuse, and the seat of the thermocouple",
          zone, watch.rise_K(), to_s(limits.window), limits.min_rise_K);
    case ZoneTrip::kStuck:
      return fmt::format(
          "{}: {:.1f} C without a change for {:.0f} s, although its power is another by more than {:.0f} %; is its "
          "thermocouple's converter frozen?",
          zone, report.T_degC, to_s(limits.window), 100 * limits.max_still_output);
    case ZoneTrip::kRisingUnasked:
      return fmt::format("{}: {:+.1f} K in {:.0f} s without power, at most {:.1f} K expected; is its relay welded?",
                         zone, watch.rise_K(), to_s(limits.window), limits.max_unasked_rise_K);
  }
  return "nothing";
}

}  // namespace meltbench::safety
