#pragma once
/// How well a replay met the recording, signal by signal.

#include <cstdint>
#include <map>
#include <string>
#include <utility>

#include "bench/replay/comparison.hpp"

namespace meltbench::replay {

/// Of one object in PDOs, in its unit on the wire.
struct SignalFit {
  std::string name;             ///< By the EDS.
  std::uint64_t compared = 0;   ///< Values.
  std::uint64_t differing = 0;  ///< Of these, by whatever little.
  double largest = 0.0;         ///< Difference, its size.
  Instant at;                   ///< Of the largest; of the first, if it has no size because one is no number.
  std::uint64_t line = 0;       ///< Likewise, in the log.
  double sum_of_squares = 0.0;
  std::uint64_t numbers = 0;  ///< Pairs of two numbers.

  /// sqrt(mean of the squared differences), over the pairs of two numbers; 0 without any.
  [[nodiscard]] double rms() const;
};

/// Gathers the fit of every signal. Cost: one search among the signals for each value.
class Fits {
 public:
  using Key = std::pair<std::uint8_t, canopen::ObjectAddress>;  ///< Node id and object.

  void take(const ValuePair& pair);
  [[nodiscard]] const std::map<Key, SignalFit>& signals() const { return signals_; }

 private:
  std::map<Key, SignalFit> signals_;
};

}  // namespace meltbench::replay
