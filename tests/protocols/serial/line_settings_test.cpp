#include "protocols/serial/line_settings.hpp"

#include <catch2/catch.hpp>

using namespace meltbench;
using namespace meltbench::serial;

TEST_CASE("Line settings: a character takes its start, data, parity and stop bits at the baud rate", "[serial]") {
  CHECK(bits_per_character({9600, Parity::kNone, 1}) == 10);
  CHECK(bits_per_character({9600, Parity::kEven, 1}) == 11);
  CHECK(bits_per_character({9600, Parity::kNone, 2}) == 11);
  CHECK(transmission_time({19200, Parity::kEven, 1}, 0) == 0ns);
  CHECK(transmission_time({19200, Parity::kEven, 1}, 8) == 4'583'334ns);  // 88 bits at 52.0833 us, rounded up.
  CHECK(transmission_time({10'000, Parity::kNone, 1}, 3) == 3ms);
}
