#include "protocols/modbus/rtu_server.hpp"

#include <catch2/catch.hpp>
#include <string>

#include "tests/protocols/modbus/small_map.hpp"

using namespace meltbench;
using namespace meltbench::modbus;

namespace {

using Bytes = std::vector<std::uint8_t>;
const LineTiming kTiming = make_line_timing(115'200);

Bytes ask(SmallMap& map, const Pdu& request) {
  const Pdu answer = execute(Instant{}, request.bytes(), map);
  return {answer.bytes().begin(), answer.bytes().end()};
}
Bytes refused(std::uint8_t function, int code) {
  return {static_cast<std::uint8_t>(function | 0x80U), static_cast<std::uint8_t>(code)};
}

struct Line {
  Line() { server.add(1, first), server.add(2, second, 5ms); }
  SmallMap first, second;
  RtuServer server{kTiming};
  Instant now{};
  Bytes sent;

  void hear(const Bytes& bytes) {
    now += kTiming.on_wire(bytes.size());
    server.on_bytes(now, bytes);
    server.on_time(now, sent);
  }
  void run_to(Instant to) {
    for (; server.next_deadline() <= to; server.on_time(now, sent)) now = std::max(now, server.next_deadline());
    now = to;
  }
};

}  // namespace

TEST_CASE("Server: every function does what it says", "[modbus]") {
  SmallMap map;
  CHECK(ask(map, make_write_coil(3, true)) == Bytes{5, 0, 3, 0xFF, 0});
  CHECK(ask(map, make_write_coils(4, std::array{true, false, true, true, false, true})) == Bytes{15, 0, 4, 0, 6});
  CHECK(ask(map, make_read(Function::kReadCoils, 0, 10)) == Bytes{1, 2, 0b1101'1000, 0b10});
  map.inputs[1] = true;
  CHECK(ask(map, make_read(Function::kReadDiscreteInputs, 1, 1)) == Bytes{2, 1, 1});
  CHECK(ask(map, make_write_register(2, 0x1234)) == Bytes{6, 0, 2, 0x12, 0x34});
  CHECK(ask(map, make_write_registers(3, std::array<std::uint16_t, 2>{0xABCD, 7})) == Bytes{16, 0, 3, 0, 2});
  CHECK(ask(map, make_read(Function::kReadHoldingRegisters, 2, 3)) == Bytes{3, 6, 0x12, 0x34, 0xAB, 0xCD, 0, 7});
  map.input_registers[9] = 0xFFFF;
  CHECK(ask(map, make_read(Function::kReadInputRegisters, 9, 1)) == Bytes{4, 2, 0xFF, 0xFF});
  // Writes before it reads.
  CHECK(ask(map, make_read_write(2, 2, 2, std::array<std::uint16_t, 1>{0x5678})) ==
        Bytes{23, 4, 0x56, 0x78, 0xAB, 0xCD});
}

TEST_CASE("Server: refuses in the order function, quantity, address, execution", "[modbus]") {
  SmallMap map;
  map.refuses = ExceptionCode::kDeviceFailure;
  CHECK(ask(map, Pdu{0x42, 1}) == refused(0x42, 1));
  const auto read = [&](Function function, std::uint16_t first, std::uint16_t count) {
    return ask(map, make_read(function, first, count));
  };
  CHECK(read(Function::kReadHoldingRegisters, 99, 126) == refused(3, 3));  // Wrong in all three ways.
  CHECK(read(Function::kReadHoldingRegisters, 0, 0) == refused(3, 3));
  CHECK(read(Function::kReadHoldingRegisters, 9, 2) == refused(3, 2));
  CHECK(read(Function::kReadHoldingRegisters, 0xFFFF, 2) == refused(3, 2));  // Past the last address there is.
  CHECK(read(Function::kReadHoldingRegisters, 9, 1) == refused(3, 4));
  CHECK(read(Function::kReadInputRegisters, 0, 126) == refused(4, 3));
  CHECK(read(Function::kReadCoils, 0, 2001) == refused(1, 3));
  CHECK(read(Function::kReadCoils, 0, 2000) == refused(1, 2));
  CHECK(read(Function::kReadDiscreteInputs, 0, 10) == refused(2, 4));
  CHECK(read(Function::kWriteCoil, 99, 0x1234) == refused(5, 3));  // Neither FF00 nor 0000.
  CHECK(read(Function::kWriteCoil, 99, 0xFF00) == refused(5, 2));
  CHECK(read(Function::kWriteRegister, SmallMap::kReadOnly, 1) == refused(6, 2));
  CHECK(ask(map, make_write_registers(0, std::array<std::uint16_t, 1>{1})) == refused(16, 4));
  CHECK(ask(map, Pdu{16, 0, 0, 0, 2, 2, 0, 1}) == refused(16, 3));  // Two registers in two bytes.
  CHECK(ask(map, Pdu{16, 0, 0, 0, 0, 0}) == refused(16, 3));
  CHECK(ask(map, Pdu{15, 0, 0, 0, 9, 1, 1}) == refused(15, 3));
  CHECK(ask(map, Pdu{15, 0, 5, 0, 9, 2, 1, 1}) == refused(15, 2));
  CHECK(ask(map, Pdu{23, 0, 0, 0, 1, 0, 0, 0, 2, 2, 0, 1}) == refused(23, 3));
  map.refuses = ExceptionCode::kBusy;
  CHECK(ask(map, make_write_coil(0, true)) == refused(5, 6));
  map.knows_all = false;
  CHECK(ask(map, make_write_coil(99, true)) == refused(5, 1));
  CHECK(map.writes == 0);
}

TEST_CASE("Server: function 23 writes nothing if it may not read", "[modbus]") {
  SmallMap map;
  CHECK(ask(map, make_read_write(10, 1, 0, std::array<std::uint16_t, 1>{1})) == refused(23, 2));
  CHECK(ask(map, make_read_write(0, 1, 9, std::array<std::uint16_t, 1>{1})) == refused(23, 2));
  CHECK(map.writes == 0);
}

TEST_CASE("Server: says who it is, in one answer or in several", "[modbus]") {
  SmallMap map;
  const Bytes basic = ask(map, make_read_identification(1, 0));
  CHECK(Bytes(basic.begin(), basic.begin() + 7) == Bytes{43, 14, 1, 0x82, 0, 0, 3});
  CHECK(find_identification(basic, 0) == "Desk");
  CHECK(find_identification(basic, 2) == "1.0");
  CHECK(find_identification(ask(map, make_read_identification(4, 1)), 1) == "D-10");
  CHECK(find_identification(ask(map, make_read_identification(1, 77)), 0) == "Desk");  // A stream begins anew.
  CHECK(ask(map, make_read_identification(4, 3)) == refused(43, 2));
  CHECK(ask(map, make_read_identification(5, 0)) == refused(43, 3));
  CHECK(ask(map, Pdu{43, 13, 0, 0}) == refused(43, 1));  // CANopen general reference: not spoken here.

  const std::string much(200, 'x');
  map.objects.push_back(much);
  map.objects.push_back(much);
  const Bytes one = ask(map, make_read_identification(2, 0));
  CHECK(one[4] == 0xFF);  // More,
  CHECK(one[5] == 4);     // from this one on.
  CHECK(one[6] == 4);
  const Bytes rest = ask(map, make_read_identification(2, one[5]));
  CHECK(rest[4] == 0);
  CHECK(find_identification(rest, 4) == much);
}

TEST_CASE("Server: answers one answer delay after the request, at least 3.5 characters", "[modbus]") {
  Line line;
  line.hear(make_frame(1, make_read(Function::kReadCoils, 0, 1)));
  const Instant asked = line.now;
  line.run_to(asked + kTiming.t3_5 - 1ns);
  CHECK(line.sent.empty());
  line.run_to(asked + kTiming.t3_5);
  CHECK(line.sent == make_frame(1, Pdu{1, 1, 0}));
  line.hear(make_frame(2, make_read(Function::kReadCoils, 0, 1)));
  CHECK(line.server.next_deadline() == line.now + 5ms);
}

TEST_CASE("Server: is silent to other units, to broken frames and to requests that are cut off", "[modbus]") {
  Line line;
  line.hear(make_frame(3, make_write_coil(0, true)));
  Bytes broken = make_frame(1, make_write_coil(0, true));
  broken.back() ^= 1U;
  line.hear(broken);
  line.run_to(line.now + 10ms);
  line.hear(make_frame(1, Pdu{43}));
  line.run_to(line.now + 1s);
  CHECK(line.sent.empty());
  CHECK(line.first.writes == 0);
  CHECK(line.server.frames_lost() == 1);
}

TEST_CASE("Server: a request that is cut off leaves the answer alone that is to come", "[modbus]") {
  Line line;
  Bytes request, cut;
  append_frame(2, make_read(Function::kReadHoldingRegisters, 0, 1).bytes(), request);
  append_frame(1, std::array<std::uint8_t, 1>{15}, cut);  // Function 15, and no word of what to write.
  line.hear(request);
  line.run_to(line.now + 2ms);  // The answer comes after 5 ms.
  line.hear(cut);
  line.run_to(line.now + 10ms);
  CHECK(line.sent.size() == 7);
}

TEST_CASE("Server: a broadcast is done by all units and answered by none", "[modbus]") {
  Line line;
  line.hear(make_frame(kBroadcast, make_write_register(1, 42)));
  line.hear(make_frame(kBroadcast, make_read(Function::kReadCoils, 0, 1)));  // Means nothing.
  line.run_to(line.now + 1s);
  CHECK(line.sent.empty());
  CHECK(line.first.holding[1] == 42);
  CHECK(line.second.holding[1] == 42);
}

TEST_CASE("Server: an unknown function is refused when silence has ended the frame", "[modbus]") {
  Line line;
  line.hear(make_frame(1, Pdu{7}));
  line.run_to(line.now + 2 * kTiming.t3_5);
  CHECK(line.sent == make_frame(1, Pdu{0x87, 1}));
  CHECK(line.server.exceptions() == 1);
}

TEST_CASE("Server: a unit without power hears and says nothing, and may be later than it is", "[modbus]") {
  Line line;
  line.hear(make_frame(2, make_read(Function::kReadCoils, 0, 1)));
  line.server.set_present(2, false);  // Before its answer has left.
  line.run_to(line.now + 1s);
  line.hear(make_frame(2, make_write_coil(0, true)));
  line.run_to(line.now + 1s);
  line.hear(make_frame(0, make_write_coil(0, true)));
  line.run_to(line.now + 1s);
  CHECK(line.sent.empty());
  CHECK(line.second.writes == 0);
  CHECK(line.first.writes == 1);
  line.server.set_present(2, true);
  line.server.set_extra_delay(2, 30ms);
  line.hear(make_frame(2, make_read(Function::kReadCoils, 0, 1)));
  CHECK(line.server.next_deadline() == line.now + 35ms);
}
