#pragma once
/// What the feeder has delivered and will deliver, from its reports and the commands on their way.

#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "controller/law/delay_law.hpp"
#include "protocols/time/instant.hpp"
#include "protocols/time/ring.hpp"

namespace meltbench::machine {

/// What the feeder said at a SYNC.
struct FeedSample {
  Instant at;                  ///< The SYNC.
  double flow_kg_per_s = 0.0;  ///< Delivered then.
  std::optional<Nanos> age;    ///< For how long it has been so; nothing: for longer than can be told.
  std::uint8_t changes = 0;    ///< Counts changes of the flow, modulo 256.
};

/// Turns reports into intervals of constant flow, as a law wants them. What the feeder reports is believed, not what it
/// was told: quantised, cut, late or watchdog flow is in the history as it was.
///
/// Between two reports the flow changed at most once in the normal case, and the age says when, to 10 us. If reports
/// were lost, the changes between are taken from the commands, at the instants when they were due.
/// Real time: no allocation after construction.
class FeedTracker {
 public:
  /// @param latency   from the feeder's control cycle to the changed flow.
  /// @param cycle     its control cycle: takes over commands; its phase is unknown.
  /// @param capacity  commands that can be under way or unconfirmed; the oldest are forgotten first.
  FeedTracker(Nanos latency, Nanos cycle, std::size_t capacity);

  /// A command sent now takes effect then, to within half a cycle.
  [[nodiscard]] Instant calc_effect(Instant sent_at) const { return sent_at + latency_ + cycle_ / 2; }

  /// Sent to the feeder.
  void command(Instant sent_at, double flow_kg_per_s);

  /// @returns what has been delivered since the last report, in order; empty for the first one. Valid until the next
  ///          call.
  [[nodiscard]] std::span<const law::FeedInterval> report(const FeedSample& sample);

  /// Feed between the last report and `effect_at`, by the commands on their way. Valid until the next call.
  [[nodiscard]] std::span<const law::FeedInterval> calc_in_flight(Instant effect_at);

  /// End of what is known; nothing before the first report.
  [[nodiscard]] std::optional<Instant> known_until() const { return known_until_; }
  [[nodiscard]] double flow_kg_per_s() const { return flow_; }  ///< At known_until().

 private:
  struct Command {
    Instant sent_at;
    double flow_kg_per_s = 0.0;
  };
  void append_unreported(Instant from, Instant changed_at);

  static constexpr Nanos kAgeStep = 10us;  // Of the reported age.

  Nanos latency_;
  Nanos cycle_;
  Ring<Command> commands_;
  std::vector<law::FeedInterval> intervals_;
  std::optional<Instant> known_until_;
  double flow_ = 0.0;
  std::uint8_t changes_ = 0;
};

}  // namespace meltbench::machine
