#include "bench/log/candump_reader.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>

#include "bench/log/log_error.hpp"
#include "bench/log/words.hpp"
#include "protocols/can/candump.hpp"

namespace meltbench::log {

bool CandumpReader::read(LogEntry& entry) {
  std::string_view text;
  while (lines_.next(text)) {
    const can::ParsedLogLine parsed = can::parse_log_line(text);
    switch (parsed.kind) {
      case can::LogLineKind::kFrame:
        entry.at = parsed.line.at;
        entry.channel = channel_number(parsed.line.device);
        entry.direction = parsed.line.direction == 'T'   ? Direction::kSent
                          : parsed.line.direction == 'R' ? Direction::kReceived
                                                         : Direction::kUnknown;
        entry.frame = parsed.line.frame;
        if (lines_.is_torn()) warn(std::string{kNoEnd});
        return true;
      case can::LogLineKind::kComment:
        read_comment(text);
        break;
      case can::LogLineKind::kBad:
        if (lines_.is_torn()) {
          warn(std::string{kCutOff});
          break;
        }
        throw LogError{fmt::format("{}:{}: {}", lines_.place(), parsed.column, parsed.complaint),
                       "a line is \"(seconds.fraction) interface 123#DEADBEEF\", as candump -l writes it"};
    }
  }
  require_frames();
  return false;
}

void CandumpReader::read_comment(std::string_view text) {
  if (std::ranges::any_of(text, [](char c) { return static_cast<unsigned char>(c) < ' ' && c != '\t'; })) {
    throw LogError{fmt::format("{}: control characters: this is no text log", lines_.place()),
                   "logs are candump text, Vector ASC or BLF; each may be packed with gzip"};
  }
  if (first_comment_.empty()) first_comment_ = text;
  constexpr std::string_view kDropped = "DROPCOUNT: dropped ";
  if (!text.starts_with(kDropped)) return;
  std::uint64_t count = 0;
  const std::string_view number = text.substr(kDropped.size());
  if (std::from_chars(number.data(), number.data() + number.size(), count).ec != std::errc{}) return;
  note_dropped(count);
  warn(fmt::format("the kernel had dropped {} frames here", count));
}

/// A text of which nothing is a frame is something else.
void CandumpReader::require_frames() const {
  if (frames() > 0 || first_comment_.empty() || first_comment_.starts_with('#')) return;
  const bool is_screen = first_comment_.find('[') != std::string::npos && first_comment_.find(']') != std::string::npos;
  throw LogError{fmt::format("{}: no frame in {} lines; the first is \"{}\"", source_->name(), lines_.number(),
                             first_comment_.substr(0, 60)),
                 is_screen ? "this is what candump shows on the screen: record with candump -l, or candump -L"
                           : "logs are candump text, Vector ASC or BLF; each may be packed with gzip"};
}

}  // namespace meltbench::log
