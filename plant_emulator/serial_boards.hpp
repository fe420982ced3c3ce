#pragma once
/// The emulator's serial side: lines, and the Modbus RTU boards on them.

#include <cstdint>
#include <deque>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "plant_emulator/board/rtu_board.hpp"
#include "plant_emulator/rtu_gate.hpp"
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
  /// @pre there is a line of that name.  @param process  outlives this.
  /// @returns the board, which lives as long as this.
  board::RtuBoard& add(std::unique_ptr<board::RtuBoard> board, config::BoardKind kind, const std::string& line,
                       ProcessFaults& process);

  [[nodiscard]] std::span<const std::string> line_names() const { return names_; }

  // @pre of all: the process and all touches are at `now`.
  void start(Instant now);
  void on_bytes(Instant now, const SerialArrival& arrival);
  void on_time(Instant now);
  [[nodiscard]] Instant next_deadline() const;
  /// A fault of a whole board; ignored if it is none of these.
  void begin(std::size_t number, const fault::Fault& fault, Instant now);
  void end(std::size_t number, Instant now);
  void forget_dark_events();
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
  std::vector<RtuGate> gates_;  // What stands beside each.
};

}  // namespace meltbench::emulator
