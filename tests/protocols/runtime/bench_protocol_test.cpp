#include "protocols/runtime/bench_protocol.hpp"

#include <algorithm>
#include <catch2/catch.hpp>
#include <random>

using namespace meltbench;
using namespace meltbench::runtime;

TEST_CASE("Bench protocol: hello, wake, done and report come back as they were written", "[runtime]") {
  link::MessageWriter writer;
  write_hello(writer, {"plant",
                       true,
                       {{"plant.x_m", SignalKind::kValue}, {"plant.bad", SignalKind::kErrorCounter}},
                       {"feeder", "heater"},
                       {"feeder_line"}});
  const auto hello = read_hello(writer.bytes());
  REQUIRE(hello.has_value());
  CHECK(hello->name == "plant");
  REQUIRE(hello->signals.size() == 2);
  CHECK(hello->signals[1].kind == SignalKind::kErrorCounter);
  CHECK(hello->nodes == std::vector<std::string>{"feeder", "heater"});
  CHECK(hello->lines == std::vector<std::string>{"feeder_line"});

  const std::vector<can::StampedFrame> sent{{Instant{1ms}, can::make_frame(1, {2})}};
  const std::vector<std::uint8_t> bytes{1, 0, 255};
  const std::vector<SerialArrival> serial{{Instant{1500us}, 0, bytes}};
  const std::vector<LinkState> lines{LinkState::kDown};
  const std::vector<can::ErrorState> nodes{can::ErrorState::kActive, can::ErrorState::kBusOff};
  const std::vector<std::string> orders{"kind = \"off\""};
  write_wake(writer, {Instant{2ms}, sent, LinkState::kDown, serial, lines, nodes, orders});
  WakeupStorage storage;
  const auto in = read_wake(writer.bytes(), storage);
  REQUIRE(in.has_value());
  CHECK(in->now == Instant{2ms});
  CHECK(in->link == LinkState::kDown);
  CHECK(storage.frames == sent);
  REQUIRE(in->serial.size() == 1);
  CHECK(in->serial[0].at == Instant{1500us});
  CHECK(std::ranges::equal(in->serial[0].bytes, bytes));
  CHECK(std::ranges::equal(in->lines, lines));
  CHECK(std::ranges::equal(in->nodes, nodes));
  CHECK(std::ranges::equal(in->orders, orders));

  Outbox out;
  out.send(can::make_frame(3, {4}));
  out.speak_as(2);
  out.send(can::make_frame(4, {}));
  out.write(0, bytes);
  out.report(Severity::kFault, Instant{2ms}, "code", "text");
  out.wake_at(Instant{5ms}, WakeOn::kDeadlineOnly);
  const std::vector<double> signals{1.0, -0.0};
  write_done(writer, out, signals);
  Outbox back;
  std::vector<double> read(2);
  REQUIRE(read_done(writer.bytes(), back, read));
  CHECK(back.frames().size() == 2);
  REQUIRE(back.senders().size() == 1);
  CHECK(back.senders()[0].first == 1);
  CHECK(back.senders()[0].node == 2);
  REQUIRE(back.serial().size() == 1);
  CHECK(std::ranges::equal(back.serial_bytes(back.serial()[0]), bytes));
  CHECK(back.events().front().code == "code");
  CHECK(back.events().front().severity == Severity::kFault);
  CHECK(back.deadline() == Instant{5ms});
  CHECK(back.wake_on() == WakeOn::kDeadlineOnly);
  CHECK(read == signals);

  write_report(writer, Instant{10ms}, out.events(), signals);
  std::vector<Event> events;
  CHECK(read_report(writer.bytes(), events, read) == Instant{10ms});
  CHECK(events.size() == 1);
}

TEST_CASE("Bench protocol: bytes of a serial line come back as they were written", "[runtime]") {
  link::MessageWriter writer;
  const std::array<std::uint8_t, 3> bytes{1, 0, 255};
  write_serial_piece(writer, {Instant{7ms}, 2, bytes});
  const auto piece = read_serial_piece(writer.bytes());
  REQUIRE(piece.has_value());
  CHECK(piece->at == Instant{7ms});
  CHECK(piece->line == 2);
  CHECK(std::ranges::equal(piece->bytes, bytes));
  CHECK_FALSE(read_serial_piece(writer.bytes().first(writer.bytes().size() - 1)).has_value());
}

