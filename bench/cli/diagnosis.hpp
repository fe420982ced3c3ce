#pragma once
/// Finds what failed where no frame says so: a sensor that drifts or is stuck, a relay that is welded, a feeder that
/// bridges.

#include <optional>
#include <string>
#include <vector>

#include "bench/cli/closed_loop.hpp"

namespace meltbench::cli {

struct Diagnosis {
  std::optional<config::Table> fault;  ///< What repeats the log best, if anything does.
  std::optional<config::Table> check;  ///< That the measurement ends where it did.
  std::string text;                    ///< For people; empty: the log shows what a healthy machine shows.
};

/// Runs the machine healthy (but for the faults that are known), finds the first measurement in which the log departs
/// from that, and tries everything that could move it, in closed loop. When it began is moved until the departure comes
/// when it did, and until the controller reacts when it did; what then lies nearest to the log is the fault, if it is
/// much nearer than no fault at all.
///
/// Looks at the time before the first known fault only: behind it, no run needs to be alike.
/// @param log       measurements of the log.
/// @param reaction  time of the safe state in the log.
/// Cost: one run if the log is healthy, else 5 to 50.
[[nodiscard]] Diagnosis diagnose(ClosedLoop& loop, const decode::Traces& log, const std::vector<config::Table>& known,
                                 std::optional<Instant> reaction);

}  // namespace meltbench::cli
