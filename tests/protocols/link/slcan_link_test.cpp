#include "protocols/link/slcan_link.hpp"

#include "tests/protocols/link/pseudo_terminal.hpp"
#include "tests/tools/temporary_folder.hpp"

using namespace meltbench;
using namespace meltbench::link;
using namespace meltbench::test;
using Catch::Contains;

namespace {

constexpr std::string_view kOpening = "\rC\rS6\rO\r";

/// The next frame; fails the test if none comes within seconds.
can::CanFrame receive_frame(SlcanLink& link) {
  while (true) {
    if (const auto received = link.receive()) return received->frame;
    wait_for(link.fd());
  }
}

/// Lets the link read until a frame with this id: what was said before has been read then.
void read_up_to(SlcanLink& link, const Device& adapter, std::uint32_t id) {
  std::string text;
  can::append_slcan(text, can::make_frame(id, {}));
  adapter.write(text);
  while (receive_frame(link).id != id) {
  }
}

}  // namespace

TEST_CASE("slcan link: opens the channel at the bit rate, and closes it in the end", "[link]") {
  const Device adapter;
  {
    const SlcanLink link{adapter.name(), 125'000};
    CHECK(adapter.read(9) == "\rC\rS4\rO\r");
  }
  CHECK(adapter.read(2) == "C\r");
}

TEST_CASE("slcan link: frames go both ways, whatever else the adapter says and in whatever pieces", "[link]") {
  const Device adapter;
  SlcanLink link{adapter.name(), 500'000};
  CHECK(adapter.read(kOpening.size()) == kOpening);
  REQUIRE(link.send(can::make_frame(0x123, {0xDE, 0xAD})) == SendStatus::kSent);
  CHECK(adapter.read(10) == "t1232DEAD\r");
  CHECK_FALSE(link.receive().has_value());

  adapter.write("\r\rz\rV1013\rt18511");
  CHECK_FALSE(link.receive().has_value());
  adapter.write("1\rT1FFFFFFF0EA5F\r");  // The second has a stamp.
  CHECK(receive_frame(link) == can::make_frame(0x185, {0x11}));
  const can::CanFrame extended = receive_frame(link);
  CHECK(extended.extended);
  CHECK(extended.id == 0x1FFF'FFFF);
  CHECK_FALSE(link.receive().has_value());
}

TEST_CASE("slcan link: an error frame cannot be said", "[link]") {
  const Device adapter;
  SlcanLink link{adapter.name(), 500'000};
  can::CanFrame error;
  error.kind = can::FrameKind::kError;
  error.length = 8;
  CHECK(link.send(error) == SendStatus::kUnsupported);
}

TEST_CASE("slcan link: what the adapter refuses or loses is counted", "[link]") {
  const Device adapter;
  SlcanLink link{adapter.name(), 500'000};
  adapter.write("\a\aF00\rF01\rF88\r");
  read_up_to(link, adapter, 1);
  CHECK(link.counters().refused == 2);
  CHECK(link.counters().dropped == 2);
  CHECK(link.counters().errors == 1);
}

TEST_CASE("slcan link: a queue that nobody empties is full, and what it took comes out whole", "[link]") {
  const Device adapter;
  SlcanLink link{adapter.name(), 500'000};
  std::size_t sent = 0;
  while (link.send(can::make_frame(0x123, {1, 2, 3, 4, 5, 6, 7, 8})) == SendStatus::kSent) REQUIRE(++sent < 100'000);
  CHECK(link.counters().full == 1);
  CHECK(adapter.read(kOpening.size()) == kOpening);
  const std::string line = "t12380102030405060708\r";
  for (std::size_t i = 0; i < sent; ++i) {
    static_cast<void>(link.receive());  // Goes on with the line that was taken half.
    REQUIRE(adapter.read(line.size()) == line);
  }
  CHECK(link.send(can::make_frame(0x123, {})) == SendStatus::kSent);
}

TEST_CASE("slcan link: an adapter unplugged and plugged in again is opened anew", "[link]") {
  const test::TemporaryFolder folder;
  const std::string name = folder / "by-id";
  Device first;
  std::filesystem::create_symlink(first.name(), name);
  SlcanLink link{name, 500'000};
  first.write("t1230");
  first.unplug();
  Device second;
  const Device third;
  std::filesystem::remove(name);
  std::filesystem::create_symlink(third.name(), name);

  wait_for(link.fd());
  while (link.fd() >= 0) CHECK_FALSE(link.receive().has_value());
  CHECK(link.send(can::make_frame(1, {})) == SendStatus::kDown);
  CHECK_FALSE(link.is_up());  // Though it is there already: frames were lost.
  CHECK(link.is_up());
  CHECK(link.counters().downs == 1);
  CHECK(third.read(kOpening.size()) == kOpening);
  third.write("0\rt4560\r");  // The half line of the first is forgotten.
  CHECK(receive_frame(link).id == 0x456);
}

TEST_CASE("slcan link: a bit rate without a digit, and words that are no bus, are refused", "[link]") {
  const Device adapter;
  CHECK_THROWS_WITH(SlcanLink(adapter.name(), 123'456), Contains("123456"));
  const BusUri uri = parse_bus_uri("slcan:/dev/serial/by-id/usb-x@y-if00@250000");
  CHECK(uri.kind == BusUri::Kind::kSlcan);
  CHECK(uri.name == "/dev/serial/by-id/usb-x@y-if00");
  CHECK(uri.bit_rate_bit_per_s == 250'000);
  CHECK(parse_bus_uri("slcan:/dev/ttyACM0").bit_rate_bit_per_s == 500'000);
  CHECK(parse_bus_uri("none").kind == BusUri::Kind::kNone);
  for (const char* text : {"slcan:", "slcan:@500000", "slcan:/dev/ttyACM0@fast", "slcan:/dev/ttyACM0@"}) {
    CHECK_THROWS_WITH(parse_bus_uri(text), Contains("no CAN bus"));
  }
}
