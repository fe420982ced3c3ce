#pragma once

#include "bench/check/check.hpp"
#include "bench/record/recording.hpp"

namespace meltbench::cli {

/// Prints one run's verdict for people: a heading, then a line per check.
/// @param speed  times faster than the wall clock; 0: unknown, not printed.  @param quiet  failures only.
void print_verdict(const record::Recording& recording, const check::CheckResults& results, double speed, bool quiet);

/// How many checks of all runs held, failed and were skipped.
struct Tally {
  std::size_t runs = 0;
  std::size_t held = 0;
  std::size_t failed = 0;
  std::size_t skipped = 0;
  void add(const check::CheckResults& results);
};
/// "3 runs: 12 checks held, 0 failed"
void print_tally(const Tally& tally);

}  // namespace meltbench::cli
