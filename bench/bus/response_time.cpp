#include "bench/bus/response_time.hpp"

#include <algorithm>

#include "protocols/can/frame_length.hpp"

namespace meltbench::bus {
namespace {

/// Longer than any bus of a machine is busy without a pause; beyond it there is no bound.
constexpr Nanos kEndless = 60s;

std::int64_t instances(Nanos span, const PeriodicFrame& frame) {
  return (span + frame.jitter + frame.period - 1ns) / frame.period;
}

/// Analysis of one frame among the others.
class Response {
 public:
  Response(std::span<const PeriodicFrame> frames, const PeriodicFrame& frame, Nanos bit_time)
      : frames_{frames}, frame_{frame}, bit_time_{bit_time} {
    for (const PeriodicFrame& other : frames) {
      if (other.key > frame.key) blocking_ = std::max(blocking_, with_space(other));
    }
  }

  [[nodiscard]] std::optional<Nanos> calc_bound() const {
    const std::optional<Nanos> busy = find_fixed_point(with_space(frame_), [this](Nanos span) {
      return blocking_ + instances(span, frame_) * with_space(frame_) + interference(span);
    });
    if (!busy) return std::nullopt;
    Nanos worst{};
    for (std::int64_t q = 0; q < instances(*busy, frame_); ++q) {
      const Nanos own = blocking_ + q * with_space(frame_);
      const auto delay = find_fixed_point(own, [&](Nanos span) { return own + interference(span + bit_time_); });
      if (!delay) return std::nullopt;
      const Nanos queued_at = std::max(q * frame_.period - frame_.jitter, 0ns);  // The first one at 0 came at -J.
      worst = std::max(worst, *delay - queued_at + frame_.on_wire);
    }
    return worst;
  }

 private:
  [[nodiscard]] Nanos with_space(const PeriodicFrame& frame) const {
    return frame.on_wire + can::kIntermissionBits * bit_time_;
  }
  [[nodiscard]] Nanos interference(Nanos span) const {
    Nanos sum{};
    for (const PeriodicFrame& other : frames_) {
      if (other.key < frame_.key) sum += instances(span, other) * with_space(other);
    }
    return sum;
  }
  template <class Step>
  [[nodiscard]] static std::optional<Nanos> find_fixed_point(Nanos from, Step step) {
    for (Nanos value = from; value < kEndless;) {
      const Nanos next = step(value);
      if (next == value) return value;
      value = next;
    }
    return std::nullopt;
  }

  std::span<const PeriodicFrame> frames_;
  const PeriodicFrame& frame_;
  Nanos bit_time_;
  Nanos blocking_{};
};

}  // namespace

std::vector<std::optional<Nanos>> calc_response_bounds(std::span<const PeriodicFrame> frames, Nanos bit_time) {
  std::vector<std::optional<Nanos>> bounds;
  for (const PeriodicFrame& frame : frames) bounds.push_back(Response{frames, frame, bit_time}.calc_bound());
  return bounds;
}

}  // namespace meltbench::bus
