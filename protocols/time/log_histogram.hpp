#pragma once

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstddef>
#include <cstdint>

#include "protocols/time/instant.hpp"

namespace meltbench {

/// Counts spans of time, 1 ns to 17 s, in 32 buckets per octave: what is read from it is at most 1/32 too large.
/// Fixed size, no allocation: a loop may count into it. The largest span, and when it was, are kept exactly.
class LogHistogram {
 public:
  static constexpr unsigned kBitsPerOctave = 5;
  static constexpr std::size_t kPerOctave = std::size_t{1} << kBitsPerOctave;
  static constexpr unsigned kTopBit = 34;  // 2^34 ns = 17 s; longer spans are counted in the last bucket.
  static constexpr std::size_t kBuckets = (kTopBit - kBitsPerOctave + 1) * kPerOctave;

  /// @param span  negative counts as none.  @param at  when it was.
  void add(Nanos span, Instant at) noexcept {
    const auto ns = static_cast<std::uint64_t>(std::max<Nanos::rep>(span.count(), 0));
    ++counts_[index_of(ns)];
    ++count_;
    if (span >= max_) {
      max_ = span;
      max_at_ = at;
    }
  }

  /// Puts a bucket back as it was read from another histogram. @pre bucket < kBuckets.
  void add_bucket(std::size_t bucket, std::uint64_t count) noexcept {
    counts_[bucket] += count;
    count_ += count;
  }
  void set_max(Nanos max, Instant at) noexcept {
    max_ = max;
    max_at_ = at;
  }

  [[nodiscard]] std::uint64_t count() const noexcept { return count_; }
  [[nodiscard]] Nanos max() const noexcept { return max_; }
  [[nodiscard]] Instant max_at() const noexcept { return max_at_; }
  [[nodiscard]] std::uint64_t in_bucket(std::size_t bucket) const noexcept { return counts_[bucket]; }

  /// Smallest span that is counted in the bucket; of kBuckets: the end of the last one.
  [[nodiscard]] static constexpr Nanos lower_edge(std::size_t bucket) noexcept {
    if (bucket < kPerOctave) return Nanos{static_cast<Nanos::rep>(bucket)};
    const auto octave = static_cast<unsigned>(bucket / kPerOctave - 1);
    return Nanos{static_cast<Nanos::rep>((kPerOctave + bucket % kPerOctave) << octave)};
  }

  /// Span that `share` of all are not longer than, nearest rank, rounded up to the end of its bucket but not above the
  /// largest. 0 if nothing was counted. @pre 0 < share <= 1.
  [[nodiscard]] Nanos quantile(double share) const noexcept {
    const auto rank = static_cast<std::uint64_t>(std::ceil(share * static_cast<double>(count_)));
    std::uint64_t below = 0;
    for (std::size_t bucket = 0; bucket + 1 < kBuckets; ++bucket) {
      below += counts_[bucket];
      if (below >= rank && below > 0) return std::min(lower_edge(bucket + 1) - Nanos{1}, max_);
    }
    return max_;
  }

 private:
  static constexpr std::size_t index_of(std::uint64_t ns) noexcept {
    if (ns < kPerOctave) return static_cast<std::size_t>(ns);
    const unsigned octave = static_cast<unsigned>(std::bit_width(ns)) - 1U - kBitsPerOctave;
    const std::size_t index = kPerOctave * octave + static_cast<std::size_t>(ns >> octave);
    return std::min(index, kBuckets - 1);
  }

  std::array<std::uint64_t, kBuckets> counts_{};
  std::uint64_t count_ = 0;
  Nanos max_{};
  Instant max_at_{};
};

}  // namespace meltbench
