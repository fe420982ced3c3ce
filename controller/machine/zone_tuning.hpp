#pragma once
/// Autotune of the heated zones: asked of the heater board, followed, and its outcome read back.

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>

#include "controller/machine/node_boot.hpp"
#include "controller/machine/zone_settings.hpp"
#include "protocols/participant/participant.hpp"

namespace meltbench::machine {

/// The board does the experiment and changes its own controller; the zone goes on being watched meanwhile. Told as
/// events: "autotune" when it is asked for, "autotune-over" with what the board has then, as info if it succeeded, else
/// as a warning. An order that the board refuses is a "configuration-failed" of the bus manager.
/// Allocates with an order and at its end only.
class ZoneTuning {
 public:
  /// Zone `channel` shall be tried out. @pre 1 <= channel <= kMaxZones.
  void ask(std::size_t channel) { phase(channel) = Phase::kAsked; }
  /// State of a zone as the board reports it, object 2102.
  void note(std::size_t channel, std::uint8_t zone_state);
  /// Once per cycle: writes and reads at the board while it has no other transfer.
  void update(Instant now, NodeBoot& heater, Outbox& out);

 private:
  enum class Phase : std::uint8_t { kIdle, kAsked, kStarting, kRunning, kEnded };
  [[nodiscard]] Phase& phase(std::size_t channel) { return phases_.at(channel - 1); }
  void start(Instant now, std::size_t channel, NodeBoot& heater, Outbox& out);
  void read_outcome(Instant now, std::size_t channel, NodeBoot& heater, Outbox& out);
  void tell_outcome(Instant now, std::size_t channel, const NodeBoot& heater, Outbox& out) const;

  std::array<Phase, kMaxZones> phases_{};
  std::optional<std::size_t> reading_;  // Its outcome is under way.
};

}  // namespace meltbench::machine
