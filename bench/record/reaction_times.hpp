#pragma once

#include "bench/record/recording.hpp"
#include "protocols/time/log_histogram.hpp"

namespace meltbench::record {

/// From each SYNC to the first command that follows it before the next SYNC: a PDO to a board, by the identifiers of
/// the predefined connection set. As seen on the wire, so it holds for any controller. A SYNC without a command after
/// it does not count.
[[nodiscard]] LogHistogram calc_reaction_times(const FrameLog& frames);

}  // namespace meltbench::record
