#pragma once
/// A board on a serial line that may fail as a whole: lose its power, hang, be slow.

#include <cstdint>
#include <vector>

#include "plant_emulator/board/rtu_board.hpp"
#include "plant_emulator/process_faults.hpp"
#include "protocols/fault/fault.hpp"
#include "protocols/modbus/rtu_server.hpp"

namespace meltbench::emulator {

/// Stands beside a board and takes its units off the line, and its power, as BoardGate does on CAN. A board that hangs
/// answers nothing: there is no second processor that would speak for it. What it moves stays as it is.
class RtuGate {
 public:
  /// @param board, process, server  outlive this. @pre the board is attached to the server.
  RtuGate(board::RtuBoard& board, config::BoardKind kind, ProcessFaults& process, modbus::RtuServer& server)
      : board_{board}, kind_{kind}, process_{process}, server_{server} {}

  [[nodiscard]] const board::RtuBoard& board() const { return board_; }

  void begin(std::size_t number, const fault::Fault& fault, Instant now);
  void end(std::size_t number, Instant now);

  /// Timers of the board, and the watchdog of one that hangs.
  void on_time(Instant now);
  [[nodiscard]] Instant next_deadline() const;

  /// What happens while nobody is at home is not reported.
  void forget_dark_events() {
    if (is_away()) static_cast<void>(board_.take_events());
  }

 private:
  struct Active {
    std::size_t number = 0;
    fault::Fault fault;
  };

  [[nodiscard]] const fault::Fault* find(fault::Kind kind) const;
  [[nodiscard]] bool is_away() const {
    return find(fault::Kind::kOff) != nullptr || find(fault::Kind::kHang) != nullptr;
  }
  void wake_up(Instant now);
  void tell_line();

  board::RtuBoard& board_;
  config::BoardKind kind_;
  ProcessFaults& process_;
  modbus::RtuServer& server_;
  std::vector<Active> faults_;
  Instant watchdog_at_ = Instant::never();  // Of a board that hangs.
};

}  // namespace meltbench::emulator
