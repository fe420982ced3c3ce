#include "bench/fault/clock_skew.hpp"

#include <cmath>

namespace meltbench::fault {

Instant ClockSkew::to_local(Instant bench) const {
  const Nanos since = bench - from_;
  return shown_ + since + Nanos{std::llround(drift_ * static_cast<double>(since.count()))};
}

Instant ClockSkew::to_bench(Instant local) const {
  if (local == Instant::never()) return local;
  if (local <= shown_) return from_;
  const double since_ns = static_cast<double>((local - shown_).count()) / (1.0 + drift_);
  Instant bench = from_ + Nanos{static_cast<std::int64_t>(since_ns)};
  while (to_local(bench) < local) bench += 1ns;  // Rounding: at most a few.
  return bench;
}

}  // namespace meltbench::fault
