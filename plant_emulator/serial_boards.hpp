#pragma once
/// The emulator's serial side: lines, and the Modbus RTU boards on them.

#include <cstdint>
#include <deque>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "plant_emulator/board/rtu_board.hpp"
#include "protocols/modbus/rtu_server.hpp"
#include "protocols/participant/participant.hpp"
#include "protocols/serial/line_settings.hpp"

namespace meltbench::emulator {

/// Requests in, answers out, at the pace of each line. Boards are touched by the emulator, as those on CAN.
/// Real time: no allocation in the steady state.
class SerialBoards {
 public:
  /// Lines first, in the order of Participant::lines().
  void add_line(std::string name, const serial::LineSettings& settings);
  /// @pre there is a line of that name.  @returns the board, which lives as long as this.
  board::RtuBoard& add(std::unique_ptr<board::RtuBoard> board, const std::string& line);

  [[nodiscard]] std::span<const std::string> line_names() const { return names_; }

  // @pre of all: the process and all touches are at `now`.
  void start(Instant now);
  void on_bytes(Instant now, const SerialArrival& arrival);
  void on_time(Instant now);
  [[nodiscard]] Instant next_deadline() const;
  /// A line that is down forgets the request under way.
  void on_lines(std::span<const LinkState> lines);
  /// Puts the answers that have left into the outbox.
  void write_answers(Outbox& out);

 private:
  struct Line {
    modbus::RtuServer server;
    std::vector<std::uint8_t> answers;
  };
  std::vector<std::string> names_;
  std::deque<Line> lines_;  // In the order of names_; a server's boards point to it.
  std::vector<std::unique_ptr<board::RtuBoard>> boards_;
};

}  // namespace meltbench::emulator
