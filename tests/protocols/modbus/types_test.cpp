#include "protocols/modbus/types.hpp"

#include <catch2/catch.hpp>
#include <vector>

using namespace meltbench;
using namespace meltbench::modbus;

TEST_CASE("Checksum: is that of the published catalogue and of the specification's wire order", "[modbus]") {
  const std::vector<std::uint8_t> digits{'1', '2', '3', '4', '5', '6', '7', '8', '9'};
  CHECK(calc_crc(digits) == 0x4B37);  // Check value of CRC-16/MODBUS.
  const std::vector<std::uint8_t> request{0x01, 0x03, 0x00, 0x00, 0x00, 0x02};
  CHECK(calc_crc(request) == 0x0BC4);  // C4 0B on the wire.
}

TEST_CASE("Line times: 3.5 characters up to 19200 baud, fixed above", "[modbus]") {
  const LineTiming slow = make_line_timing(19'200);
  CHECK(slow.character == 572'916ns);  // 11 bits.
  CHECK(slow.t1_5 == 859'375ns);
  CHECK(slow.t3_5 == 2'005'208ns);
  CHECK(slow.on_wire(8) == 8 * 572'916ns);
  const LineTiming fast = make_line_timing(38'400, 10);
  CHECK(fast.character == 260'416ns);
  CHECK(fast.t1_5 == 750us);
  CHECK(fast.t3_5 == 1750us);
}

TEST_CASE("32-bit values: both word orders come back, and differ on the wire", "[modbus]") {
  const float value = 3.7925F;
  for (const WordOrder order : {WordOrder::kHighFirst, WordOrder::kLowFirst}) {
    CHECK(to_float(to_words(value, order), order) == value);
    CHECK(to_u32(to_words(std::uint32_t{0x1234'5678}, order), order) == 0x1234'5678);
  }
  CHECK(to_words(std::uint32_t{0x1234'5678}, WordOrder::kHighFirst) == WordPair{0x1234, 0x5678});
  CHECK(to_words(std::uint32_t{0x1234'5678}, WordOrder::kLowFirst) == WordPair{0x5678, 0x1234});
}
