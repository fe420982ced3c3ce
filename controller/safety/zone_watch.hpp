#pragma once
/// Watches that a heated zone does what its heater promises. Numbers in, a decision with its reason out.

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

#include "protocols/time/instant.hpp"

namespace meltbench::safety {

/// What a healthy zone keeps to. The same for all zones: the window is the slowest one's.
struct ZoneLimits {
  double max_degC = 300.0;          ///< Above it: trip, whatever the set point.
  double full_output = 0.9;         ///< Output share from which the heater counts as on ...
  double no_output = 0.02;          ///< ... and up to which as off.
  Nanos window = 60s;               ///< For so long on or off without a break, before it is judged.
  double min_rise_K = 2.0;          ///< Least rise in a window with the heater on.
  double max_step_K = 20.0;         ///< Between two reports: no zone is that fast.
  double min_degC = -20.0;          ///< Below it nothing is measured any more.
  double max_unasked_rise_K = 2.0;  ///< Largest rise in a window with the heater off, above the set point.
  /// Share by which the output may have moved, for a window, since the temperature last moved by a count.
  double max_still_output = 0.1;
};

/// One report of a zone.
struct ZoneReport {
  double T_degC = 0.0;
  bool sensor_good = true;  ///< False: open thermocouple, or a value that the board does not trust.
  double output = 0.0;      ///< Share of the rated power, 0..1.
};

enum class ZoneTrip : std::uint8_t {
  kNone,
  kOverTemperature,
  kSensorOpen,
  kImplausible,    ///< A jump, or colder than any workshop: a thermocouple that is loose or has fallen out.
  kNotRising,      ///< Full power and no heat: heater burnt out, fuse, thermocouple fallen out of its bore.
  kStuck,          ///< Another power and not one count of another temperature: a reading that is frozen.
  kRisingUnasked,  ///< Heat and no power: contact of the relay welded, or the set point of another master.
};

/// Judges one zone. Any doubt is a trip: an extruder that cools down is repaired easier than one that burns.
/// Windows follow each other without overlap; a window starts anew whenever the heater changes between on, off and in
/// between, so a zone that is held at its set point is in no window. A neighbour's heat raises a zone too: rising with
/// the heater off counts only above the set point, where no neighbour should push it. A reading that stands still is
/// healthy as long as the output stands still, too: controller/MODEL.md, "Zones".
/// Real time: no allocation, a few comparisons.
class ZoneWatch {
 public:
  explicit ZoneWatch(const ZoneLimits& limits) : limits_{limits} {}

  /// @param set_point_degC  what the zone is to be at; nothing: all zones are off.
  ZoneTrip add(Instant at, const ZoneReport& report, std::optional<double> set_point_degC);

  /// Rise in the window that ended with the last trip [K].
  [[nodiscard]] double rise_K() const { return rise_K_; }
  [[nodiscard]] const ZoneLimits& limits() const { return limits_; }

 private:
  enum class Heater : std::uint8_t { kBetween, kOn, kOff };
  [[nodiscard]] Heater classify(const ZoneReport& report) const;

  [[nodiscard]] ZoneTrip judge_window(Instant at, const ZoneReport& report, std::optional<double> set_point_degC);
  [[nodiscard]] bool is_stuck(Instant at, const ZoneReport& report);

  /// A load that changes more slowly than half a count shows is taken up without another reading: then the output of
  /// long ago says nothing.
  static constexpr Nanos kStillFor = 2400s;

  ZoneLimits limits_;
  std::optional<double> last_degC_;
  double still_degC_ = 0.0;  // The reading that has not changed,
  Instant still_from_ = Instant::never();
  double still_output_ = 0.0;            // the output when it came,
  Instant moved_at_ = Instant::never();  // and since when it has been another one.
  Heater heater_ = Heater::kBetween;
  Instant window_from_;
  double window_T_degC_ = 0.0;
  double rise_K_ = 0.0;
};

/// Stable, in kebab case: "zone-not-rising". @pre trip is not kNone.
[[nodiscard]] std::string_view code_of(ZoneTrip trip);

/// For people: zone, value, limit and what to look at.
[[nodiscard]] std::string describe(ZoneTrip trip, const ZoneWatch& watch, std::string_view zone,
                                   const ZoneReport& report);

}  // namespace meltbench::safety
