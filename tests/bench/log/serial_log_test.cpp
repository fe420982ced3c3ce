#include "bench/log/serial_log.hpp"

#include <catch2/catch.hpp>

#include "bench/log/log_error.hpp"

using namespace meltbench;
using namespace meltbench::log;
using Catch::Matchers::Contains;

namespace {

std::vector<SerialEntry> read(std::string_view text) {
  MemorySource source{std::span{text.data(), text.size()}};
  SerialLogReader reader{source};
  std::vector<SerialEntry> entries;
  SerialEntry entry;
  while (reader.next(entry)) entries.push_back(entry);
  return entries;
}

}  // namespace

TEST_CASE("a serial log has time, line, sender and bytes; comments and a torn line are passed over", "[log]") {
  const auto entries =
      read("# head\n(0000000012.340001) zones controller 0B03\r\n(13.5) dosing plant FF\n(14.0) zones pl");
  REQUIRE(entries.size() == 2);
  CHECK(entries[0].at == Instant{12'340'001us});
  CHECK(entries[0].line == "zones");
  CHECK(entries[0].sender == "controller");
  CHECK(entries[0].bytes == std::vector<std::uint8_t>{0x0B, 0x03});
  CHECK(entries[1].line == "dosing");
}

TEST_CASE("a serial log that is none is refused with its line", "[log]") {
  const auto text = GENERATE(as<std::string>{}, "(x) zones plant 00\n", "(1.0 zones plant 00\n", "()\n",
                             "(-1) a b 00\n", "(nan) a b 00\n", "(1e30) a b 00\n", "(1.0) zones plant 0\n",
                             "(1.0) zones plant 0G\n", "(1.0) zones\n", "(99999999999) a b 00\n");
  CHECK_THROWS_WITH(read("(0.5) zones plant 00\n" + text), Contains("memory:2"));
}
