#pragma once
/// A board on the bus that may fail as a whole: lose its power, hang, be slow, or be somebody else.

#include <cstdint>
#include <deque>
#include <optional>
#include <vector>

#include "plant_emulator/board/board.hpp"
#include "plant_emulator/process_faults.hpp"
#include "protocols/fault/fault.hpp"

namespace meltbench::emulator {

/// Stands between the bus and a board. Without a fault it hands everything on.
///
/// A board without power goes on in the dark: nothing of it can be seen, and what it moves has no power either. When
/// the power is back it starts as at power-up. The same ends a hang, and a swap.
class BoardGate {
 public:
  /// @param board, process  outlive this.
  BoardGate(board::Board& board, config::BoardKind kind, ProcessFaults& process)
      : board_{board}, kind_{kind}, process_{process} {}

  [[nodiscard]] const board::Board& board() const { return board_; }

  void begin(std::size_t number, const fault::Fault& fault, Instant now, canopen::Frames& out);
  void end(std::size_t number, Instant now, canopen::Frames& out);

  void start(Instant now, canopen::Frames& out) { board_.start(now, out); }
  void on_frame(Instant now, const can::CanFrame& frame, canopen::Frames& out);
  void on_time(Instant now, canopen::Frames& out);
  [[nodiscard]] Instant next_deadline() const;

  /// What happens in the dark is not reported.
  void forget_dark_events() {
    if (is_dark()) static_cast<void>(board_.take_events());
  }

 private:
  struct Active {
    std::size_t number = 0;
    fault::Fault fault;
  };
  struct Late {
    Instant due;
    can::CanFrame frame;
  };

  [[nodiscard]] const fault::Fault* find(fault::Kind kind) const;
  [[nodiscard]] bool is_dark() const { return find(fault::Kind::kOff) != nullptr; }
  void power_up(Instant now, canopen::Frames& out);
  /// What has been sent since `from` goes through the faults.
  void filter(Instant now, std::size_t from, canopen::Frames& out);
  [[nodiscard]] bool is_swallowed(can::CanFrame& frame) const;
  void wake_up(Instant now, canopen::Frames& out);
  void storm(Instant now, canopen::Frames& out);

  board::Board& board_;
  config::BoardKind kind_;
  ProcessFaults& process_;
  std::vector<Active> faults_;
  std::deque<Late> late_;
  Instant next_storm_ = Instant::never();
  Instant watchdog_at_ = Instant::never();  // Of a board that hangs.
};

}  // namespace meltbench::emulator
