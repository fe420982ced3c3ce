#pragma once

#include <optional>

#include "bench/log/log_reader.hpp"
#include "bench/log/text_lines.hpp"

namespace meltbench::log {

/// The text log of Vector's tools. Frames are classic or FD, data, remote or error; other events are passed over.
/// Instants are the file's date, read as UTC, plus the time stamp; without a date that can be read the stamp alone. The
/// class of an error frame is not in this format: it comes out as a bus error.
class AscReader final : public LogReader {
 public:
  explicit AscReader(std::unique_ptr<ByteSource> source)
      : LogReader{LogFormat::kAsc, std::move(source)}, lines_{*source_} {}

  [[nodiscard]] std::uint64_t line() const override { return lines_.number(); }

 private:
  [[nodiscard]] bool read(LogEntry& entry) override;
  bool read_header(std::string_view line);
  [[nodiscard]] bool read_event(std::string_view line, LogEntry& entry);
  [[nodiscard]] bool read_classic(std::string_view channel, std::string_view rest, LogEntry& entry);
  void read_fd(std::string_view rest, LogEntry& entry);
  void read_id(std::string_view word, can::CanFrame& frame) const;
  void read_data(std::string_view rest, std::size_t count, can::CanFrame& frame) const;
  void set_channel(std::string_view word, LogEntry& entry);
  [[noreturn]] void refuse(std::string_view why) const;

  TextLines lines_;
  int base_ = 16;
  bool relative_ = false;  ///< Each stamp counts from the one before.
  Instant start_{};
  Instant previous_{};  ///< Since start_.
};

/// "Fri Jul 10 06:17:32.249 am 2015" or "Fri Jul 10 18:17:32 2015" as a time since the epoch, taken as UTC.
/// @returns nothing if it is no such date.
[[nodiscard]] std::optional<Instant> parse_asc_date(std::string_view text);

}  // namespace meltbench::log
