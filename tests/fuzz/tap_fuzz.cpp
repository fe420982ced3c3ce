// What clients of a tap say, in both languages: no bytes may crash a server, it never takes more than it was given or
// has room for, what it puts on the bus can be there, and is told to others as the same frame.
// First byte: language and read-only; the rest comes in pieces, each of a length that its first byte says.

#include <memory>
#include <string>

#include "bench/tap/slcan_adapter.hpp"
#include "bench/tap/socketcand.hpp"
#include "protocols/can/slcan.hpp"
#include "tests/fuzz/fuzz.hpp"

using namespace meltbench;
using fuzz::must;

namespace {

constexpr std::size_t kRoom = 3;
constexpr std::size_t kMaxKept = 512;  // Of an unended message.

void must_be_told(tap::Dialect& dialect, bool is_slcan, const can::CanFrame& frame) {
  std::string text;
  dialect.tell({Instant{1s}, frame}, text);
  if (is_slcan) {
    if (text.empty()) return;  // It waits to be asked for.
    const auto read = can::parse_slcan(std::string_view{text}.substr(0, text.size() - 1));
    must(read && read->frame == frame, "slcan: a frame that was sent is told as the same frame");
    return;
  }
  must(text.starts_with("< frame ") && text.ends_with(" >\n"), "socketcand: a frame that was sent is told");
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  fuzz::Bytes bytes{data, size};
  const std::uint8_t kind = bytes.take();
  const bool is_slcan = (kind & 1U) != 0;
  const bool read_only = (kind & 2U) != 0;
  std::unique_ptr<tap::Dialect> dialect;
  if (is_slcan) {
    dialect = std::make_unique<tap::SlcanAdapter>(read_only);
  } else {
    dialect = std::make_unique<tap::Socketcand>(read_only);
  }
  std::string said;
  std::vector<can::CanFrame> sent;
  while (!bytes.empty()) {
    for (std::size_t rest = bytes.take() + std::size_t{1}; rest > 0 && !bytes.empty(); --rest) {
      said += static_cast<char>(bytes.take());
    }
    do {
      std::string answers;
      sent.clear();
      const std::size_t used = dialect->hear(said, kRoom, answers, sent);
      must(used <= said.size(), "nothing is used up that was not said");
      must(sent.size() <= kRoom, "no more frames are taken than there is room for");
      must(!read_only || sent.empty(), "who may only look sends nothing");
      said.erase(0, used);
      for (const can::CanFrame& frame : sent) {
        must(can::is_valid(frame), "a frame that is sent can exist on a bus");
        must_be_told(*dialect, is_slcan, frame);
      }
    } while (sent.size() == kRoom);
    must(said.size() <= kMaxKept, "an unended message does not fill the memory");
  }
  return 0;
}
