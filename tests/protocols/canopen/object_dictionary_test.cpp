#include <limits>

#include <catch2/catch.hpp>

#include "tests/protocols/canopen/test_device.hpp"

using namespace meltbench::canopen;
using meltbench::canopen::testing::make_dictionary;
using Bytes = std::vector<std::uint8_t>;

TEST_CASE("Dictionary: a write is refused for index before sub-index before access before length before value",
          "[canopen]") {
  const ObjectDictionary od = make_dictionary();
  const Bytes long_value(9, 0xFF);
  CHECK(od.check_write({0x2FFF, 9}, long_value) == AbortCode::kNoObject);
  CHECK(od.check_write({0x1000, 9}, long_value) == AbortCode::kNoSubIndex);
  CHECK(od.check_write({0x1000, 0}, long_value) == AbortCode::kReadOnly);
  CHECK(od.check_write({0x2005, 0}, long_value) == AbortCode::kTooLong);
  CHECK(od.check_write({0x2005, 0}, Bytes{0xFF}) == AbortCode::kTooShort);
  CHECK(od.check_write({0x2005, 0}, to_bytes(std::int16_t{101})) == AbortCode::kTooHigh);
  CHECK(od.check_write({0x2005, 0}, to_bytes(std::int16_t{-11})) == AbortCode::kTooLow);
  CHECK(od.check_write({0x2005, 0}, to_bytes(std::int16_t{100})) == AbortCode::kNone);
  CHECK(od.check_write({0x2005, 0}, to_bytes(std::int16_t{-10})) == AbortCode::kNone);
  CHECK(od.check_read({0x2004, 0}) == AbortCode::kWriteOnly);
  CHECK(od.check_read({0x2004, 1}) == AbortCode::kNoSubIndex);
}

TEST_CASE("Dictionary: a handle on a number stays good when the dictionary moves", "[canopen]") {
  ObjectDictionary od = make_dictionary();
  const OdValue<float> value = od.bind<float>(0x2002);
  const ObjectDictionary moved = std::move(od);
  value.set(3.5F);
  CHECK(moved.at(0x2002).get<float>() == 3.5F);
}

TEST_CASE("Dictionary: binding the wrong type or a missing object says which object", "[canopen]") {
  ObjectDictionary od = make_dictionary();
  CHECK_THROWS_WITH(od.bind<float>(0x6041), Catch::Contains("0x6041:0") && Catch::Contains("UNSIGNED16"));
  CHECK_THROWS_WITH(od.bind<float>(0x6041, 3), Catch::Contains("0x6041:3"));
  CHECK_THROWS_WITH(od.add_number(0x6041, 0, DataType::kUnsigned8, AccessType::kReadOnly, std::uint8_t{0}),
                    Catch::Contains("twice"));
  CHECK_THROWS_WITH(od.add_number(0x6050, 0, DataType::kUnsigned8, AccessType::kReadOnly, std::uint16_t{0}),
                    Catch::Contains("UNSIGNED8"));
}

TEST_CASE("Dictionary: odd integer widths are widened with their sign", "[canopen]") {
  const auto widen = [](DataType type, Bytes bytes) {
    return OdEntry{{.address = {0x2000, 0},
                    .name = {},
                    .type = type,
                    .default_value = std::move(bytes),
                    .low_limit = {},
                    .high_limit = {}}}
        .to_int64();
  };
  CHECK(widen(DataType::kInteger24, {0xFE, 0xFF, 0xFF}) == -2);
  CHECK(widen(DataType::kUnsigned24, {0xFE, 0xFF, 0xFF}) == 0xFFFFFE);
  CHECK(widen(DataType::kInteger56, {0, 0, 0, 0, 0, 0, 0x80}) == -(std::int64_t{1} << 55));
  CHECK(widen(DataType::kInteger64, Bytes(8, 0xFF)) == -1);
  CHECK(widen(DataType::kInteger8, {0x80}) == -128);
  CHECK(widen(DataType::kBoolean, {1}) == 1);
}

TEST_CASE("Dictionary: a NaN fails against the limits of a REAL32", "[canopen]") {
  const OdEntry entry{{.address = {0x2000, 0},
                       .name = {},
                       .type = DataType::kReal32,
                       .default_value = {},
                       .low_limit = to_bytes(0.0F),
                       .high_limit = {}}};
  CHECK(entry.check_value(to_bytes(std::numeric_limits<float>::quiet_NaN())) == AbortCode::kInvalidValue);
  CHECK(entry.check_value(to_bytes(-1.0F)) == AbortCode::kTooLow);
  CHECK(entry.check_value(to_bytes(std::numeric_limits<float>::infinity())) == AbortCode::kNone);
}
