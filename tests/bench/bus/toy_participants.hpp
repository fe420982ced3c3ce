#pragma once

#include <array>
#include <string>
#include <vector>

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

/// Wants to be woken by nothing but arrivals, and counts how often it was woken.
class WakeCounter final : public Participant {
 public:
  [[nodiscard]] std::string_view name() const override { return "counter"; }
  [[nodiscard]] std::span<const SignalInfo> signals() const override { return signals_; }
  void read_signals(std::span<double> values) const override { values[0] = wakes_; }
  void wake(const Wakeup&, Outbox&) override { wakes_ += 1; }

 private:
  std::array<SignalInfo, 1> signals_{{{"counter.wakes", SignalKind::kValue}}};
  double wakes_ = 0;
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

/// Sends its count over a serial line at every whole multiple of its period, three times each time, and counts the
/// pieces that come back and the changes of the line's state.
class SerialMetronome final : public Participant {
 public:
  SerialMetronome(std::string line, Nanos period) : lines_{std::move(line)}, period_{period} {}

  [[nodiscard]] std::string_view name() const override { return "metronome"; }
  [[nodiscard]] std::span<const std::string> lines() const override { return lines_; }
  [[nodiscard]] std::span<const SignalInfo> signals() const override { return signals_; }
  void read_signals(std::span<double> values) const override {
    values[0] = sent_;
    values[1] = received_;
    values[2] = downs_;
  }
  void wake(const Wakeup& in, Outbox& out) override {
    received_ += static_cast<double>(in.serial.size());
    const bool down = !in.lines.empty() && in.lines[0] == LinkState::kDown;
    if (down && !was_down_) downs_ += 1;
    was_down_ = down;
    for (; next_ <= in.now; next_ += period_) {
      sent_ += 1;
      const auto count = static_cast<std::uint8_t>(sent_);
      out.write(0, std::array{count, count, count});
    }
    out.wake_at(next_);
  }

 private:
  std::array<std::string, 1> lines_;
  Nanos period_;
  std::array<SignalInfo, 3> signals_{SignalInfo{"metronome.sent"}, SignalInfo{"metronome.received"},
                                     SignalInfo{"metronome.downs"}};
  Instant next_{};
  double sent_ = 0;
  double received_ = 0;
  double downs_ = 0;
  bool was_down_ = false;
};

/// Answers each piece on its serial lines with the same bytes, backwards.
class SerialEcho final : public Participant {
 public:
  explicit SerialEcho(std::vector<std::string> lines) : lines_{std::move(lines)} {}

  [[nodiscard]] std::string_view name() const override { return "echo"; }
  [[nodiscard]] std::span<const std::string> lines() const override { return lines_; }
  [[nodiscard]] std::span<const SignalInfo> signals() const override { return {}; }
  void read_signals(std::span<double>) const override {}
  void wake(const Wakeup& in, Outbox& out) override {
    for (const SerialArrival& arrival : in.serial) {
      const std::vector<std::uint8_t> backwards{arrival.bytes.rbegin(), arrival.bytes.rend()};
      out.write(arrival.line, backwards);
    }
  }

 private:
  std::vector<std::string> lines_;
};

}  // namespace meltbench::test
