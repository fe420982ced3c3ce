// Logs of strangers, line by line: no line may crash the reader, a frame prints back to the same line, and a complaint
// has words and a place inside the line.

#include <string>

#include "protocols/can/candump.hpp"
#include "tests/fuzz/fuzz.hpp"

using namespace meltbench;
using fuzz::must;

namespace {

Instant cut_to_us(Instant at) {
  return Instant{at.since_start - at.since_start % 1us};
}

void read_line(std::string_view text) {
  const can::ParsedLogLine parsed = can::parse_log_line(text);
  if (parsed.kind == can::LogLineKind::kComment) {
    must(text.empty() || text.front() != '(', "what starts as a log line is not taken for a comment");
    return;
  }
  if (parsed.kind == can::LogLineKind::kBad) {
    must(!parsed.complaint.empty(), "a bad line is explained");
    must(parsed.column >= 1 && parsed.column <= text.size() + 1, "a complaint points into the line");
    return;
  }
  must(can::is_valid(parsed.line.frame), "a frame in a log can exist on a bus");
  std::string again;
  can::append_log_line(again, parsed.line.at, parsed.line.device, parsed.line.frame);
  const can::ParsedLogLine second = can::parse_log_line(again);
  must(second.kind == can::LogLineKind::kFrame, "a printed line is a line");
  must(second.line.frame == parsed.line.frame, "its frame is the same");
  must(second.line.device == parsed.line.device, "its device is the same");
  must(second.line.at == cut_to_us(parsed.line.at), "its time is the same to the microsecond");
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  std::string_view rest = fuzz::as_text(data, size);
  while (!rest.empty()) {
    const std::size_t end = std::min(rest.find('\n'), rest.size());
    read_line(rest.substr(0, end));
    rest.remove_prefix(std::min(end + 1, rest.size()));
  }
  return 0;
}
