#pragma once
/// The one text form of a frame: what can-utils' cansend, candump -l and canplayer read and write.
///
///   123#DEADBEEF        classic, standard id          12345678#00        classic, extended id (8 digits)
///   123#R  123#R8       remote frame, with length     123#11..88_B       classic, 8 bytes, raw DLC 11
///   123##1AABB          FD; the digit is the flags: 1 = bit rate switch, 2 = error state
///   20000004#00..00     error frame: bit 29 of the id set, error class as in linux/can/error.h, 8 bytes
///
/// A log line is "(seconds.fraction) device frame", 6 or 9 digits of fraction; a " T" or " R" may follow.

#include <optional>
#include <string>
#include <string_view>

#include "protocols/can/frame.hpp"

namespace meltbench::can {

/// Appends the text of one frame. @pre is_valid(frame). Cost: about 20 ns; no allocation once `out` has grown.
void append_candump(std::string& out, const CanFrame& frame);

[[nodiscard]] std::string to_candump(const CanFrame& frame);

/// Reads the text of one frame, all of it. Dots between data bytes are accepted, as cansend accepts them.
/// @returns nothing if the text is not exactly one frame that can exist on a bus.
[[nodiscard]] std::optional<CanFrame> parse_candump(std::string_view text);

/// One line of a log.
struct LogLine {
  Instant at;               ///< As written: since the epoch of the log, whatever that was.
  std::string_view device;  ///< Points into the line that was parsed.
  CanFrame frame;
  char direction = ' ';  ///< 'T' or 'R', as candump -x writes it behind the frame.
};

/// Appends "(0000000000.010000) device 123#00\n": 10 digits of seconds, 6 of microseconds (cut, not rounded).
/// @pre at >= Instant{}, device without white space and shorter than 16 characters.
void append_log_line(std::string& out, Instant at, std::string_view device, const CanFrame& frame);

/// What a log line turned out to be.
enum class LogLineKind { kFrame, kComment, kBad };

struct ParsedLogLine {
  LogLineKind kind = LogLineKind::kBad;
  LogLine line{};              ///< Valid for kFrame.
  std::string_view complaint;  ///< For kBad: what is wrong, in words, static text.
  std::size_t column = 0;      ///< For kBad: where, counted from 1.
};

/// Reads one line, with or without its line end (LF or CRLF). A line that does not start with '(' is a comment.
[[nodiscard]] ParsedLogLine parse_log_line(std::string_view line);

}  // namespace meltbench::can
