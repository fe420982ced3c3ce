#pragma once
/// From what a log tells to a scenario that makes it happen again: faults, and checks of how the machine reacted.

#include <string>
#include <vector>

#include "bench/decode/line_trouble.hpp"
#include "bench/decode/reactions.hpp"
#include "protocols/config/value.hpp"

namespace meltbench::decode {

/// Tables of a scenario, and what could not be put into it.
struct Extraction {
  std::vector<config::Table> faults;  ///< [[fault]], by the vocabulary of fixtures/scenarios/FAULTS.md.
  std::vector<config::Table> checks;  ///< [[check]]
  std::vector<std::string> expect;    ///< [health] expect
  std::vector<std::string> notes;     ///< Findings that no fault of the vocabulary repeats.
  std::vector<Reaction> reactions;    ///< What the checks ask for.
  bool is_unexplained = false;        ///< A safe state, and no fault that could be its cause.
  /// Two devices share a node id, and no frame of them was destroyed: on a bit-timed bus in step with virtual time they
  /// would destroy each other's.
  bool needs_ideal = false;
  bool needs_bit_timed = false;        ///< Some fault is one of the wire: [bus] fidelity = "bit-timed".
  std::optional<Nanos> restart_after;  ///< [bus] restart_ms, if the log shows it.
};

/// | in the log                                              | fault                                              |
/// |---------------------------------------------------------|----------------------------------------------------|
/// | a board boots up unasked                                | `board.NAME` `reboot`                              |
/// | the same, and it goes on operational without a start    | `board.NAME` `same_node_id`                        |
/// | heartbeats of a board come from two senders             | the same, `running`                                |
/// | the controller boots up, and resets all                 | `program.controller` `restart`                     |
/// | SYNC and its heartbeat stay away before that, or for ever | `program.controller` `killed`                    |
/// | nothing comes of a board, then it boots up, or nothing  | `board.NAME` `off`                                 |
/// | nothing comes of a board, then it goes on               | `frame` `drop` of all that is its                  |
/// | a board's heartbeat alone stays away                    | `board.NAME` `heartbeat_lost`                      |
/// | SYNC, the controller's heartbeat or a PDO stays away    | `frame` `drop` of this identifier                  |
/// | a measurement is not valid                              | its `sensor` `open_circuit`, or `short_circuit`    |
/// | all are silent, error frames, bus-off, then all is back | `bus` `short_circuit`, or `stuck_dominant`         |
/// | error frames while the others come through              | `frame` `corrupt`, or `bus` `noise` if many        |
/// | one foreign identifier, more than 200 times a second    | `bus.NAME` `babble`                                |
/// | an EMCY that none of these explains                     | `board.NAME` `emcy_storm`                          |
///
/// Checked are the safe state of the controller (its set points go to zero, or the feed stands still), and every EMCY
/// and unasked boot-up, each within kReactionTolerance of its time in the log. A log without a safe state must have
/// none. What a board had to say while it started is no fault.
///
/// @param findings  of Story::findings().
/// @param end       of the log.
/// Cost: n log n in the number of findings. No more than 500 faults, checks and notes; the last note counts the rest.
[[nodiscard]] Extraction extract(std::span<const Finding> findings, Instant end, const config::Rig& rig);

/// How checks look at the controller.
struct CheckStyle {
  bool on_wire = false;         ///< Its safe state as the bus shows it: a dead bus may hide it for long.
  bool without_values = false;  ///< It dies: its signals have no values then.
};
/// [[check]] tables: each reaction within kReactionTolerance of its time, and no safe state if none is among them.
[[nodiscard]] std::vector<config::Table> make_checks(std::span<const Reaction> reactions, const config::Rig& rig,
                                                     CheckStyle style);
/// That of the checks of an extraction.
[[nodiscard]] CheckStyle style_of(const Extraction& found);

/// Adds what serial lines suffered. A line whose errors the controller rode through gets `line.NAME` `noise` with the
/// estimated share. Errors behind which it let go are repeated one by one, since chance does not repeat them: each is
/// `noise` of share 1 for as long as it lasted; so is each of a line that was `unplugged`.
void add_line_faults(Extraction& found, std::span<const LineReport> lines, Instant end);

}  // namespace meltbench::decode
