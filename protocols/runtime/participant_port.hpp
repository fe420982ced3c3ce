#pragma once
/// How the bench wakes a participant, wherever it lives: in this process, or in another one.

#include <span>
#include <string>
#include <string_view>

#include "protocols/participant/participant.hpp"

namespace meltbench::runtime {

/// Outcome of one wake-up. kGone: its process has ended. kHanging: no answer within the watchdog's wall-clock time.
/// kInterrupted: a signal came (Ctrl-C); the answer is still to come and will not be waited for.
/// kNonsense: it answered with what is no answer.
enum class PortStatus : std::uint8_t { kOk, kGone, kHanging, kInterrupted, kNonsense };

class ParticipantPort {
 public:
  virtual ~ParticipantPort() = default;
  [[nodiscard]] virtual std::string_view name() const = 0;
  [[nodiscard]] virtual std::span<const SignalInfo> signals() const = 0;
  /// As Participant::nodes() and lines().
  [[nodiscard]] virtual std::span<const std::string> nodes() const = 0;
  [[nodiscard]] virtual std::span<const std::string> lines() const = 0;
  /// Wakes the participant and waits for its answer. `out` is filled anew; `signals` gets the values after the wake-up.
  [[nodiscard]] virtual PortStatus wake(const Wakeup& in, Outbox& out, std::span<double> signals) = 0;
};

/// In-process driver: the participant is an object of this thread. No system call, no copy.
class InProcessPort final : public ParticipantPort {
 public:
  /// @param participant  outlives the port.
  explicit InProcessPort(Participant& participant) : participant_{participant} {}

  [[nodiscard]] std::string_view name() const override { return participant_.name(); }
  [[nodiscard]] std::span<const SignalInfo> signals() const override { return participant_.signals(); }
  [[nodiscard]] std::span<const std::string> nodes() const override { return participant_.nodes(); }
  [[nodiscard]] std::span<const std::string> lines() const override { return participant_.lines(); }
  [[nodiscard]] PortStatus wake(const Wakeup& in, Outbox& out, std::span<double> signals) override {
    out.clear();
    participant_.wake(in, out);
    participant_.read_signals(signals);
    return PortStatus::kOk;
  }

 private:
  Participant& participant_;
};

}  // namespace meltbench::runtime
