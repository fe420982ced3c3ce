#include "controller/machine/feed_tracker.hpp"

#include <algorithm>
#include <bit>

namespace meltbench::machine {

FeedTracker::FeedTracker(Nanos latency, Nanos cycle, std::size_t capacity)
    : latency_{latency}, cycle_{cycle}, commands_(capacity) {
  intervals_.reserve(std::bit_ceil(capacity) + 2);
}

void FeedTracker::command(Instant sent_at, double flow_kg_per_s) {
  if (commands_.full()) commands_.pop_front();
  commands_.push_back({sent_at, flow_kg_per_s});
}

std::span<const law::FeedInterval> FeedTracker::report(const FeedSample& sample) {
  intervals_.clear();
  if (known_until_ && sample.at <= *known_until_) return {};
  const auto changes = static_cast<std::uint8_t>(sample.changes - changes_);
  if (known_until_) {
    const Instant from = *known_until_;
    const Instant changed_at = sample.age ? sample.at - *sample.age : from;
    if (changes > 1) append_unreported(from, changed_at);
    if (changes > 0 && changed_at > from) intervals_.push_back({changed_at, flow_});
    intervals_.push_back({sample.at, sample.flow_kg_per_s});
  }
  known_until_ = sample.at;
  flow_ = sample.flow_kg_per_s;
  changes_ = sample.changes;
  while (!commands_.empty() && commands_.front().sent_at + latency_ + cycle_ <= sample.at) commands_.pop_front();
  return intervals_;
}

// Changes before the last one, which the feeder has dated itself: as the commands had it.
void FeedTracker::append_unreported(Instant from, Instant changed_at) {
  const Instant before = changed_at - cycle_ / 2 - kAgeStep;
  for (std::size_t i = 0; i < commands_.size(); ++i) {
    const Instant effect = calc_effect(commands_[i].sent_at);
    if (effect <= from) continue;
    if (effect >= before) break;
    intervals_.push_back({effect, flow_});
    flow_ = commands_[i].flow_kg_per_s;
  }
}

std::span<const law::FeedInterval> FeedTracker::calc_in_flight(Instant effect_at) {
  intervals_.clear();
  if (!known_until_) return {};
  Instant end = *known_until_;
  double flow = flow_;
  for (std::size_t i = 0; i < commands_.size(); ++i) {
    const Instant effect = std::max(calc_effect(commands_[i].sent_at), end);
    if (effect >= effect_at) break;
    if (effect > end) intervals_.push_back({effect, flow});
    end = effect;
    flow = commands_[i].flow_kg_per_s;
  }
  intervals_.push_back({effect_at, flow});
  return intervals_;
}

}  // namespace meltbench::machine
