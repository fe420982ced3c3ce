// What a stranger's CAN adapter says, in pieces: no bytes may crash the reader or make it grow, and a frame that it
// reads can exist on a bus and prints back to the same frame.

#include <algorithm>
#include <string>

#include "protocols/can/slcan.hpp"
#include "tests/fuzz/fuzz.hpp"

using namespace meltbench;
using fuzz::must;

namespace {

void read_line(std::string_view line) {
  must(line.size() <= can::SlcanLines::kMaxLine, "no line is longer than the longest of slcan");
  const auto read = can::parse_slcan(line);
  if (!read) return;
  must(can::is_valid(read->frame), "a frame read can exist on a bus");
  std::string text;
  must(can::append_slcan(text, read->frame), "a frame read can be written");
  must(text.back() == can::kSlcanEnd, "a frame ends its line");
  text.pop_back();
  const auto again = can::parse_slcan(text);
  must(again && again->frame == read->frame, "a frame written reads back equal");
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  can::SlcanLines lines;
  std::span<const std::uint8_t> rest{data, size};
  while (!rest.empty()) {
    const std::size_t piece = std::min<std::size_t>(1 + rest.front() % 64, rest.size());
    lines.feed(rest.first(piece));
    rest = rest.subspan(piece);
    while (const auto line = lines.next()) read_line(*line);
  }
  return 0;
}
