#pragma once

#include <map>

#include "bench/bus/bit_timed_medium.hpp"
#include "bench/record/recording.hpp"
#include "controller/machine/settings.hpp"

namespace meltbench::cli {

/// Worst response of each standard identifier that the rig's traffic has, from queued to the end of the frame; in
/// operation, without errors. Empty for nodes that send in FIFO order: the analysis is for those that send by priority.
///
/// What SYNC sets off comes as late as SYNC itself can be, and what answers that as late as the latest of those.
using ResponseBounds = std::map<std::uint32_t, Nanos>;
[[nodiscard]] ResponseBounds calc_bounds(const config::RigBus& bus, const machine::ControllerSettings& settings);

/// What the bus has counted in a run that took so long.
[[nodiscard]] record::BusTiming describe(bus::BitTimedMedium& medium, Nanos duration, const ResponseBounds& bounds);

}  // namespace meltbench::cli
