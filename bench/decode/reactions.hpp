#pragma once
/// How a machine reacted to what failed, as far as its bus shows it; and whether another run did the same.

#include <span>
#include <string>
#include <vector>

#include "bench/decode/story.hpp"

namespace meltbench::decode {

/// How exactly a run has to repeat what a log shows.
inline constexpr Nanos kReactionTolerance = 20ms;

/// An EMCY, a boot-up that nobody asked for, or the controller's safe state.
struct Reaction {
  enum class Kind : std::uint8_t { kBoot, kEmcy, kSafeState };
  Kind kind{};
  Instant at;
  std::uint8_t node = 0;             ///< 0: the controller's safe state.
  std::uint32_t id = 0;              ///< Of the frame.
  std::uint16_t code = 0;            ///< Of an EMCY; 8130 is that of a lost heartbeat.
  std::uint8_t released = 0;         ///< Of a safe state: the board whose release went to zero; 0: seen by the feed.
  canopen::ObjectAddress release{};  ///< That object.

  /// "heater boots up", "feeder sends EMCY 8130", "the controller goes to its safe state".
  [[nodiscard]] std::string text(const config::Rig& rig) const;
};

/// In the order of time. An EMCY that is repeated counts once, one that says that all is well does not.
/// @param findings  of Story::findings().  @param end  of the log.
[[nodiscard]] std::vector<Reaction> list_reactions(std::span<const Finding> findings, Instant end,
                                                   const config::Rig& rig);

/// That the controller gave up: the first release that goes to zero, or, where the rig's bus has none, the first feed
/// that moved with every frame and then stands still. An ordered shut-down or stand-by is none: there the screw's set
/// point goes down to zero in steps, while the safe state lets it turn or stops it at once.
[[nodiscard]] std::optional<Reaction> find_safe_state(std::span<const Finding> findings, Instant end,
                                                      const config::Rig& rig);

/// The first reaction that a run does not repeat, in the order of the recorded ones and each within the tolerance, in
/// words; empty if it repeats all, and has no others. Reactions within the tolerance of each other may change places.
[[nodiscard]] std::string describe_difference(std::span<const Reaction> recorded, std::span<const Reaction> again,
                                              const config::Rig& rig, Nanos tolerance = kReactionTolerance);

/// Those of the recorded ones that a run repeats, each within the tolerance.
[[nodiscard]] std::vector<Reaction> find_repeated(std::span<const Reaction> recorded, std::span<const Reaction> again,
                                                  Nanos tolerance = kReactionTolerance);

/// The board of the rig with this node id; null for 0 and for others.
[[nodiscard]] const config::RigBoard* find_board(const config::Rig& rig, std::uint8_t node);

}  // namespace meltbench::decode
