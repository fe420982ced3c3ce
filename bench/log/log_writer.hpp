#pragma once
/// One writer for all logs of a CAN bus.

#include <filesystem>
#include <memory>
#include <span>
#include <string>
#include <string_view>

#include "bench/log/log_entry.hpp"
#include "bench/log/log_reader.hpp"

namespace meltbench::log {

/// Where the bytes of a log go.
class ByteSink {
 public:
  virtual ~ByteSink() = default;
  /// @throws LogError naming the file if it cannot be written.
  virtual void write(std::string_view bytes) = 0;
  /// Writes over the file's first bytes. @pre can_rewrite().
  virtual void rewrite_head(std::string_view bytes) = 0;
  [[nodiscard]] virtual bool can_rewrite() const = 0;
  /// All is on its way to the disk. @throws LogError
  virtual void close() = 0;
};

/// A file, packed with gzip if its name ends in ".gz"; standard output for "-".
/// @throws LogError
[[nodiscard]] std::unique_ptr<ByteSink> create_file(const std::filesystem::path& path);

class LogWriter {
 public:
  virtual ~LogWriter() = default;
  /// @param channel  name of the entry's channel. @throws LogError if the format cannot hold the frame.
  virtual void write(const LogEntry& entry, std::string_view channel) = 0;
  /// Writes what comes last. Without it the log is cut off.
  virtual void finish() = 0;
};

/// Format by the name: ".asc", ".blf", or candump text for ".log", ".txt" and no ending; a ".gz" behind it is passed
/// over.
/// @throws LogError for any other ending, and for ".blf.gz".
[[nodiscard]] LogFormat format_by_name(const std::filesystem::path& path);

/// @throws LogError: BLF to what cannot be rewritten, since its head is written last.
[[nodiscard]] std::unique_ptr<LogWriter> create_log(std::unique_ptr<ByteSink> sink, LogFormat format);

}  // namespace meltbench::log
