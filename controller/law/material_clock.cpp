#include "controller/law/material_clock.hpp"

#include <cmath>

namespace meltbench::law {

MaterialClock::MaterialClock(double speed_m_per_s, std::size_t samples) : samples_(samples), speed_{speed_m_per_s} {}

bool MaterialClock::add(Instant at, double s_m) {
  if (!std::isfinite(s_m)) return false;
  if (!samples_.empty()) {
    const Sample& newest = samples_.back();
    if (at <= newest.at || s_m < newest.s_m) return false;
    speed_ = (s_m - newest.s_m) / to_s(at - newest.at);
  }
  if (samples_.full()) samples_.pop_front();
  samples_.push_back(Sample{at, s_m});
  return true;
}

// Index of the first sample not before `at`; size() if there is none. Recent times first: they are what is asked for.
std::size_t MaterialClock::find_after(Instant at) const {
  std::size_t high = samples_.size();
  for (int i = 0; i < 4 && high > 0; ++i) {
    if (samples_[high - 1].at < at) return high;
    --high;
  }
  std::size_t low = 0;
  while (low < high) {
    const std::size_t middle = low + (high - low) / 2;
    if (samples_[middle].at < at) {
      low = middle + 1;
    } else {
      high = middle;
    }
  }
  return high;
}

double MaterialClock::at(Instant at) const {
  if (samples_.empty()) return speed_ * to_s(at);
  const std::size_t i = find_after(at);
  const Sample& reference = samples_[i == 0 ? 0 : i - 1];
  return reference.s_m + speed_m_per_s(at) * to_s(at - reference.at);
}

double MaterialClock::speed_m_per_s(Instant at) const {
  if (samples_.size() < 2) return speed_;
  std::size_t i = find_after(at);
  if (i == 0) i = 1;
  if (i == samples_.size()) return speed_;
  return (samples_[i].s_m - samples_[i - 1].s_m) / to_s(samples_[i].at - samples_[i - 1].at);
}

}  // namespace meltbench::law
