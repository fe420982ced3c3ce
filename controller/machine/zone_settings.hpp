#pragma once
/// The heated zones: what they are to be, and how they are watched.

#include <cstddef>
#include <vector>

#include "controller/safety/zone_watch.hpp"
#include "protocols/time/instant.hpp"

namespace meltbench::machine {

/// Channels of the heater board: four barrel zones and the nozzle.
inline constexpr std::size_t kMaxZones = 5;
inline constexpr std::size_t kNozzleChannel = 5;

/// [controller.zones]; key, range, (default), what and why:
/// - barrel_degC       0..400, array of 1..4    set points of the barrel zones from the feed throat on; no default: a
///                                              forgotten one must not heat. As many as there are zones
/// - nozzle_degC       0..400 (no nozzle)       set point of the nozzle heater
/// - band_K            > 0 (3)                  within the set point by this is warm
/// - max_degC          (set point + 40)         above it: safe state
/// - window_s          > 0 (60)                 a zone at full or no power is judged after so long
/// - min_rise_K        > 0 (2)                  least rise in a window at full power
/// - max_unasked_K     > 0 (2)                  largest rise in a window without power
/// - max_still_output  > 0..1 (0.1)           output that may have moved, for a window, without another temperature
/// - max_step_K        > 0 (20)                 largest step of a temperature from one report to the next
/// - timeout_s         > 0 (2)                  no report of the heater for so long: safe state
struct ZoneSettings {
  struct Zone {
    std::size_t channel = 1;  ///< 1..kMaxZones.
    double set_degC = 0.0;
  };
  std::vector<Zone> zones;  ///< By channel.
  double band_K = 3.0;
  safety::ZoneLimits limits;
  Nanos timeout = 2s;
};

}  // namespace meltbench::machine
