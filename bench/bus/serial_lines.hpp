#pragma once

#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "bench/bus/serial_line.hpp"
#include "protocols/config/rig.hpp"
#include "protocols/participant/participant.hpp"

namespace meltbench::bus {

/// An end of a line: the participant that speaks there, and how it calls the line.
struct LineEnd {
  std::size_t participant = 0;
  std::uint8_t own_line = 0;  ///< Number in its lines().
};

/// A piece that has come over a line.
struct HeardPiece {
  Instant at;  ///< When its last byte was there.
  std::string_view line;
  std::size_t sender = 0;  ///< Number of the participant.
  std::span<const std::uint8_t> bytes;
  std::span<const LineEnd> listeners;  ///< Who hears it.
};

/// The serial lines of a run: participants that name the same line share it.
class SerialLines {
 public:
  explicit SerialLines(std::span<const config::RigLine> lines);

  /// Connects the next participant, in the order of their numbers. @param names  what its lines() says.
  /// @throws std::invalid_argument naming a line that is not there; the participant is then not connected.
  void add_participant(std::span<const std::string> names);

  /// Bytes for a line that the participant has not go nowhere. @pre now is not before that of an earlier call.
  void write(Instant now, std::size_t participant, std::uint8_t own_line, std::span<const std::uint8_t> bytes);
  /// When the next piece is there; Instant::never() if nothing is under way.
  [[nodiscard]] Instant next_delivery() const { return next_delivery_; }
  /// Takes the next piece. @pre next_delivery() is not never. Good until the next call of take() or write().
  [[nodiscard]] HeardPiece take();

  /// Pulls a participant's plug out of its line, or puts it in again.
  void plug(Instant now, std::size_t participant, std::uint8_t own_line, bool in);
  /// States of a participant's lines, in its own order: down while unplugged.
  [[nodiscard]] std::span<const LinkState> states(std::size_t participant) const { return states_[participant]; }
  /// The line itself, for faults; null if there is none of that name.
  [[nodiscard]] SerialLine* find(std::string_view name);

 private:
  struct Line {
    std::string name;
    std::vector<LineEnd> ends;
    SerialLine wire;
  };
  struct Place {
    std::size_t line = 0;  ///< In lines_.
    std::size_t end = 0;   ///< Of that line.
  };
  void find_next();

  std::vector<Line> lines_;
  std::vector<std::vector<Place>> places_;  ///< Of each participant's lines.
  std::vector<std::vector<LinkState>> states_;
  std::vector<LineEnd> listeners_;
  std::size_t next_ = 0;
  Instant next_delivery_ = Instant::never();
};

}  // namespace meltbench::bus
