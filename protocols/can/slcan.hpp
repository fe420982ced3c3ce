#pragma once
/// The text that CAN adapters on a serial line speak ("slcan", after the CAN232 of Lawicel AB; spoken also by Linux'
/// slcan driver, slcand, python-can, SavvyCAN and the CANable firmware). Every line ends with a carriage return:
///
///   tiiiL..        data, 11-bit id          Tiiiiiiii L..   data, 29-bit id      L: one digit, 0..8
///   riiiL          remote, 11-bit id        RiiiiiiiiL      remote, 29-bit id
///   diiiL..  D..   FD data, one bit rate    biiiL..  B..    FD data, data phase faster; L: hexadecimal DLC 0..F
///
/// Host to adapter besides: S0..S8 bit rate, O open, L listen only, C close, F flags, V v N who are you, Z0 Z1 stamps.
/// The adapter answers each with a carriage return (with text before it, if there is any to tell), or with BEL, which
/// ends a line of its own: refused. With automatic polling on, a frame is answered by "z" (11 bits) or "Z" (29 bits).
/// A received frame may carry a stamp behind its data: four digits of milliseconds, 0..59999.

#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>

#include "protocols/can/frame.hpp"

namespace meltbench::can {

/// What ends a line, and the one-character line that says no.
inline constexpr char kSlcanEnd = '\r';
inline constexpr char kSlcanRefused = '\a';

/// Appends a frame with its line end. A raw DLC above 8 is not kept: the text has no place for it.
/// @returns false, and appends nothing, for an error frame, which slcan cannot say. @pre is_valid(frame).
bool append_slcan(std::string& out, const CanFrame& frame);

/// A frame, and the stamp behind it if there was one.
struct SlcanFrame {
  CanFrame frame;
  std::optional<std::uint32_t> stamp;  ///< Four digits: milliseconds; eight (some firmware): microseconds.
  bool operator==(const SlcanFrame&) const = default;
};

/// Reads a line, without its line end. Lower-case digits are accepted.
/// @returns nothing if it is not a frame that can exist: another command or answer, or a torn line.
[[nodiscard]] std::optional<SlcanFrame> parse_slcan(std::string_view line);

/// The digit behind 'S' for a bit rate [bit/s]: '0' for 10000 ... '6' for 500000, '8' for 1000000; nothing if there is
/// none.
[[nodiscard]] std::optional<char> slcan_bit_rate_digit(std::uint32_t bit_rate_bit_per_s);

/// Cuts a stream of bytes into lines, whatever pieces it comes in.
///
/// Line feeds are dropped: some programs send them behind the carriage return. A line that is longer than any of slcan
/// is garbage (a wrong baud rate, another device) and is dropped up to its end, and counted.
/// Keeps its memory: no allocation once it has seen the largest piece.
class SlcanLines {
 public:
  /// The longest line: B, 8 digits of id, DLC, 64 bytes, a stamp of 8 digits.
  static constexpr std::size_t kMaxLine = 1 + 8 + 1 + 2 * kMaxFdLength + 8;

  void feed(std::span<const std::uint8_t> bytes);
  /// The next whole line without its end; kSlcanRefused as a line of one character for a BEL. Empty: a carriage return
  /// alone. Valid until the next feed(). Call it until it returns nothing.
  [[nodiscard]] std::optional<std::string_view> next();
  /// Lines that were too long.
  [[nodiscard]] std::uint64_t dropped() const { return dropped_; }
  /// Forgets what has begun: the device has gone.
  void clear();

 private:
  [[nodiscard]] std::optional<std::string_view> take_until(std::size_t end);

  std::string text_;
  std::size_t read_ = 0;   ///< Of text_: begin of the line that comes next.
  bool skipping_ = false;  ///< The line that comes next began too long ago.
  std::uint64_t dropped_ = 0;
};

}  // namespace meltbench::can
