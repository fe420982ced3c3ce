#include "bench/bus/broker.hpp"

#include <unistd.h>

#include <catch2/catch.hpp>
#include <optional>

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

TEST_CASE("Broker: a question is kept for who answers it; that about the run is answered at once", "[bus]") {
  using runtime::Question;
  Broker broker{kBus, "folder\nrun"};
  std::vector<link::BenchSocket> silent;
  while (silent.size() < Broker::kMaxSilent - 2) {
    silent.push_back(connect(kBus));
    CHECK_FALSE(broker.take_question().has_value());  // Takes it in: no more than 16 can wait outside.
  }
  link::BenchSocket about_run = connect(kBus);
  link::BenchSocket about_fault = connect(kBus);
  link::MessageWriter writer;
  runtime::write_question(writer, {Question::About::kRun, ""});
  REQUIRE(about_run.send(writer.bytes()));
  runtime::write_question(writer, {Question::About::kBeginFault, "target = 1"});
  REQUIRE(about_fault.send(writer.bytes()));
  std::optional<Asked> asked;
  for (std::size_t looks = 0; looks < 2 * Broker::kMaxSilent && !asked; ++looks) asked = broker.take_question();
  REQUIRE(asked.has_value());
  CHECK(asked->question.about == Question::About::kBeginFault);
  CHECK(asked->question.text == "target = 1");
  answer(*asked, {true, "it begins"});
  std::span<const std::uint8_t> message;
  REQUIRE(about_run.try_receive(message) == link::ReceiveStatus::kMessage);
  CHECK(runtime::read_answer(message)->text == "folder\nrun");
  REQUIRE(about_fault.try_receive(message) == link::ReceiveStatus::kMessage);
  CHECK(runtime::read_answer(message)->text == "it begins");
  CHECK_FALSE(broker.take_question().has_value());
  CHECK_FALSE(broker.take_newcomer().has_value());
}

TEST_CASE("Broker: when it goes, who waits for an answer sees that", "[bus]") {
  std::optional<Broker> broker{kBus};
  link::BenchSocket taken = connect(kBus);
  link::MessageWriter writer;
  runtime::write_question(writer, {runtime::Question::About::kFaults, ""});
  REQUIRE(taken.send(writer.bytes()));
  CHECK(broker->take_question().has_value());  // And lets go of it.
  link::BenchSocket waiting = connect(kBus);
  REQUIRE(waiting.send(writer.bytes()));
  broker.reset();
  std::span<const std::uint8_t> message;
  CHECK(taken.receive(message) == link::ReceiveStatus::kClosed);
  CHECK(waiting.receive(message) == link::ReceiveStatus::kClosed);
}
