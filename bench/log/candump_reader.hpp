#pragma once

#include "bench/log/log_reader.hpp"
#include "bench/log/text_lines.hpp"

namespace meltbench::log {

/// What candump -l and -L write, of all versions. A line that does not start with '(' is a comment; "DROPCOUNT: ..."
/// among them tells of frames that the kernel dropped.
class CandumpReader final : public LogReader {
 public:
  explicit CandumpReader(std::unique_ptr<ByteSource> source)
      : LogReader{LogFormat::kCandump, std::move(source)}, lines_{*source_} {}

  [[nodiscard]] std::uint64_t line() const override { return lines_.number(); }

 private:
  [[nodiscard]] bool read(LogEntry& entry) override;
  void read_comment(std::string_view text);
  void require_frames() const;

  TextLines lines_;
  std::string first_comment_;
};

}  // namespace meltbench::log
