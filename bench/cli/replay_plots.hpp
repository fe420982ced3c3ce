#pragma once

#include <cstdint>
#include <map>
#include <string>

#include "bench/replay/fits.hpp"
#include "bench/report/plots.hpp"
#include "bench/report/thinned_signals.hpp"

namespace meltbench::cli {

/// Keeps recorded and replayed values of a replay for its page, thinned: memory does not grow with the log.
class ReplayPlots {
 public:
  void take(const replay::ValuePair& pair);

  /// The signals that differ, one plot each: run 0 as recorded, run 1 as replayed. Once, at the end.
  [[nodiscard]] report::Plots finish(const replay::Fits& fits, const decode::BusView& view);
  /// Of the signals that differ. After finish().
  [[nodiscard]] std::uint64_t left_out() const { return left_out_; }

 private:
  struct Lines {
    std::size_t recorded = 0;
    std::size_t replayed = 0;
  };

  report::ThinnedSignals signals_;
  std::map<replay::Fits::Key, Lines> lines_;
  Instant latest_{};
  std::uint64_t left_out_ = 0;
};

/// "Set point of mass flow in kg/h" -> name and unit, as the boards' EDS files write them.
[[nodiscard]] std::pair<std::string, std::string> split_unit(const std::string& name);

}  // namespace meltbench::cli
