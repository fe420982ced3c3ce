// DBC files of strangers: whatever the bytes, the reader answers with a database or with a ConfigError, and every
// message of a database decodes any data.

#include "bench/decode/dbc.hpp"
#include "protocols/config/value.hpp"
#include "tests/fuzz/fuzz.hpp"

using namespace meltbench;
using fuzz::must;

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  try {
    const decode::Dbc dbc = decode::read_dbc(fuzz::as_text(data, size), "fuzz.dbc");
    for (std::uint32_t id = 0; id < 512; ++id) {
      can::CanFrame frame = can::make_frame(id, {0x5A, 0xFF, 0x00, 0x80, 0x01, 0x7F, 0xC3, 0x3C});
      if (const decode::DbcMessage* message = dbc.find(frame)) {
        must(decode::describe_message(*message, frame.data()).starts_with(message->name), "a message has its name");
        const auto values = decode::decode_message(*message, frame.data().first(id % 9));
        must(values.size() <= message->signals.size(), "each signal has one value at most");
      }
    }
  } catch (const config::ConfigError& error) {
    must(error.what()[0] != '\0', "a complaint has words");
  }
  return 0;
}
