#include "protocols/modbus/rtu_client.hpp"

#include <catch2/catch.hpp>

#include "protocols/modbus/rtu_server.hpp"
#include "tests/protocols/modbus/small_map.hpp"

using namespace meltbench;
using namespace meltbench::modbus;

namespace {

using Bytes = std::vector<std::uint8_t>;
using Outcome = ClientResult::Outcome;
const LineTiming kTiming = make_line_timing(38'400);
const Pdu kRequest = make_read(Function::kReadHoldingRegisters, 0, 1);
const Bytes kAnswer = make_frame(1, Pdu{3, 2, 0, 42});

/// A client whose line the test holds in its hands.
struct Desk {
  RtuClient client{kTiming, {.answer_timeout = 20ms, .retries = 2, .broadcast_turnaround = 100ms}};
  Instant now{};
  Bytes sent;

  void send(std::uint8_t unit, const Pdu& request) { client.send(now, unit, request, sent); }
  void hear(const Bytes& bytes) {
    now += kTiming.on_wire(bytes.size());
    client.on_bytes(now, bytes);
    client.on_time(now, sent);
  }
  void run_to(Instant to) {
    for (; client.next_deadline() <= to; client.on_time(now, sent)) now = std::max(now, client.next_deadline());
    now = std::max(now, to);
  }
};

}  // namespace

TEST_CASE("Client: an answer ends the request and says when the device had read it", "[modbus]") {
  Desk desk;
  desk.send(1, kRequest);
  CHECK(desk.sent == make_frame(1, kRequest));
  CHECK_FALSE(desk.client.is_idle());
  desk.run_to(Instant{8ms});
  desk.hear(kAnswer);
  const auto result = desk.client.take_result();
  REQUIRE(result);
  CHECK(result->outcome == Outcome::kAnswer);
  CHECK(result->request_end == Instant{kTiming.on_wire(8)});
  CHECK(result->at == desk.now);
  std::array<std::uint16_t, 1> value{};
  CHECK(read_registers(result->answer, value));
  CHECK(value[0] == 42);
  CHECK(desk.client.is_idle());
}

TEST_CASE("Client: an unanswered request is repeated, then given up", "[modbus]") {
  Desk desk;
  desk.send(1, kRequest);
  const Nanos once = kTiming.on_wire(8) + 20ms;
  desk.run_to(Instant{once - 1ns});
  CHECK(desk.sent.size() == 8);
  desk.run_to(Instant{once});
  CHECK(desk.sent.size() == 16);
  desk.run_to(Instant{3 * once});
  CHECK(desk.sent.size() == 24);
  const auto result = desk.client.take_result();
  REQUIRE(result);
  CHECK(result->outcome == Outcome::kTimeout);
  CHECK(result->attempts == 3);
  CHECK(result->answer.empty());
  CHECK(desk.client.timeouts() == 3);
}

TEST_CASE("Client: an exception is an answer", "[modbus]") {
  Desk desk;
  desk.send(1, kRequest);
  desk.hear(make_frame(1, Pdu{0x83, 2}));
  const auto result = desk.client.take_result();
  REQUIRE(result);
  CHECK(result->outcome == Outcome::kException);
  CHECK(result->exception == ExceptionCode::kIllegalAddress);
}

TEST_CASE("Client: what does not answer the request is rejected", "[modbus]") {
  Desk desk;
  desk.send(1, kRequest);
  const std::vector<Bytes> foreign{
      make_frame(2, Pdu{3, 2, 0, 42}),        // Another unit.
      make_frame(1, Pdu{4, 2, 0, 42}),        // Another function.
      make_frame(1, Pdu{3, 4, 0, 42, 0, 1}),  // More than was asked for.
      make_frame(1, Pdu{0x84, 2}),            // An exception to something else.
      make_frame(1, Pdu{0x83, 0}),            // No exception code.
  };
  for (const Bytes& bytes : foreign) desk.hear(bytes);
  CHECK_FALSE(desk.client.take_result());
  CHECK(desk.client.rejected() == foreign.size());
  desk.hear(kAnswer);
  CHECK(desk.client.take_result()->outcome == Outcome::kAnswer);
  desk.hear(kAnswer);  // Late, nobody asked.
  CHECK_FALSE(desk.client.take_result());
  CHECK(desk.client.rejected() == foreign.size() + 1);
}

TEST_CASE("Client: a write is answered by its echo only", "[modbus]") {
  Desk desk;
  desk.send(1, make_write_register(3, 7));
  desk.hear(make_frame(1, make_write_register(3, 8)));
  CHECK_FALSE(desk.client.take_result());
  desk.hear(make_frame(1, make_write_register(3, 7)));
  CHECK(desk.client.take_result()->outcome == Outcome::kAnswer);
}

TEST_CASE("Client: an answer with a wrong checksum is none, and the repetition is answered", "[modbus]") {
  Desk desk;
  desk.send(1, kRequest);
  Bytes broken = kAnswer;
  broken[3] ^= 1U;
  desk.hear(broken);
  desk.run_to(Instant{25ms});
  CHECK(desk.sent.size() == 16);
  desk.hear(kAnswer);
  const auto result = desk.client.take_result();
  REQUIRE(result);
  CHECK(result->outcome == Outcome::kAnswer);
  CHECK(result->attempts == 2);
}

TEST_CASE("Client: keeps 3.5 characters between an answer and the next request", "[modbus]") {
  Desk desk;
  desk.send(1, kRequest);
  desk.run_to(Instant{5ms});
  desk.hear(kAnswer);
  REQUIRE(desk.client.take_result());
  desk.send(1, kRequest);
  CHECK(desk.sent.size() == 8);
  CHECK(desk.client.next_deadline() == desk.now + kTiming.t3_5);
  desk.run_to(desk.now + kTiming.t3_5);
  CHECK(desk.sent.size() == 16);
}

TEST_CASE("Client: after a broadcast it waits the turnaround and expects nothing", "[modbus]") {
  Desk desk;
  desk.send(kBroadcast, make_write_register(0, 1));
  desk.run_to(Instant{100ms});
  CHECK_FALSE(desk.client.take_result());
  desk.run_to(Instant{100ms + kTiming.on_wire(8)});
  CHECK(desk.client.take_result()->outcome == Outcome::kBroadcastDone);
  CHECK(desk.client.timeouts() == 0);
}

TEST_CASE("Client and server: talk over one line", "[modbus]") {
  Desk desk;
  SmallMap map;
  RtuServer server{kTiming};
  server.add(7, map);
  const auto transact = [&](const Pdu& request) {
    desk.sent.clear();
    desk.send(7, request);
    desk.run_to(desk.now + 2ms);  // If it was held for silence.
    const Instant heard = desk.now + kTiming.on_wire(desk.sent.size());
    server.on_bytes(heard, desk.sent);
    Bytes answer;
    desk.now = server.next_deadline();
    server.on_time(desk.now, answer);
    desk.hear(answer);
    return desk.client.take_result().value().outcome;
  };
  CHECK(transact(make_write_registers(0, std::array<std::uint16_t, 3>{1, 2, 3})) == Outcome::kAnswer);
  CHECK(transact(make_read_write(0, 3, 4, std::array<std::uint16_t, 1>{9})) == Outcome::kAnswer);
  CHECK(transact(make_write_coils(0, std::array{true, true})) == Outcome::kAnswer);
  CHECK(transact(make_read(Function::kReadCoils, 0, 2)) == Outcome::kAnswer);
  CHECK(transact(make_read_identification(3, 0)) == Outcome::kAnswer);
  CHECK(transact(make_read(Function::kReadInputRegisters, 10, 1)) == Outcome::kException);
  CHECK(map.holding[4] == 9);
  CHECK(desk.client.rejected() == 0);
}
