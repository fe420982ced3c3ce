#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "bench/log/byte_source.hpp"

namespace meltbench::log {

/// What is warned of in a last line without an end: it holds a frame, or none.
inline constexpr std::string_view kNoEnd = "the last line has no end: if it was cut off, so was its frame";
inline constexpr std::string_view kCutOff = "the last line is cut off; it is left out";

/// The lines of a text, one after the other, in flat memory: 256 KiB however long the text is.
class TextLines {
 public:
  /// No format has longer lines; a longer one is no text log.
  static constexpr std::size_t kMaxLine = 16 * 1024;

  /// @param source  outlives this object.
  explicit TextLines(ByteSource& source) : source_{source}, buffer_(kBlock + kMaxLine) {}

  /// The next line without its end (LF or CRLF); valid until the next call.
  /// @returns false at the end of the text.
  /// @throws LogError for a line that is too long or holds a NUL, with its number.
  [[nodiscard]] bool next(std::string_view& line);
  /// Number of the line that next() gave, counted from 1.
  [[nodiscard]] std::uint64_t number() const { return number_; }
  /// Whether the line that next() gave is the last one and has no end: the writer was cut off in it.
  [[nodiscard]] bool is_torn() const { return torn_; }
  /// "<file>:<line>", for complaints.
  [[nodiscard]] std::string place() const;

 private:
  bool fill();

  static constexpr std::size_t kBlock = 256 * 1024;
  ByteSource& source_;
  std::vector<char> buffer_;
  std::size_t first_ = 0;  ///< Of what has not been given yet,
  std::size_t end_ = 0;    ///< and the end of it.
  std::uint64_t number_ = 0;
  bool torn_ = false;
};

}  // namespace meltbench::log