TEST_CASE("Bench protocol: an order and the plugs of serial lines come back as they were written", "[runtime]") {
  link::MessageWriter writer;
  write_order(writer, "fault = 1");
  CHECK(read_order(writer.bytes()) == "fault = 1");
  CHECK_FALSE(read_order(writer.bytes().first(writer.bytes().size() - 1)).has_value());
  const std::vector<LinkState> written{LinkState::kUp, LinkState::kDown};
  std::vector<LinkState> read;
  CHECK_FALSE(read_line_states(writer.bytes(), read));
  write_line_states(writer, written);
  CHECK(read_line_states(writer.bytes(), read));
  CHECK(read == written);
}

TEST_CASE("Bench protocol: a question and its answer come back as they were written", "[runtime]") {
  link::MessageWriter writer;
  write_question(writer, {Question::About::kClearFault, "frame drop"});
  const auto question = read_question(writer.bytes());
  REQUIRE(question.has_value());
  CHECK(question->about == Question::About::kClearFault);
  CHECK(question->text == "frame drop");
  CHECK_FALSE(read_hello(writer.bytes()).has_value());
  CHECK_FALSE(read_question(writer.bytes().first(writer.bytes().size() - 1)).has_value());
  std::vector<std::uint8_t> unknown{writer.bytes().begin(), writer.bytes().end()};
  unknown[1 + sizeof(link::kBenchProtocolVersion)] = 99;
  CHECK_FALSE(read_question(unknown).has_value());
  write_answer(writer, {false, "no", "ask otherwise"});
  const auto answer = read_answer(writer.bytes());
  REQUIRE(answer.has_value());
  CHECK_FALSE(answer->accepted);
  CHECK(answer->text == "no");
  CHECK(answer->hint == "ask otherwise");
}

TEST_CASE("Bench protocol: random bytes are refused and harm nobody", "[runtime]") {
  std::mt19937 draw{7};
  std::vector<std::uint8_t> bytes;
  WakeupStorage storage;
  std::vector<double> signals(3);
  Outbox out;
  int accepted = 0;
  for (int i = 0; i < 20000; ++i) {
    bytes.resize(draw() % 64);
    for (auto& byte : bytes) byte = static_cast<std::uint8_t>(draw() % 256);
    if (!bytes.empty()) bytes[0] = static_cast<std::uint8_t>(1 + draw() % 14);
    accepted += read_hello(bytes).has_value() ? 1 : 0;
    accepted += read_question(bytes).has_value() ? 1 : 0;
    accepted += read_wake(bytes, storage).has_value() && !storage.frames.empty() ? 1 : 0;
    accepted += read_done(bytes, out, signals) && !out.frames().empty() ? 1 : 0;
  }
  CHECK(accepted == 0);
}

TEST_CASE("Bench protocol: lateness comes back with its buckets, and a torn message is refused", "[runtime]") {
  LogHistogram lateness;
  lateness.add(17us, Instant{1s});
  lateness.add(17us, Instant{2s});
  lateness.add(3ms, Instant{3s});
  link::MessageWriter writer;
  write_timing(writer, lateness);
  LogHistogram read;
  REQUIRE(read_timing(writer.bytes(), read));
  CHECK(read.count() == 3);
  CHECK(read.max() == 3ms);
  CHECK(read.max_at() == Instant{3s});
  CHECK(read.quantile(0.5) == lateness.quantile(0.5));
  CHECK_FALSE(read_timing(writer.bytes().first(writer.bytes().size() - 1), read));
}

TEST_CASE("Bench protocol: a frame at wall-clock pace names its node, and states of nodes come through", "[runtime]") {
  link::MessageWriter writer;
  write_frame(writer, {Nanos{123'456}, 2, can::make_frame(0x185, {1, 2})});
  const auto carried = read_frame(writer.bytes());
  REQUIRE(carried);
  CHECK(carried->at_monotonic == Nanos{123'456});
  CHECK(carried->node == 2);
  CHECK(carried->frame == can::make_frame(0x185, {1, 2}));
  CHECK_FALSE(read_frame(writer.bytes().first(writer.bytes().size() - 1)));

  const std::vector states{can::ErrorState::kActive, can::ErrorState::kBusOff};
  write_node_states(writer, states);
  std::vector<can::ErrorState> read;
  CHECK(read_node_states(writer.bytes(), read));
  CHECK(read == states);
  CHECK_FALSE(read_frame(writer.bytes()));
}
