#pragma once
/// The order in which an extruder is brought to production and out of it again.

#include <cstdint>
#include <string_view>

#include "protocols/time/instant.hpp"

namespace meltbench::machine {

/// What an operator can ask for.
enum class SequenceOrder : std::uint8_t { kStart, kHold, kPurge, kShutDown };

/// | phase    | zones | screw       | feed       | front      | goes on                                         |
/// |----------|-------|-------------|------------|------------|-------------------------------------------------|
/// | cold     | off   | stands      | none       | not held   | with start                                      |
/// | heating  | on    | stands      | none       | not held   | when all zones are warm                         |
/// | soaking  | on    | stands      | none       | not held   | after soak_s; back if a zone leaves its band    |
/// | filling  | on    | runs        | open loop  | held       | when filled length and front are measured well  |
/// | running  | on    | runs        | by the law | held       | with hold, purge, shut_down                     |
/// | holding  | on    | hold speed  | in step    | held       | with start (back to filling), purge, shut_down  |
/// | purging  | on    | purge speed | none       | held       | after purge_s: to stand-by, or cold if shut down|
/// | standby  | on    | stands      | none       | not held   | with start, shut_down                           |
///
/// The front is held while the screw turns: a standing screw has no steady state. "Holding" is production at a lower
/// speed, for a screw that stands lets the front wander to the inlet, where granules stick. Half the speed costs 2 K of
/// superheat on the way; a fifth costs 6 K, and going back takes half of the distance between granules and filled zone.
enum class SequencePhase : std::uint8_t {
  kCold,
  kHeating,
  kSoaking,
  kFilling,
  kRunning,
  kHolding,
  kPurging,
  kStandby,
};
[[nodiscard]] std::string_view text(SequencePhase phase);

/// [controller.sequence]; key, range, (default), what:
/// - soak_s           >= 0 (60)            all zones in their band for so long before the screw turns
/// - fill_s           >= 0 (5)             loops ready for so long before the run counts as running
/// - fill_timeout_s   > 0 (120)            not ready for so long: safe state
/// - heat_timeout_s   > 0 (3600)           not warm for so long: safe state
/// - hold_rpm         > 0 (half of run)     screw while it holds
/// - purge_rpm        > 0 (that of run)    screw while it is emptied
/// - purge_s          > 0 (30)             how long it is emptied
struct SequenceSettings {
  Nanos soak = 60s;
  Nanos fill = 5s;
  Nanos fill_timeout = 120s;
  Nanos heat_timeout = 3600s;
  double hold_rev_per_s = 0.75;
  double purge_rev_per_s = 1.5;
  Nanos purge = 30s;
};

/// What the feeder is to do in a phase.
enum class FeedMode : std::uint8_t { kNone, kOpenLoop, kLaw };

/// What a phase wants of the machine.
struct SequenceDemand {
  bool heat = false;
  double screw_rev_per_s = 0.0;
  FeedMode feed = FeedMode::kNone;
};

/// The state machine of the table above. Time and conditions in, demands out; it cannot fail, its waiting can: see
/// is_overdue().
class Sequence {
 public:
  explicit Sequence(const SequenceSettings& settings) : settings_{settings} {}

  /// @returns false if the order means nothing in this phase.
  bool obey(Instant now, SequenceOrder order);

  /// Once per cycle. @returns true if the phase has changed.
  bool update(Instant now, bool zones_warm, bool loops_ready);

  /// @param run_rev_per_s  speed of the screw in production.
  [[nodiscard]] SequenceDemand demand(double run_rev_per_s) const;
  [[nodiscard]] SequencePhase phase() const { return phase_; }
  /// Heating or filling has taken longer than it may.
  [[nodiscard]] bool is_overdue(Instant now) const;
  [[nodiscard]] Instant since() const { return since_; }

 private:
  void enter(Instant now, SequencePhase phase);

  SequenceSettings settings_;
  SequencePhase phase_ = SequencePhase::kCold;
  Instant since_;        // In the phase.
  Instant heat_since_;   // Heating and soaking together: soaking may fall back.
  Instant ready_since_;  // Loops ready without a break, in filling.
  bool ready_ = false;
  bool shutting_down_ = false;
};

}  // namespace meltbench::machine
