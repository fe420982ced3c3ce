#pragma once
/// A program of a run that may fail as a whole: its clock goes wrong, or it is not there any more.

#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "bench/fault/clock_skew.hpp"
#include "protocols/runtime/participant_port.hpp"

namespace meltbench::fault {

struct ProgramCondition {
  ClockSkew clock;
  unsigned kills = 0;  ///< Faults that have killed it and still hold.
};

/// Wakes a participant as its condition allows: by its own clock, and not at all while it is killed. What comes then
/// is lost, nothing goes out, and its signals have no value; error counters stay.
class FaultyPort final : public runtime::ParticipantPort {
 public:
  /// @param port, condition  outlive this object.
  FaultyPort(runtime::ParticipantPort& port, const ProgramCondition& condition) : port_{port}, condition_{condition} {}

  [[nodiscard]] std::string_view name() const override { return port_.name(); }
  [[nodiscard]] std::span<const SignalInfo> signals() const override { return port_.signals(); }
  [[nodiscard]] std::span<const std::string> nodes() const override { return port_.nodes(); }
  [[nodiscard]] std::span<const std::string> lines() const override { return port_.lines(); }
  [[nodiscard]] runtime::PortStatus wake(const Wakeup& in, Outbox& out, std::span<double> signals) override;

 private:
  [[nodiscard]] runtime::PortStatus wake_by_its_clock(const Wakeup& in, Outbox& out, std::span<double> signals);
  void be_dead(Outbox& out, std::span<double> signals) const;

  runtime::ParticipantPort& port_;
  const ProgramCondition& condition_;
  std::vector<can::StampedFrame> frames_;
  std::vector<SerialArrival> serial_;
};

}  // namespace meltbench::fault
