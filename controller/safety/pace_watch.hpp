#pragma once
/// Hears that two devices share one node id. Numbers in, a decision out.

#include <algorithm>

#include "protocols/time/instant.hpp"

namespace meltbench::safety {

/// Counts the heartbeats of one node and forgets 1.5 of them per period. A single device leaves one, however much its
/// clock is off, below 50 %; two leave half a one more with each period, and are told within seven. A jam that is over
/// may hand over four at once: who was held up for longer has been missed before. Real time: no allocation.
class PaceWatch {
 public:
  static constexpr double kForgotten = 1.5;  ///< Per period.
  static constexpr double kMost = 4.0;

  explicit PaceWatch(Nanos period) : period_s_{to_s(period)} {}

  /// One has come. @returns true if there are too many, once.
  bool add(Instant at) {
    count_ = std::max(count_ - kForgotten * to_s(at - last_) / period_s_, 0.0) + 1.0;
    last_ = at;
    if (count_ <= kMost || told_) return false;
    return told_ = true;
  }

 private:
  double period_s_;
  double count_ = 0.0;
  Instant last_{};
  bool told_ = false;
};

}  // namespace meltbench::safety
