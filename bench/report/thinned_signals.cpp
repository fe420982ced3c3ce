#include "bench/report/thinned_signals.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace meltbench::report {

std::optional<std::size_t> ThinnedSignals::add(std::string name) {
  if (signals_.size() >= kMaxSignals) return std::nullopt;
  signals_.push_back({.name = std::move(name), .buckets = std::vector<Bucket>(kBuckets)});
  return signals_.size() - 1;
}

void ThinnedSignals::take(std::size_t number, Instant at, double value) {
  if (!std::isfinite(value)) return;
  while (at.since_start >= width_ * kBuckets) fold();
  const auto place = static_cast<std::size_t>(at.since_start / width_);
  used_ = std::max(used_, place + 1);
  Signal& signal = signals_[number];
  if (!signal.seen) signal.first = value;
  signal.moved = signal.moved || value != signal.first;
  signal.seen = true;
  const auto plotted = static_cast<float>(value);
  signal.buckets[place] = join(signal.buckets[place], {plotted, plotted, 1, false, false});
}

ThinnedSignals::Bucket ThinnedSignals::join(const Bucket& earlier, const Bucket& later) {
  if (earlier.count == 0 || later.count == 0) {
    Bucket one = earlier.count == 0 ? later : earlier;
    one.broken = one.count == 0 && (earlier.broken || later.broken);
    return one;
  }
  Bucket both{std::min(earlier.least, later.least), std::max(earlier.most, later.most), 2, false, false};
  const bool most_is_earlier = earlier.most >= later.most;
  const bool least_is_earlier = earlier.least <= later.least;
  both.most_first =
      most_is_earlier == least_is_earlier ? (most_is_earlier ? earlier : later).most_first : most_is_earlier;
  return both;
}

void ThinnedSignals::fold() {
  for (Signal& signal : signals_) {
    for (std::size_t i = 0; i < kBuckets / 2; ++i) {
      signal.buckets[i] = join(signal.buckets[2 * i], signal.buckets[2 * i + 1]);
    }
    std::fill(signal.buckets.begin() + kBuckets / 2, signal.buckets.end(), Bucket{});
  }
  width_ *= 2;
  used_ = (used_ + 1) / 2;
}

void ThinnedSignals::break_line(std::size_t number, Instant from, Instant to) {
  const auto last = static_cast<std::size_t>(std::max(to.since_start / width_, Nanos::rep{0}));
  for (auto place = static_cast<std::size_t>(from.since_start / width_); place <= last && place < used_; ++place) {
    Bucket& bucket = signals_[number].buckets[place];
    bucket.broken = bucket.count == 0;
  }
}

std::optional<double> ThinnedSignals::still_value(std::size_t number) const {
  const Signal& signal = signals_[number];
  return signal.seen && !signal.moved ? std::optional{signal.first} : std::nullopt;
}

void ThinnedSignals::fold_to(std::size_t max_values) {
  while (2 * used_ * signals_.size() > max_values && used_ > 1) fold();
}

std::vector<double> ThinnedSignals::times_s() const {
  std::vector<double> times;
  for (std::size_t i = 0; i < used_; ++i) {
    for (const double part : {0.25, 0.75}) times.push_back((static_cast<double>(i) + part) * to_s(width_));
  }
  return times;
}

std::vector<float> ThinnedSignals::values(std::size_t number) const {
  constexpr float kNoSample = std::numeric_limits<float>::infinity();
  constexpr float kGap = std::numeric_limits<float>::quiet_NaN();
  std::vector<float> values;
  for (std::size_t i = 0; i < used_; ++i) {
    const Bucket& bucket = signals_[number].buckets[i];
    if (bucket.count == 0) {
      values.insert(values.end(), 2, bucket.broken ? kGap : kNoSample);
    } else {
      values.push_back(bucket.most_first ? bucket.most : bucket.least);
      values.push_back(bucket.count == 1 ? kNoSample : bucket.most_first ? bucket.least : bucket.most);
    }
  }
  return values;
}

}  // namespace meltbench::report
