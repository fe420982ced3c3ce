#pragma once
/// One reader for all logs of a CAN bus.

#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "bench/log/byte_source.hpp"
#include "bench/log/log_entry.hpp"

namespace meltbench::log {

enum class LogFormat : std::uint8_t { kCandump, kAsc, kBlf };

/// Something odd that does not keep the log from being read.
struct LogWarning {
  std::uint64_t line = 0;  ///< From 1; of a binary log the number of the object; 0 before the first.
  std::string text;
};

/// Frames of a log in the order of the file. Memory does not grow with the log's length.
///
/// Tolerant where tools differ: 6 or 9 digits of time, CRLF, direction suffixes, comments, unknown events of ASC.
/// Strict about nonsense: what looks like a frame and is none ends the reading with its line. A last line that was cut
/// off, and time that goes back, are warnings.
class LogReader {
 public:
  virtual ~LogReader() = default;
  LogReader(const LogReader&) = delete;
  LogReader& operator=(const LogReader&) = delete;

  /// @returns false at the end. @throws LogError naming the line.
  /// Cost: about 0.15 us for a line of candump text; no allocation but for warnings and new channels.
  [[nodiscard]] bool next(LogEntry& entry);

  [[nodiscard]] LogFormat format() const { return format_; }
  /// Names of the channels met so far: interfaces of candump, numbers of ASC and BLF as "1", "2".
  [[nodiscard]] const std::vector<std::string>& channels() const { return channels_; }
  [[nodiscard]] std::uint64_t frames() const { return frames_; }
  /// Frames that the kernel dropped before they could be logged, as the log itself says.
  [[nodiscard]] std::uint64_t dropped() const { return dropped_; }
  /// The first 20; warning_count() says how many there were.
  [[nodiscard]] const std::vector<LogWarning>& warnings() const { return warnings_; }
  [[nodiscard]] std::uint64_t warning_count() const { return warning_count_; }
  /// Line (or object) that next() has read.
  [[nodiscard]] virtual std::uint64_t line() const = 0;

 protected:
  LogReader(LogFormat format, std::unique_ptr<ByteSource> source) : source_{std::move(source)}, format_{format} {}

  [[nodiscard]] virtual bool read(LogEntry& entry) = 0;
  [[nodiscard]] std::size_t channel_number(std::string_view name);
  void warn(std::string text);
  void note_dropped(std::uint64_t count) { dropped_ += count; }

  std::unique_ptr<ByteSource> source_;

 private:
  static constexpr std::size_t kKeptWarnings = 20;
  LogFormat format_;
  std::vector<std::string> channels_;
  std::size_t last_channel_ = 0;
  std::uint64_t frames_ = 0;
  std::uint64_t dropped_ = 0;
  Instant latest_{Nanos::min()};
  bool ended_ = false;
  std::vector<LogWarning> warnings_;
  std::uint64_t warning_count_ = 0;
};

/// Finds out by its first bytes what a log is, and opens it.
/// @throws LogError
[[nodiscard]] std::unique_ptr<LogReader> open_log(std::unique_ptr<ByteSource> source);
/// @param path  a file, or "-" for standard input; may be packed with gzip.
[[nodiscard]] std::unique_ptr<LogReader> open_log(const std::filesystem::path& path);

}  // namespace meltbench::log
