#pragma once
/// When the controller must let go of the extruder. Numbers in, a decision with its reason out.

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

#include "protocols/time/instant.hpp"

namespace meltbench::safety {

/// What is still safe to control with.
struct Limits {
  /// Oldest usable pressure, encoder sample or feeder report. The predictor bridges gaps with what the feeder delivers,
  /// but a disturbance in the gap stays unseen.
  Nanos max_age = 2s;
  Nanos max_implausible_time = 200ms;  ///< The pressure may be no pressure of this extruder for so long.
  Nanos max_disagreement_time = 1s;    ///< Pressure and mass balance may be further apart than they may for so long,
  Nanos max_unechoed_time = 2s;        ///< the feeder may do something else than it is asked for so long,
  Nanos max_wrong_speed_time = 1s;     ///< and the screw.
  double max_pressure_Pa = 0.0;        ///< Above it the model or the nozzle is not what was configured.
  double max_filled_length_m = 0.0;    ///< At or above it melt is about to reach the feed throat.
};

/// What the controller sees at one cycle.
struct Observation {
  Nanos pressure_age{};               ///< Of the newest usable pressure, by its time stamp.
  Nanos screw_age{};                  ///< Of the newest encoder sample.
  Nanos feed_age{};                   ///< Of the newest feeder report.
  Nanos implausible_time{};           ///< For how long pressures have come that cannot be used; 0 = the newest is good.
  Nanos disagreement_time{};          ///< For how long the pressure has not fitted to what was fed.
  Nanos unechoed_time{};              ///< For how long the feeder has reported another flow than the one asked for.
  Nanos wrong_speed_time{};           ///< For how long the encoder has shown another speed than the one asked for.
  std::optional<double> pressure_Pa;  ///< Newest one, if its status is good.
  std::optional<double> filled_length_m;  ///< Newest estimate, if usable.
};

/// Why control must stop; kNone: it may go on. The order is that of the table, most urgent first.
enum class Trip : std::uint8_t {
  kNone,
  kPressureHigh,
  kFlooding,
  kMeasurementImplausible,
  kMeasurementDisagrees,
  kScrewWrong,
  kFeedNotEchoed,
  kMeasurementStale,
  kScrewStale,
  kFeedStale,
};

/// The most urgent reason, in the order of Trip. A number that is missing trips nothing by itself: its age does.
[[nodiscard]] Trip judge(const Limits& limits, const Observation& seen);

/// Stable, in kebab case: "measurement-stale". @pre trip is not kNone.
[[nodiscard]] std::string_view code_of(Trip trip);

/// For people: value, limit and what to look at.
[[nodiscard]] std::string describe(Trip trip, const Limits& limits, const Observation& seen);

/// True for an EMCY that a node recovers from by itself while control goes on: its own supervision of the bus (81xx,
/// 82xx). Anything else says that the device no longer does what it is told.
[[nodiscard]] bool is_survivable_emcy(std::uint16_t code);

}  // namespace meltbench::safety
