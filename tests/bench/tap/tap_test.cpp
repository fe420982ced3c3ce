#include "bench/tap/tap.hpp"

#include <fcntl.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <array>
#include <catch2/catch.hpp>
#include <filesystem>

#include "protocols/link/can_link.hpp"
#include "tests/tools/temporary_folder.hpp"

using namespace meltbench;
using tap::Tap;

namespace {

namespace fs = std::filesystem;

/// The other end of a connection, in this thread: what it sends is there when the tap looks next.
class Program {
 public:
  explicit Program(link::UniqueFd fd) : fd_{std::move(fd)} { REQUIRE(fd_); }

  void say(std::string_view text) { REQUIRE(::write(fd_.get(), text.data(), text.size()) == std::ssize(text)); }
  /// What one read(2) gives, as a program with a large buffer sees it; empty if nothing is there.
  std::string hear() {
    std::array<char, 65536> bytes;
    const ssize_t size = ::read(fd_.get(), bytes.data(), bytes.size());
    return {bytes.data(), static_cast<std::size_t>(std::max<ssize_t>(size, 0))};
  }
  void go() { fd_ = link::UniqueFd{}; }

 private:
  link::UniqueFd fd_;
};

link::UniqueFd connect_to(const std::string& path) {
  link::UniqueFd fd{::socket(AF_UNIX, SOCK_STREAM | SOCK_NONBLOCK, 0)};
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  path.copy(address.sun_path, sizeof address.sun_path - 1);
  REQUIRE(::connect(fd.get(), reinterpret_cast<const sockaddr*>(&address), sizeof address) == 0);
  return fd;
}

/// A tap on a Unix socket, and the bus behind it.
class Bus {
 public:
  explicit Bus(bool read_only = false) : tap_{{"unix:" + (folder_ / "tap").string(), folder_ / "slcan", read_only}} {}

  Program connect() { return Program{connect_to(folder_ / "tap")}; }
  Program open_adapter() {
    return Program{link::UniqueFd{::open((folder_ / "slcan").c_str(), O_RDWR | O_NONBLOCK | O_NOCTTY)}};
  }
  /// A program that looks at the bus, and has heard so.
  Program look_on() {
    Program program = connect();
    tap_.exchange(0, taken);
    program.say("< open can0 >");
    tap_.exchange(0, taken);
    program.say("< rawmode >");
    tap_.exchange(0, taken);
    REQUIRE(program.hear() == "< hi >< ok >< ok >");
    program.say("< echo >");
    tap_.exchange(0, taken);
    REQUIRE(program.hear() == "< echo >\n");
    return program;
  }
  /// Takes what the programs send, puts it on the bus, and hands over what waits.
  void go_on(std::size_t room = 100) {
    taken.clear();
    tap_.exchange(room, taken);
    for (const can::CanFrame& frame : taken) tap_.show({Instant{1s}, frame}, bus::kTapSender);
    for (const can::CanFrame& frame : taken) all_taken.push_back(frame);
    std::vector<can::CanFrame> none;
    tap_.exchange(0, none);
  }
  Tap& tap() { return tap_; }

  std::vector<can::CanFrame> taken;
  std::vector<can::CanFrame> all_taken;

 private:
  test::TemporaryFolder folder_;
  Tap tap_;
};

can::StampedFrame make_numbered(std::uint32_t number) {
  return {Instant{1s},
          can::make_frame(0x181, {static_cast<std::uint8_t>(number >> 16U), static_cast<std::uint8_t>(number >> 8U),
                                  static_cast<std::uint8_t>(number)})};
}

}  // namespace

TEST_CASE("Tap: a program sees the frames of the bus and of other programs, but not its own", "[tap]") {
  Bus bus;
  Program one = bus.look_on();
  Program other = bus.look_on();
  one.say("< send 605 1 AB >");
  bus.go_on();
  bus.tap().show({Instant{2s}, can::make_frame(0x585, {0xCD})}, 1);
  bus.go_on();
  CHECK(one.hear() == "< frame 585 2.000000 CD >\n");
  CHECK(other.hear() == "< frame 605 1.000000 AB >\n< frame 585 2.000000 CD >\n");
}

TEST_CASE("Tap: a frame of the bus that equals one that a program has sent is shown to it", "[tap]") {
  Bus bus;
  Program one = bus.look_on();
  one.say("< send 80 0 >");
  bus.go_on();
  bus.tap().show({Instant{2s}, can::make_frame(0x80, {})}, 0);
  bus.go_on();
  CHECK(one.hear() == "< frame 080 2.000000  >\n");
}

TEST_CASE("Tap: nothing follows the answer to rawmode until the program has said something more", "[tap]") {
  Bus bus;
  Program program = bus.connect();
  bus.go_on();
  program.say("< open can0 >");
  bus.go_on();
  program.say("< rawmode >");
  bus.go_on();
  bus.tap().show(make_numbered(1), 0);
  bus.go_on();
  CHECK(program.hear() == "< hi >< ok >< ok >");
  program.say("< send 605 0 >");
  bus.go_on();
  CHECK(program.hear() == "< frame 181 1.000000 000001 >\n");
}

TEST_CASE("Tap: what a program sends waits while the bus has no room, and none is lost or swapped", "[tap]") {
  Bus bus;
  Program program = bus.look_on();
  std::string burst;
  for (int i = 0; i < 500; ++i) burst += "< send " + std::to_string(100 + i) + " 0 >";
  program.say(burst);
  program.go();  // It does not wait for its frames to be taken.
  bus.go_on(0);
  CHECK(bus.all_taken.empty());
  for (int i = 0; i < 100 && bus.all_taken.size() < 500; ++i) {
    bus.go_on(7);
    CHECK(bus.taken.size() <= 7);
  }
  REQUIRE(bus.all_taken.size() == 500);
  for (std::size_t i = 0; i < 500; ++i) {
    CHECK(bus.all_taken[i].id == std::stoul(std::to_string(100 + i), nullptr, 16));
  }
}

