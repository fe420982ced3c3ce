#pragma once
/// A participant whose clock does not go as the bench's does.

#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "protocols/runtime/participant_port.hpp"
#include "protocols/time/instant.hpp"

namespace meltbench::fault {

/// What a clock shows: from `from` on, local = shown + (bench - from) (1 + drift), in whole nanoseconds.
class ClockSkew {
 public:
  /// Runs faster or slower from now on.
  void set_drift(Instant now, double drift_ppm) {
    shown_ = to_local(now);
    from_ = now;
    drift_ = drift_ppm * 1e-6;
  }
  /// Jumps forward. A monotonic clock never jumps back.
  void step(Instant now, Nanos by) {
    shown_ = to_local(now) + by;
    from_ = now;
  }
  [[nodiscard]] bool is_right() const { return drift_ == 0.0 && shown_ == from_; }

  [[nodiscard]] Instant to_local(Instant bench) const;
  /// The first bench instant at which the clock shows `local` or more.
  [[nodiscard]] Instant to_bench(Instant local) const;

 private:
  Instant from_;
  Instant shown_;
  double drift_ = 0.0;
};

/// Wakes a participant by its own clock.
class SkewedPort final : public runtime::ParticipantPort {
 public:
  /// @param port, clock  outlive this object.
  SkewedPort(runtime::ParticipantPort& port, const ClockSkew& clock) : port_{port}, clock_{clock} {}

  [[nodiscard]] std::string_view name() const override { return port_.name(); }
  [[nodiscard]] std::span<const SignalInfo> signals() const override { return port_.signals(); }
  [[nodiscard]] std::span<const std::string> nodes() const override { return port_.nodes(); }
  [[nodiscard]] std::span<const std::string> lines() const override { return port_.lines(); }
  [[nodiscard]] runtime::PortStatus wake(const Wakeup& in, Outbox& out, std::span<double> signals) override;

 private:
  runtime::ParticipantPort& port_;
  const ClockSkew& clock_;
  std::vector<can::StampedFrame> frames_;
  std::vector<SerialArrival> serial_;
};

}  // namespace meltbench::fault
