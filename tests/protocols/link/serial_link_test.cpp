#include "protocols/link/serial_link.hpp"

#include <fstream>

#include "protocols/link/can_link.hpp"
#include "tests/protocols/link/pseudo_terminal.hpp"
#include "tests/tools/temporary_folder.hpp"

using namespace meltbench;
using namespace meltbench::link;
using namespace meltbench::test;
using Catch::Contains;

namespace {

constexpr serial::LineSettings kLine{19'200, serial::Parity::kNone, 1};

}  // namespace

TEST_CASE("Serial port: a pseudo-terminal of our own carries every byte both ways to whoever opens its name",
          "[link]") {
  const test::TemporaryFolder folder;
  std::string all;
  for (int byte = 0; byte < 256; ++byte) all += static_cast<char>(byte);
  SerialPort maker{"pty:" + (folder / "feeder").string(), kLine};
  for (int visitor = 0; visitor < 2; ++visitor) {  // One goes, another comes: our end stays up.
    SerialPort other{folder / "feeder", kLine};
    CHECK_FALSE(maker.receive().has_value());
    REQUIRE(maker.write(bytes_of(all)) == all.size());
    CHECK(read_text(other, all.size()) == all);
    REQUIRE(other.write(bytes_of(all)) == all.size());
    CHECK(read_text(maker, all.size()) == all);
    CHECK(maker.is_up());
  }
}

TEST_CASE("Serial port: the name of a pseudo-terminal goes with its maker, and replaces only such a name", "[link]") {
  const test::TemporaryFolder folder;
  const std::string name = folder / "feeder";
  { const SerialPort maker{"pty:" + name, kLine}; }
  CHECK_FALSE(std::filesystem::is_symlink(name));
  std::filesystem::create_symlink("/dev/pts/gone", name);  // Left by one that was killed.
  { const SerialPort maker{"pty:" + name, kLine}; }
  std::ofstream{name} << "precious";
  CHECK_THROWS_WITH(SerialPort("pty:" + name, kLine), Contains("feeder") && Contains("File exists"));
  CHECK(std::filesystem::is_regular_file(name));
  const std::string by_id = folder / "by-id";
  std::filesystem::create_symlink("/dev/ttyUSB0", by_id);
  CHECK_THROWS_WITH(SerialPort("pty:" + by_id, kLine), Contains("by-id") && Contains("File exists"));
  CHECK(std::filesystem::read_symlink(by_id) == "/dev/ttyUSB0");
}

TEST_CASE("Serial port: unplugged, and plugged in again as another device of the same name", "[link]") {
  const test::TemporaryFolder folder;
  const std::string name = folder / "by-id";
  Device first;
  std::filesystem::create_symlink(first.name(), name);
  SerialPort port{name, kLine};
  REQUIRE(port.write(bytes_of("ask")) == 3);
  CHECK(first.read(3) == "ask");
  first.unplug();

  wait_for(port.fd());
  CHECK_FALSE(port.receive().has_value());
  CHECK(port.fd() == -1);
  CHECK_FALSE(port.is_up());
  CHECK(port.write(bytes_of("lost")) == 0);
  CHECK_FALSE(port.reopen());
  std::filesystem::remove(name);
  CHECK_FALSE(port.reopen());

  Device second;
  Device third;  // Not the number that the first one had.
  std::filesystem::create_symlink(third.name(), name);
  REQUIRE(port.reopen());
  CHECK(port.is_up());
  third.write("hello");
  CHECK(read_text(port, 5) == "hello");
  REQUIRE(port.write(bytes_of("ask")) == 3);
  CHECK(third.read(3) == "ask");
}

TEST_CASE("Serial port: a write to a device that has gone says so", "[link]") {
  Device device;
  SerialPort port{device.name(), kLine};
  device.unplug();
  CHECK(port.write(bytes_of("lost")) == 0);
  CHECK_FALSE(port.is_up());
}

TEST_CASE("Serial port: takes what it has room for when nobody reads", "[link]") {
  const Device device;
  SerialPort port{device.name(), kLine};
  const std::vector<std::uint8_t> much(1 << 20);
  const std::size_t taken = port.write(much);
  CHECK(taken > 0);
  CHECK(taken < much.size());
  CHECK(port.write(much) < much.size());
  CHECK(port.is_up());
}

TEST_CASE("Serial port: what cannot be opened is told, with what to do", "[link]") {
  CHECK_THROWS_WITH(SerialPort("/dev/no_such_port", kLine), Contains("/dev/no_such_port") && Contains("No such file"));
  CHECK_THROWS_WITH(SerialPort("/dev/null", kLine), Contains("/dev/null") && Contains("no serial port"));
  CHECK_THROWS_WITH(SerialPort("pty:/no_such_folder/x", kLine), Contains("/no_such_folder/x"));
}
