// Frames as text, as the kernel hands them over, and as bench messages: no bytes may crash a reader, what it accepts
// can exist on a bus, and prints back to the same frame.

#include <algorithm>
#include <cstring>
#include <string>

#include "protocols/can/candump.hpp"
#include "protocols/link/bench_message.hpp"
#include "protocols/link/socketcan_link.hpp"
#include "protocols/runtime/bench_protocol.hpp"
#include "tests/fuzz/fuzz.hpp"

using namespace meltbench;
using fuzz::must;

namespace {

void read_text(std::string_view text) {
  const auto frame = can::parse_candump(text);
  if (!frame) return;
  must(can::is_valid(*frame), "a frame read from text can exist on a bus");
  must(can::parse_candump(can::to_candump(*frame)) == frame, "a frame printed reads back equal");
}

void read_kernel_frame(std::span<const std::uint8_t> bytes) {
  canfd_frame kernel{};
  std::memcpy(&kernel, bytes.data(), std::min(bytes.size(), sizeof kernel));
  const auto frame = link::from_kernel_frame(kernel, bytes.size());
  if (!frame) return;
  must(can::is_valid(*frame), "a frame taken from the kernel can exist on a bus");
  canfd_frame again{};
  const std::size_t size = link::to_kernel_frame(*frame, again);
  must(link::from_kernel_frame(again, size) == frame, "a frame given to the kernel comes back equal");
}

void read_messages(std::span<const std::uint8_t> bytes) {
  (void)runtime::read_hello(bytes);
  (void)runtime::read_welcome(bytes);
  runtime::WakeupStorage storage;
  if (const auto wakeup = runtime::read_wake(bytes, storage)) {
    for (const can::StampedFrame& each : wakeup->frames) {
      must(can::is_valid(each.frame), "a frame in a message can exist on a bus");
    }
  }
  Outbox out;
  std::array<double, 3> signals{};
  if (runtime::read_done(bytes, out, signals)) {
    for (const can::CanFrame& frame : out.frames()) must(can::is_valid(frame), "a frame sent can exist on a bus");
  }
  std::vector<Event> events;
  (void)runtime::read_report(bytes, events, signals);
  (void)runtime::read_frame(bytes);
  std::vector<can::ErrorState> states;
  (void)runtime::read_node_states(bytes, states);
  (void)runtime::read_serial_piece(bytes);
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  if (size == 0) return 0;
  read_text(fuzz::as_text(data, size));
  read_kernel_frame({data, size});
  read_messages({data, size});
  return 0;
}
