#include "bench/bus/broker.hpp"

#include <unistd.h>

#include <catch2/catch.hpp>

using namespace meltbench;
using namespace meltbench::bus;

namespace {

link::BenchSocket connect(const std::string& bus) {
  return link::BenchSocket{link::connect_embedded_bus(bus)};
}

void say_hello(link::BenchSocket& socket, const std::string& name) {
  link::MessageWriter writer;
  runtime::write_hello(writer, {name, true, {}, {}, {}});
  REQUIRE(socket.send(writer.bytes()));
}

const std::string kBus = "broker-test-" + std::to_string(::getpid());

}  // namespace

TEST_CASE("Broker: who is slow to say hello, and who only looks in, hold up nobody", "[bus]") {
  Broker broker{kBus};
  link::BenchSocket slow = connect(kBus);
  { const link::BenchSocket looks_in = connect(kBus); }
  link::BenchSocket plant = connect(kBus);
  say_hello(plant, "plant");
  int looks = 0;
  const std::vector<std::string> names{"controller", "plant"};
  const auto joined = broker.wait_for(names, [&] {
    if (++looks == 5) say_hello(slow, "controller");
    return looks > 100;
  });
  REQUIRE(joined.has_value());
  CHECK(joined->at(0).hello.name == "controller");
  CHECK(joined->at(1).hello.name == "plant");
}

TEST_CASE("Broker: who is not waited for, or comes twice, is a newcomer later", "[bus]") {
  Broker broker{kBus};
  link::BenchSocket stranger = connect(kBus);
  link::BenchSocket first = connect(kBus);
  link::BenchSocket second = connect(kBus);
  say_hello(stranger, "controller");
  say_hello(first, "plant");
  say_hello(second, "plant");
  int looks = 0;
  const std::vector<std::string> names{"plant"};
  const auto joined = broker.wait_for(names, [&] { return ++looks > 100; });
  REQUIRE(joined.has_value());
  CHECK(joined->size() == 1);
  std::vector<std::string> later;
  for (looks = 0; looks < 10; ++looks) {
    if (const auto newcomer = broker.take_newcomer()) later.push_back(newcomer->hello.name);
  }
  CHECK(later == std::vector<std::string>{"controller", "plant"});
}
