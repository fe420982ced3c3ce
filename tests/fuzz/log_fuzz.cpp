// Logs of strangers, in all formats: no bytes may crash the reader, what it gives are frames that can exist, and what
// it refuses it explains.

#include "bench/log/log_error.hpp"
#include "bench/log/log_reader.hpp"
#include "tests/fuzz/fuzz.hpp"

using namespace meltbench;
using fuzz::must;

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const std::string_view text = fuzz::as_text(data, size);
  try {
    const auto reader = log::open_log(std::make_unique<log::MemorySource>(std::span{text.data(), text.size()}));
    log::LogEntry entry;
    while (reader->next(entry)) {
      must(can::is_valid(entry.frame), "a frame in a log can exist on a bus");
      must(entry.channel < reader->channels().size(), "its channel has a name");
    }
  } catch (const log::LogError& error) {
    must(!std::string_view{error.what()}.empty() && !error.hint().empty(), "a refusal is explained");
  }
  return 0;
}
