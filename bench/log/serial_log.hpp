#pragma once
/// Reads what went over serial lines: the serial.log of a run or a recording.

#include <cstdint>
#include <string>
#include <vector>

#include "bench/log/text_lines.hpp"
#include "protocols/time/instant.hpp"

namespace meltbench::log {

/// Bytes that came over a line without a gap.
struct SerialEntry {
  Instant at;  ///< When the last byte was there.
  std::string line;
  std::string sender;
  std::vector<std::uint8_t> bytes;
};

/// Text, "(0000000012.340000) zones controller 0B0300000006C562" a line; lines that do not begin with '(' are comments.
/// A last line that was cut off is left out. Memory does not grow with the log's length.
class SerialLogReader {
 public:
  /// @param source  outlives this object.
  explicit SerialLogReader(ByteSource& source) : lines_{source} {}

  /// @returns false at the end. @throws LogError naming the line that is none.
  [[nodiscard]] bool next(SerialEntry& entry);

 private:
  [[noreturn]] void fail(const std::string& why) const;
  TextLines lines_;
};

}  // namespace meltbench::log