TEST_CASE("Tap: a program that talks without end does not silence another", "[tap]") {
  Bus bus;
  Program loud = bus.look_on();
  Program quiet = bus.look_on();
  for (int i = 0; i < 50; ++i) loud.say("< send 1 0 >");
  quiet.say("< send 2 0 >");
  bus.go_on(5);
  bus.go_on(5);
  CHECK(std::ranges::count(bus.all_taken, 2U, &can::CanFrame::id) == 1);
}

TEST_CASE("Tap: a program that does not read loses what does not fit, is told of at the end, and delays nobody",
          "[tap]") {
  Bus bus;
  Program sleeper = bus.look_on();
  Program reader = bus.look_on();
  constexpr std::uint32_t kFrames = 300'000;  // About 10 MB as text: more than twice what may wait.
  std::string heard;
  for (std::uint32_t i = 0; i < kFrames; ++i) {
    bus.tap().show(make_numbered(i), 0);
    if (i % 64 != 0) continue;
    bus.go_on();
    heard += reader.hear();
  }
  for (std::string more = "x"; !more.empty(); heard += more) {
    bus.go_on();
    more = reader.hear();
  }
  CHECK(std::ranges::count(heard, '\n') == kFrames);
  // The sleeper wakes: whole frames, in order, from the first.
  bus.go_on();
  const std::string late = sleeper.hear();
  CHECK(late.starts_with("< frame 181 1.000000 000000 >\n< frame 181 1.000000 000001 >\n"));
  bus.tap().drain(1ms);
  REQUIRE(bus.tap().complaints().size() == 1);
  CHECK(bus.tap().complaints()[0].find("read too slowly and lost ") != std::string::npos);
}

TEST_CASE("Tap: at the end a program may read what waits for it", "[tap]") {
  Bus bus;
  Program program = bus.look_on();
  for (std::uint32_t i = 0; i < 100; ++i) bus.tap().show(make_numbered(i), 0);
  bus.tap().drain(1s);
  CHECK(bus.tap().complaints().empty());
  const std::string heard = program.hear();
  CHECK(std::ranges::count(heard, '\n') == 100);
}

TEST_CASE("Tap: a program on the pseudo-terminal finds an slcan adapter, and the next one a closed one", "[tap]") {
  Bus bus;
  {
    Program program = bus.open_adapter();
    program.say("S6\rO\rt6051AB\r");
    bus.go_on();
    CHECK(program.hear() == "\r\rz\r");
    REQUIRE(bus.taken.size() == 1);
    CHECK(bus.taken[0] == can::make_frame(0x605, {0xAB}));
    bus.tap().show({Instant{2s}, can::make_frame(0x585, {0xCD})}, 1);
    bus.go_on();
    program.say("V\r");
    bus.go_on();
    CHECK(program.hear() == "t5851CD\rV1013\r");
  }
  bus.go_on();
  Program next = bus.open_adapter();
  bus.go_on();
  next.say("t6051AB\r");
  bus.go_on();
  CHECK(next.hear() == "\a");
}

TEST_CASE("Tap: it waits for those who are to look on before the run begins", "[tap]") {
  Bus bus;
  Program program = bus.connect();
  program.say("< open can0 >< rawmode >< send 605 0 >");
  int asked = 0;
  bus.tap().wait_for(1, [&asked] { return ++asked > 100; });
  CHECK(asked <= 100);
  bus.tap().wait_for(2, [&asked] { return ++asked > 0; });
  bus.go_on();
  CHECK(bus.taken.size() == 1);  // What it sent before the run began was kept for it.
}

TEST_CASE("Tap: an address that cannot be is refused with what could be", "[tap]") {
  for (const char* const address : {"29536x", "99999", "unix:", "-1", "can0"}) {
    INFO(address);
    CHECK_THROWS_AS((Tap{{address, "", false}}), link::LinkError);
  }
  const test::TemporaryFolder folder;
  const std::string path = folder / "tap";
  const Tap first{{"unix:" + path, "", false}};
  CHECK_THROWS_AS((Tap{{"unix:" + path, "", false}}), link::LinkError);
  CHECK_THROWS_AS((Tap{{"", path, false}}), link::LinkError);  // Not a link to a pseudo-terminal: left alone.
}

TEST_CASE("Tap: what a killed bench has left is replaced, and an orderly one leaves nothing", "[tap]") {
  const test::TemporaryFolder folder;
  const std::string socket_path = folder / "tap";
  const std::string link_path = folder / "slcan";
  {
    const link::UniqueFd left{::socket(AF_UNIX, SOCK_STREAM, 0)};
    sockaddr_un address{};
    address.sun_family = AF_UNIX;
    socket_path.copy(address.sun_path, sizeof address.sun_path - 1);
    REQUIRE(::bind(left.get(), reinterpret_cast<const sockaddr*>(&address), sizeof address) == 0);
    REQUIRE(::symlink("/dev/pts/9999", link_path.c_str()) == 0);
  }
  {
    const Tap tap{{"unix:" + socket_path, link_path, false}};
    CHECK(tap.places() == std::vector<std::string>{"socketcand on unix:" + socket_path, "slcan on " + link_path});
  }
  CHECK_FALSE(fs::exists(fs::symlink_status(socket_path)));
  CHECK_FALSE(fs::exists(fs::symlink_status(link_path)));
}
