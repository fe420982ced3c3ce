#pragma once

#include <string>

#include "protocols/participant/participant.hpp"

namespace meltbench::test {

/// Sends its count as a frame at every whole multiple of its period, and counts what arrives.
class Metronome final : public Participant {
 public:
  Metronome(std::string name, std::uint32_t id, Nanos period)
      : name_{std::move(name)},
        id_{id},
        period_{period},
        signals_{{name_ + ".sent", SignalKind::kValue}, {name_ + ".received", SignalKind::kValue}} {}

  [[nodiscard]] std::string_view name() const override { return name_; }
  [[nodiscard]] std::span<const SignalInfo> signals() const override { return signals_; }
  void read_signals(std::span<double> values) const override {
    values[0] = sent_;
    values[1] = received_;
  }
  void wake(const Wakeup& in, Outbox& out) override {
    received_ += static_cast<double>(in.frames.size());
    for (; next_ <= in.now; next_ += period_) {
      sent_ += 1;
      out.send(can::make_frame(id_, {static_cast<std::uint8_t>(sent_)}));
    }
    out.wake_at(next_);
  }

 private:
  std::string name_;
  std::uint32_t id_;
  Nanos period_;
  std::vector<SignalInfo> signals_;
  Instant next_{};
  double sent_ = 0;
  double received_ = 0;
};

/// Answers every frame with one whose id is higher by 0x100; ids from 0x700 on are not answered.
class Echo final : public Participant {
 public:
  [[nodiscard]] std::string_view name() const override { return "echo"; }
  [[nodiscard]] std::span<const SignalInfo> signals() const override { return {}; }
  void read_signals(std::span<double>) const override {}
  void wake(const Wakeup& in, Outbox& out) override {
    for (const can::StampedFrame& stamped : in.frames) {
      if (stamped.frame.id >= 0x700) continue;
      can::CanFrame answer = stamped.frame;
      answer.id += 0x100;
      out.send(answer);
    }
  }
};

}  // namespace meltbench::test
