#pragma once
/// A field board on a serial line: one or several Modbus units in front, the process behind.

#include <cstdint>
#include <vector>

#include "plant_emulator/board/device.hpp"
#include "protocols/modbus/rtu_server.hpp"

namespace meltbench::board {

/// The emulator serves it the way it serves a board on CAN: touches first, then requests, which its units execute at
/// the instant of their end. Powered from the start of the run on.
class RtuBoard : public Device {
 public:
  using Device::Device;

  /// Puts its units on a line. Called once, before start().
  virtual void attach(modbus::RtuServer& server) = 0;
  /// Their addresses there.
  [[nodiscard]] virtual std::vector<std::uint8_t> units() const = 0;
  /// Power on, also in the middle of a run: everything that was written to it is forgotten. @pre the process is at
  /// `now`.
  virtual void start(Instant now) = 0;
  /// Timers: watchdogs.
  virtual void on_time(Instant now) = 0;
  [[nodiscard]] virtual Instant next_deadline() const = 0;
};

}  // namespace meltbench::board
