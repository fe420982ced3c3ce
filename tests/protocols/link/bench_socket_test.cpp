#include "protocols/link/bench_socket.hpp"

#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>

#include <array>
#include <catch2/catch.hpp>
#include <cerrno>
#include <cstdlib>
#include <filesystem>
#include <vector>

#include "protocols/link/bench_message.hpp"
#include "tests/tools/temporary_folder.hpp"

using namespace meltbench;
using namespace meltbench::link;

namespace {

/// A runtime folder of this test alone.
struct PrivateRuntime {
  PrivateRuntime() { ::setenv("XDG_RUNTIME_DIR", folder.path().c_str(), 1); }
  ~PrivateRuntime() { ::unsetenv("XDG_RUNTIME_DIR"); }
  test::TemporaryFolder folder;
};

}  // namespace

TEST_CASE("Embedded bus: the socket's folder can be entered by its owner only", "[link]") {
  PrivateRuntime runtime;
  const std::string folder = embedded_bus_folder();
  struct stat status {};
  REQUIRE(::stat(folder.c_str(), &status) == 0);
  CHECK((status.st_mode & 0777) == 0700);
  ::chmod(folder.c_str(), 0755);
  CHECK_THROWS_AS(embedded_bus_folder(), LinkError);
}

TEST_CASE("Embedded bus: a name can be used once at a time, and again after its broker died", "[link]") {
  PrivateRuntime runtime;
  {
    const UniqueFd broker = listen_embedded_bus("a");
    CHECK_THROWS_AS(listen_embedded_bus("a"), LinkError);
    CHECK_NOTHROW(connect_embedded_bus("a"));
    CHECK_THROWS_AS(connect_embedded_bus("b"), LinkError);
  }
  CHECK_THROWS_AS(connect_embedded_bus("a"), LinkError);  // The file is there still, but nobody listens.
  CHECK_NOTHROW(listen_embedded_bus("a"));
}

TEST_CASE("Embedded bus: a broker that hangs holds up no other bus, and keeps its name", "[link]") {
  PrivateRuntime runtime;
  const UniqueFd stuck = listen_embedded_bus("stuck");
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  (embedded_bus_folder() + "/stuck.bus").copy(address.sun_path, sizeof(address.sun_path) - 1);
  std::vector<UniqueFd> waiting;  // As many as its queue takes: who connects now would wait.
  do {
    waiting.emplace_back(::socket(AF_UNIX, SOCK_SEQPACKET | SOCK_NONBLOCK | SOCK_CLOEXEC, 0));
  } while (::connect(waiting.back().get(), reinterpret_cast<const sockaddr*>(&address), sizeof(address)) == 0);
  REQUIRE(errno == EAGAIN);
  const UniqueFd other = listen_embedded_bus("other");
  CHECK(list_embedded_buses() == std::vector<std::string>{"other", "stuck"});
  CHECK_THROWS_AS(listen_embedded_bus("stuck"), LinkError);
}

TEST_CASE("Bus name: virtual and kernel buses are told apart, nonsense is refused with a hint", "[link]") {
  CHECK(parse_bus_uri("virtual:bench").kind == BusUri::Kind::kVirtual);
  CHECK(parse_bus_uri("virtual:bench").name == "bench");
  CHECK(parse_bus_uri("can0").kind == BusUri::Kind::kSocketCan);
  CHECK(parse_bus_uri("socketcan:vcan0").name == "vcan0");
  const char* const nonsense =
      GENERATE("", "virtual:", "virtual:../x", "can 0", "slcan:@1", "interface_name_too_long", "socketcan:");
  CHECK_THROWS_AS(parse_bus_uri(nonsense), LinkError);
}

TEST_CASE("Bench message: a message cut anywhere is seen to be incomplete", "[link]") {
  MessageWriter writer;
  writer.begin(MessageType::kFrames);
  writer.put_text("name");
  writer.put_frame(Instant{5ms}, can::make_frame(0x123, {1, 2, 3}));
  const std::array<double, 2> numbers{1.5, -2.5};
  writer.put_numbers(numbers);
  for (std::size_t size = 0; size <= writer.bytes().size(); ++size) {
    MessageReader reader{writer.bytes().first(size)};
    static_cast<void>(reader.take<MessageType>());
    const std::string name{reader.take_text()};
    const can::StampedFrame stamped = reader.take_frame();
    std::array<double, 2> read{};
    reader.take_numbers(read);
    REQUIRE(reader.complete() == (size == writer.bytes().size()));
    if (reader.complete()) {
      CHECK(name == "name");
      CHECK(stamped == can::StampedFrame{Instant{5ms}, can::make_frame(0x123, {1, 2, 3})});
      CHECK(read == numbers);
    }
  }
}
