#pragma once
/// Signals of a stream whose length nobody knows beforehand, thinned while they come to what a page can hold.

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "bench/report/plots.hpp"
#include "protocols/time/instant.hpp"

namespace meltbench::report {

/// Cuts time into equal buckets and keeps the smallest and the largest value of each signal in each, in their order, so
/// that no peak is lost. All signals have the same buckets. When the stream grows beyond them, two become one:
/// of the time that was seen, a bucket is never more than the 2,048th part.
///
/// Memory: 48 KiB a signal. Cost: some ns a value.
class ThinnedSignals {
 public:
  static constexpr std::size_t kMaxSignals = 200;

  /// @returns the number of a new signal; nothing if there are kMaxSignals.
  [[nodiscard]] std::optional<std::size_t> add(std::string name);
  /// @param at  >= 0. Values of one signal come in the order of time.
  void take(std::size_t signal, Instant at, double value);
  /// Nothing was heard of this signal between the two: its line has a gap there.
  void break_line(std::size_t signal, Instant from, Instant to);

  [[nodiscard]] std::size_t size() const { return signals_.size(); }
  [[nodiscard]] const std::string& name(std::size_t signal) const { return signals_[signal].name; }
  /// The only value that it ever had; nothing if it moved or had none.
  [[nodiscard]] std::optional<double> still_value(std::size_t signal) const;

  /// Puts two buckets into one until all signals together have at most so many values. Last of all.
  void fold_to(std::size_t max_values);
  [[nodiscard]] std::vector<double> times_s() const;  ///< Two in each bucket.
  /// As in Plots. One per time.
  [[nodiscard]] std::vector<float> values(std::size_t signal) const;

 private:
  struct Bucket {
    float least = 0;
    float most = 0;
    std::uint8_t count = 0;   ///< 0, 1, or 2 for more.
    bool most_first = false;  ///< Of two.
    bool broken = false;      ///< Empty, and the line ends here.
  };
  struct Signal {
    std::string name;
    std::vector<Bucket> buckets;
    double first = 0;
    bool seen = false;
    bool moved = false;
  };
  [[nodiscard]] static Bucket join(const Bucket& earlier, const Bucket& later);
  void fold();

  static constexpr std::size_t kBuckets = 4096;
  std::vector<Signal> signals_;
  Nanos width_{1ms};
  std::size_t used_ = 0;  ///< Buckets that time has reached.
};

}  // namespace meltbench::report
