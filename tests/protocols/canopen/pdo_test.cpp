#include <catch2/catch.hpp>

#include "tests/protocols/canopen/test_device.hpp"

using namespace meltbench;
using namespace meltbench::canopen;
using namespace meltbench::canopen::testing;

namespace {

/// Changes one parameter of a TPDO as the rules want it: off, write, on.
template <class T>
void reconfigure(Device& device, std::uint16_t index, std::uint8_t sub, T value) {
  const auto id = device.read<std::uint32_t>(index, 1) & 0x7FFF'FFFF;
  REQUIRE(device.write<std::uint32_t>(index, 1, id | 0x8000'0000) == AbortCode::kNone);
  REQUIRE(device.write<T>(index, sub, value) == AbortCode::kNone);
  REQUIRE(device.write<std::uint32_t>(index, 1, id) == AbortCode::kNone);
}

}  // namespace

TEST_CASE("RPDO: an event-driven one is applied at once, byte for byte as mapped", "[canopen][pdo]") {
  Device device;
  device.go_operational();
  device.notes.take();
  device.send(0x205, {0x0F, 0x00, 0xFE, 0xFF});
  CHECK(device.notes.take() == Lines{"rpdo 1"});
  CHECK(device.node.dictionary().at(0x6040).get<std::uint16_t>() == 0x0F);
  CHECK(device.node.dictionary().at(0x6042).get<std::int16_t>() == -2);
}

TEST_CASE("RPDO: a synchronous one waits for SYNC and is there before the application is told of the SYNC",
          "[canopen][pdo]") {
  Device device;
  device.go_operational();
  device.notes.take();
  const OdEntry& value = device.node.dictionary().at(0x2001);
  device.send(0x305, {0x00, 0x00, 0x20, 0x41});
  CHECK(value.get<float>() == 1.5F);
  device.sync();
  CHECK(value.get<float>() == 10.0F);
  CHECK(device.notes.take() == Lines{"rpdo 2", "sync 0", "tpdo 2"});
}

TEST_CASE("RPDO: a synchronous one after the synchronous window is left out", "[canopen][pdo]") {
  Device device;
  device.go_operational();
  REQUIRE(device.write<std::uint32_t>(0x1007, 0, 2000) == AbortCode::kNone);
  device.sync();
  device.pass(2ms);
  device.send(0x305, {0x00, 0x00, 0x20, 0x41});
  device.pass(1ms);
  device.send(0x305, {0x00, 0x00, 0xA0, 0x41});
  device.sync();
  CHECK(device.node.dictionary().at(0x2001).get<float>() == 10.0F);
}

TEST_CASE("RPDO: one that is too short is dropped and told, one that is too long is used", "[canopen][pdo]") {
  Device device;
  device.go_operational();
  device.notes.take();
  CHECK(device.send(0x205, {1, 0, 2}) == Lines{"085#1082110103040000"});
  CHECK(device.send(0x205, {1, 0, 2}).empty());
  CHECK(device.notes.take().empty());
  CHECK(device.send(0x205, {1, 0, 2, 0, 9, 9}) == Lines{"085#0000000000000000"});
  CHECK(device.notes.take() == Lines{"rpdo 1"});
}

TEST_CASE("RPDO: its event timer is a deadline from the first one on", "[canopen][pdo]") {
  Device device;
  device.go_operational();
  REQUIRE(device.write<std::uint16_t>(0x1400, 5, 30) == AbortCode::kNone);
  CHECK(device.pass(100ms).empty());
  device.send(0x205, {1, 0, 2, 0});
  device.notes.take();
  CHECK(device.pass(100ms) == Lines{"130 085#5082110100000000"});
  CHECK(device.notes.take() == Lines{"rpdo timeout 1"});
  CHECK(device.send(0x205, {1, 0, 2, 0}) == Lines{"085#0000000000000000"});
  device.nmt(NmtCommand::kEnterPreOperational);
  CHECK(device.pass(1s).empty());
}

TEST_CASE("RPDO: type numbers in the mapping leave gaps", "[canopen][pdo]") {
  Device device;
  device.go_operational();
  REQUIRE(device.write<std::uint32_t>(0x1400, 1, 0x8000'0205) == AbortCode::kNone);
  REQUIRE(device.write<std::uint8_t>(0x1600, 0, 0) == AbortCode::kNone);
  REQUIRE(device.write<std::uint32_t>(0x1600, 1, 0x0006'0010) == AbortCode::kNone);
  REQUIRE(device.write<std::uint8_t>(0x1600, 0, 2) == AbortCode::kNone);
  REQUIRE(device.write<std::uint32_t>(0x1400, 1, 0x205) == AbortCode::kNone);
  device.send(0x205, {0xAA, 0xBB, 0x05, 0x00});
  CHECK(device.node.dictionary().at(0x6042).get<std::int16_t>() == 5);
  CHECK(device.node.dictionary().at(0x6040).get<std::uint16_t>() == 0);
}

TEST_CASE("TPDO: cyclic synchronous ones come with every n-th SYNC, with the values set at that SYNC",
          "[canopen][pdo]") {
  Device device;
  device.go_operational();
  device.notes.at_sync = [&device] { device.node.dictionary().at(0x2002).set(2.0F); };
  CHECK(device.sync() == Lines{"285#0000004042"});
  REQUIRE(device.write<std::uint8_t>(0x1801, 2, 3) == AbortCode::kNone);
  CHECK(device.sync().empty());
  CHECK(device.sync().empty());
  CHECK(device.sync() == Lines{"285#0000004042"});
  CHECK(device.sync().empty());
}

TEST_CASE("TPDO: with a SYNC start value the cycle begins at that count", "[canopen][pdo]") {
  Device device;
  device.start();
  REQUIRE(device.write<std::uint8_t>(0x1019, 0, 10) == AbortCode::kNone);
  reconfigure<std::uint8_t>(device, 0x1801, 6, 4);
  REQUIRE(device.write<std::uint8_t>(0x1801, 2, 5) == AbortCode::kNone);
  device.nmt(NmtCommand::kStart);
  Lines sent_at;
  for (std::uint8_t i = 0; i < 30; ++i) {
    const auto counter = static_cast<std::uint8_t>(i % 10 + 1);
    if (!device.send(0x080, {counter}).empty()) sent_at.push_back(std::to_string(counter));
  }
  CHECK(sent_at == Lines{"4", "9", "4", "9", "4", "9"});
}

TEST_CASE("SYNC: a length that does not fit 0x1019 is told and does not count", "[canopen][sync]") {
  Device device;
  device.go_operational();
  CHECK(device.send(0x080, {1}) == Lines{"085#4082110001000000"});
  CHECK(device.sync() == Lines{"285#0000803E42", "085#0000000000000000"});
  CHECK(device.write<std::uint8_t>(0x1019, 0, 1) == AbortCode::kInvalidValue);
  CHECK(device.write<std::uint8_t>(0x1019, 0, 241) == AbortCode::kInvalidValue);
  CHECK(device.write<std::uint32_t>(0x1006, 0, 10000) == AbortCode::kNone);
  CHECK(device.write<std::uint8_t>(0x1019, 0, 2) == AbortCode::kDeviceState);
}

TEST_CASE("SYNC producer: bit 30 of 0x1005 with a period sends SYNC, and the node's own PDOs follow it",
          "[canopen][sync]") {
  Device device;
  device.go_operational();
  REQUIRE(device.write<std::uint8_t>(0x1019, 0, 3) == AbortCode::kNone);
  REQUIRE(device.write<std::uint32_t>(0x1006, 0, 5000) == AbortCode::kNone);
  REQUIRE(device.write<std::uint32_t>(0x1005, 0, 0x4000'0080) == AbortCode::kNone);
  CHECK(device.pass(10ms) == Lines{"5 080#01", "5 285#0000803E42", "10 080#02", "10 285#0000803E42"});
  CHECK(device.write<std::uint32_t>(0x1005, 0, 0x4000'0081) == AbortCode::kDeviceState);
  device.nmt(NmtCommand::kStop);
  CHECK(device.pass(10ms).empty());
  device.nmt(NmtCommand::kEnterPreOperational);
  CHECK(device.pass(5ms) == Lines{"25 080#01"});
}

TEST_CASE("TPDO: type 0 comes at the SYNC after an event", "[canopen][pdo]") {
  Device device;
  device.go_operational();
  REQUIRE(device.write<std::uint8_t>(0x1801, 2, 0) == AbortCode::kNone);
  CHECK(device.sync().empty());
  device.node.event(2);
  CHECK(device.pass(10ms).empty());
  CHECK(device.sync() == Lines{"285#0000803E42"});
  CHECK(device.sync().empty());
}

TEST_CASE("TPDO: an event-driven one comes on entering Operational and at every event", "[canopen][pdo]") {
  Device device;
  CHECK(device.go_operational() == Lines{"705#00", "185#3412"});
  device.node.event(1);
  CHECK(device.pass(1s) == Lines{"0 185#3412"});
  device.nmt(NmtCommand::kEnterPreOperational);
  device.node.event(1);
  CHECK(device.pass(1s).empty());
}

TEST_CASE("TPDO: the event timer sends after so long a pause, the inhibit time keeps them apart", "[canopen][pdo]") {
  Device device;
  device.start();
  reconfigure<std::uint16_t>(device, 0x1800, 3, 100);  // 10 ms.
  REQUIRE(device.write<std::uint16_t>(0x1800, 5, 40) == AbortCode::kNone);
  CHECK(device.nmt(NmtCommand::kStart) == Lines{"185#3412"});
  device.pass(3ms);
  device.node.event(1);
  device.node.event(1);
  CHECK(device.pass(100ms) == Lines{"10 185#3412", "50 185#3412", "90 185#3412"});
}

TEST_CASE("TPDO: a remote frame asks for an event-driven one unless bit 30 forbids it", "[canopen][pdo]") {
  Device device;
  device.go_operational();
  CHECK(device.send_remote(0x185) == Lines{"185#3412"});
  CHECK(device.send_remote(0x285).empty());
  REQUIRE(device.write<std::uint32_t>(0x1800, 1, 0x8000'0185) == AbortCode::kNone);
  REQUIRE(device.write<std::uint32_t>(0x1800, 1, 0x4000'0185) == AbortCode::kNone);
  CHECK(device.send_remote(0x185).empty());
}

TEST_CASE("PDO: an extended identifier is used both ways", "[canopen][pdo]") {
  Device device;
  device.go_operational();
  REQUIRE(device.write<std::uint32_t>(0x1400, 1, 0x8000'0205) == AbortCode::kNone);
  REQUIRE(device.write<std::uint32_t>(0x1400, 1, 0x2000'0205) == AbortCode::kNone);
  device.notes.take();
  can::CanFrame frame = can::make_frame(0x205, {1, 0, 2, 0});
  device.send(frame);
  CHECK(device.notes.take().empty());
  frame.extended = true;
  device.send(frame);
  CHECK(device.notes.take() == Lines{"rpdo 1"});
}

TEST_CASE("PDO remap: the rule of CiA 301 is needed at every step, and enough", "[canopen][pdo]") {
  Device device;
  device.go_operational();
  const auto map = [&](std::uint8_t sub, std::uint32_t entry) {
    return device.write<std::uint32_t>(0x1A01, sub, entry);
  };
  const auto set_count = [&](std::uint8_t count) { return device.write<std::uint8_t>(0x1A01, 0, count); };

  CHECK(set_count(0) == AbortCode::kDeviceState);
  CHECK(map(1, 0x6064'0020) == AbortCode::kDeviceState);
  CHECK(device.write<std::uint32_t>(0x1801, 1, 0x286) == AbortCode::kDeviceState);
  CHECK(device.write<std::uint16_t>(0x1801, 3, 5) == AbortCode::kDeviceState);

  REQUIRE(device.write<std::uint32_t>(0x1801, 1, 0x8000'0285) == AbortCode::kNone);
  CHECK_FALSE(device.node.is_tpdo_active(2));
  CHECK(device.sync().empty());
  CHECK(map(1, 0x6064'0020) == AbortCode::kDeviceState);
  REQUIRE(set_count(0) == AbortCode::kNone);
  CHECK(map(1, 0x7777'0020) == AbortCode::kNoObject);
  CHECK(map(1, 0x1018'0920) == AbortCode::kNoSubIndex);
  CHECK(map(1, 0x2000'0020) == AbortCode::kNotMappable);  // Not mappable at all.
  CHECK(map(1, 0x6042'0010) == AbortCode::kNotMappable);  // Only an RPDO may have it.
  CHECK(map(1, 0x6064'0010) == AbortCode::kNotMappable);  // 16 of its 32 bits.
  CHECK(map(1, 0x0005'0008) == AbortCode::kNotMappable);  // A gap in a TPDO.
  CHECK(map(1, 0x6064'0020) == AbortCode::kNone);
  CHECK(map(2, 0x2002'0020) == AbortCode::kNone);
  CHECK(map(3, 0x2003'0008) == AbortCode::kNone);
  CHECK(set_count(3) == AbortCode::kPdoLength);
  CHECK(set_count(4) == AbortCode::kPdoLength);
  CHECK(set_count(9) == AbortCode::kPdoLength);
  CHECK(set_count(2) == AbortCode::kNone);

  CHECK(device.write<std::uint32_t>(0x1801, 1, 0x601) == AbortCode::kInvalidValue);
  CHECK(device.write<std::uint32_t>(0x1801, 1, 0x800) == AbortCode::kInvalidValue);
  CHECK(device.write<std::uint8_t>(0x1801, 2, 252) == AbortCode::kInvalidValue);
  CHECK(device.write<std::uint8_t>(0x1801, 2, 241) == AbortCode::kInvalidValue);
  CHECK(device.write<std::uint32_t>(0x1801, 1, 0x286) == AbortCode::kNone);
  CHECK(device.sync() == Lines{"286#FEFFFFFF0000803E"});
}

TEST_CASE("PDO remap: the steps of a PdoConfiguration are accepted and do what they say", "[canopen][pdo]") {
  Device device;
  device.start();
  PdoConfiguration wanted;
  wanted.number = 3;
  wanted.id = 0x3A5;
  wanted.type = 1;
  wanted.inhibit_100us = 0;
  wanted.event_ms = 0;
  wanted.mapping = {{{0x6064, 0}, 32}, {{0x6041, 0}, 16}};
  std::vector<SdoStep> steps;
  wanted.append_steps(steps);
  CHECK(wanted.length() == 6);
  for (const SdoStep& step : steps) {
    SdoClient client{kNode};
    Frames requests;
    client.start_download(device.now, step.address, step.value, requests);
    INFO(step.purpose);
    REQUIRE(device.run(client, requests) == AbortCode::kNone);
  }
  device.nmt(NmtCommand::kStart);
  CHECK(device.sync() == Lines{"285#0000803E42", "3A5#FEFFFFFF3412"});
}
