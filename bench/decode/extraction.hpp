#pragma once
/// From what a log tells to a scenario that makes it happen again: faults, and checks of how the machine reacted.

#include <string>
#include <vector>

#include "bench/decode/story.hpp"
#include "protocols/config/value.hpp"

namespace meltbench::decode {

/// How exactly a run has to repeat what the log shows.
inline constexpr Nanos kReactionTolerance = 20ms;

/// Tables of a scenario, and what could not be put into it.
struct Extraction {
  std::vector<config::Table> faults;  ///< [[fault]], by the vocabulary of fixtures/scenarios/FAULTS.md.
  std::vector<config::Table> checks;  ///< [[check]]
  std::vector<std::string> expect;    ///< [health] expect
  std::vector<std::string> notes;     ///< Findings that no fault of the vocabulary repeats.
};

/// | in the log                                              | fault                                              |
/// |---------------------------------------------------------|----------------------------------------------------|
/// | a board boots up unasked                                | `board.NAME` `reboot`                              |
/// | nothing comes of a board, then it boots up, or nothing  | `board.NAME` `off`                                 |
/// | nothing comes of a board, then it goes on               | `frame` `drop` of all that is its                  |
/// | a board's heartbeat alone stays away                    | `board.NAME` `heartbeat_lost`                      |
/// | SYNC, the controller's heartbeat or a PDO stays away    | `frame` `drop` of this identifier                  |
/// | a measurement is not valid                              | its `sensor` `open_circuit`, or `short_circuit`    |
/// | an EMCY that none of these explains                     | `board.NAME` `emcy_storm`                          |
///
/// Checked are the safe state of the controller (its set points go to zero, or the feed stands still), and every EMCY
/// and unasked boot-up, each within kReactionTolerance of its time in the log. A log without a safe state must have
/// none. What a board had to say while it started is no fault.
///
/// @param findings  of Story::findings().
/// @param end       of the log.
[[nodiscard]] Extraction extract(std::span<const Finding> findings, Instant end, const config::Rig& rig);

}  // namespace meltbench::decode
