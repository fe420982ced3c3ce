// Electronic data sheets of strangers: whatever the bytes, the reader answers with a dictionary or with an EdsError,
// and a node made of a dictionary survives its start and a few frames.

#include <stdexcept>
#include <utility>

#include "protocols/canopen/eds.hpp"
#include "protocols/canopen/node.hpp"
#include "tests/fuzz/fuzz.hpp"

using namespace meltbench;
using fuzz::must;

namespace {

constexpr std::uint8_t kNodeId = 5;

void start_node(canopen::Eds eds) {
  try {
    canopen::Node node{std::move(eds.dictionary), kNodeId};
    canopen::Frames out;
    node.start(Instant{}, out);
    node.on_frame(Instant{}, can::make_frame(0x000, {0x01, kNodeId}), out);
    node.on_frame(Instant{1ms}, can::make_frame(0x080, {}), out);
    node.on_frame(Instant{2ms}, can::make_frame(0x600 + kNodeId, {0x40, 0x18, 0x10, 0x01, 0, 0, 0, 0}), out);
    node.on_time(Instant{1s}, out);
    for (const can::CanFrame& frame : out) must(can::is_valid(frame), "a node sends frames that can exist on a bus");
  } catch (const std::invalid_argument&) {
    // Documented: PDO values of the file do not fit together.
  }
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  try {
    start_node(canopen::read_eds(fuzz::as_text(data, size), "fuzz.eds", kNodeId));
  } catch (const canopen::EdsError& error) {
    must(error.what()[0] != '\0', "a complaint has words");
  }
  return 0;
}
