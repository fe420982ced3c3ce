#include <random>

#include <catch2/catch.hpp>

#include "tests/protocols/canopen/test_device.hpp"

using namespace meltbench;
using namespace meltbench::canopen;
using namespace meltbench::canopen::testing;

TEST_CASE("Node: power-on is one boot-up message and Pre-operational", "[canopen][nmt]") {
  Device device;
  CHECK(device.start() == Lines{"705#00"});
  CHECK(device.node.state() == NmtState::kPreOperational);
  CHECK(device.node.next_deadline() == Instant::never());
}

TEST_CASE("Node: does nothing before power-on", "[canopen][nmt]") {
  Device device;
  CHECK(device.send(make_nmt_command(NmtCommand::kStart, 0)).empty());
  CHECK(device.send(0x605, {0x40, 0, 0x10, 0, 0, 0, 0, 0}).empty());
  CHECK(device.pass(10s).empty());
}

TEST_CASE("Node: each NMT state answers what CiA 301 lets it answer", "[canopen][nmt]") {
  Device device;
  device.start();
  const auto answers_sdo = [&] { return !device.send(0x605, {0x40, 0, 0x10, 0, 0, 0, 0, 0}).empty(); };
  const auto answers_guarding = [&] { return !device.send_remote(0x705).empty(); };
  const auto takes_rpdo = [&] {
    device.notes.take();
    device.send(0x205, {1, 0, 2, 0});
    return device.notes.take() == Lines{"rpdo 1"};
  };
  const auto sends_tpdo = [&] { return device.sync() == Lines{"285#0000803E42"}; };
  const auto hears_sync = [&] {
    device.notes.take();
    device.sync();
    const Lines notes = device.notes.take();
    return std::ranges::find(notes, "sync 0") != notes.end();
  };
  const auto sends_emcy = [&] {
    device.node.raise_emcy(0x5000, 0);
    const bool sent = device.pass(0ms) == Lines{"0 085#0050010000000000"};
    device.node.clear_emcy(0x5000);
    device.pass(0ms);
    return sent;
  };

  CHECK((answers_sdo() && answers_guarding() && hears_sync() && sends_emcy()));
  CHECK_FALSE((takes_rpdo() || sends_tpdo()));

  CHECK(device.nmt(NmtCommand::kStart) == Lines{"185#3412"});
  CHECK(device.node.state() == NmtState::kOperational);
  CHECK((answers_sdo() && answers_guarding() && hears_sync() && sends_emcy() && takes_rpdo() && sends_tpdo()));

  device.nmt(NmtCommand::kStop);
  CHECK(device.node.state() == NmtState::kStopped);
  CHECK(answers_guarding());
  CHECK_FALSE((answers_sdo() || hears_sync() || sends_emcy() || takes_rpdo() || sends_tpdo()));

  device.nmt(NmtCommand::kEnterPreOperational);
  CHECK(device.node.state() == NmtState::kPreOperational);
  CHECK(answers_sdo());
}

TEST_CASE("Node: NMT commands reach it by its own id and by 0, and no other way", "[canopen][nmt]") {
  Device device;
  device.start();
  device.nmt(NmtCommand::kStart, 6);
  device.send(0x000, {0x01});
  device.send(0x000, {0x01, 5, 0});
  device.send(0x000, {0x77, 5});
  CHECK(device.node.state() == NmtState::kPreOperational);
  device.nmt(NmtCommand::kStart, 0);
  CHECK(device.node.state() == NmtState::kOperational);
}

TEST_CASE("Node: reset communication gives back 0x1000..0x1FFF only, reset node everything", "[canopen][nmt]") {
  Device device;
  device.start();
  REQUIRE(device.write<std::uint16_t>(0x1017, 0, 100) == AbortCode::kNone);
  REQUIRE(device.write<std::uint32_t>(0x2000, 0, 99) == AbortCode::kNone);
  device.notes.take();
  CHECK(device.nmt(NmtCommand::kResetCommunication) == Lines{"705#00"});
  CHECK(device.notes.take() == Lines{"state initialising", "reset", "state pre-operational"});
  CHECK(device.read<std::uint16_t>(0x1017, 0) == 0);
  CHECK(device.read<std::uint32_t>(0x2000, 0) == 99);
  CHECK(device.pass(1s).empty());

  CHECK(device.nmt(NmtCommand::kResetNode) == Lines{"705#00"});
  CHECK(device.read<std::uint32_t>(0x2000, 0) == 7);
}

TEST_CASE("Node: 0x1F80 with bit 2 clear makes it start itself", "[canopen][nmt]") {
  for (const std::uint32_t startup : {0U, 4U}) {
    ObjectDictionary od = make_dictionary();
    od.add_number(0x1F80, 0, DataType::kUnsigned32, AccessType::kReadWrite, startup);
    Device device{std::move(od)};
    device.start();
    CHECK(device.node.state() == (startup == 0 ? NmtState::kOperational : NmtState::kPreOperational));
  }
}

TEST_CASE("Heartbeat producer: starts at once when 0x1017 is written, then keeps its period", "[canopen][heartbeat]") {
  Device device;
  device.start();
  device.pass(3ms);
  REQUIRE(device.write<std::uint16_t>(0x1017, 0, 10) == AbortCode::kNone);
  CHECK(device.others == Lines{"705#7F"});
  CHECK(device.pass(30ms) == Lines{"13 705#7F", "23 705#7F", "33 705#7F"});
  device.nmt(NmtCommand::kStop);
  CHECK(device.pass(10ms) == Lines{"43 705#04"});
  device.nmt(NmtCommand::kEnterPreOperational);
  REQUIRE(device.write<std::uint16_t>(0x1017, 0, 0) == AbortCode::kNone);
  CHECK(device.pass(1s).empty());
}

TEST_CASE("Heartbeat producer: after a reset the boot-up message counts as the first", "[canopen][heartbeat]") {
  Device device;
  device.start();
  REQUIRE(device.write<std::uint16_t>(0x1017, 0, 10) == AbortCode::kNone);
  REQUIRE(device.write(0x1010, 1, kSaveSignature) == AbortCode::kNone);
  device.pass(4ms);
  CHECK(device.nmt(NmtCommand::kResetNode) == Lines{"705#00"});
  CHECK(device.pass(20ms) == Lines{"14 705#7F", "24 705#7F"});
}

TEST_CASE("Heartbeat consumer: silence before the first heartbeat is no error, after it it is",
          "[canopen][heartbeat]") {
  Device device;
  device.go_operational();
  REQUIRE(device.write<std::uint32_t>(0x1016, 1, 9 << 16 | 50) == AbortCode::kNone);
  CHECK(device.pass(200ms).empty());
  device.notes.take();
  device.send(0x709, {0x05});
  CHECK(device.notes.take() == Lines{"node 9 first"});
  CHECK(device.pass(49ms).empty());
  device.send(0x709, {0x05});
  CHECK(device.pass(50ms) == Lines{"299 085#3081110900000000"});
  CHECK(device.node.state() == NmtState::kPreOperational);
  CHECK(device.notes.take() == Lines{"node 9 lost", "state pre-operational"});
  CHECK(device.send(0x709, {0x05}) == Lines{"085#0000000000000000"});
  CHECK(device.notes.take() == Lines{"node 9 back"});
  CHECK(device.read<std::uint8_t>(0x1001, 0) == 0);
}

TEST_CASE("Heartbeat consumer: 0x1029:1 says what a lost heartbeat does to the node", "[canopen][heartbeat]") {
  const auto [reaction, state] =
      GENERATE(std::pair{std::uint8_t{0}, NmtState::kPreOperational},
               std::pair{std::uint8_t{1}, NmtState::kOperational}, std::pair{std::uint8_t{2}, NmtState::kStopped});
  Device device;
  device.go_operational();
  REQUIRE(device.write<std::uint32_t>(0x1016, 1, 9 << 16 | 50) == AbortCode::kNone);
  REQUIRE(device.write(0x1029, 1, reaction) == AbortCode::kNone);
  device.send(0x709, {0x05});
  CHECK(device.pass(60ms) == Lines{"50 085#3081110900000000"});
  CHECK(device.node.state() == state);
}

TEST_CASE("Heartbeat consumer: two nodes have two time-outs; the same node twice is refused", "[canopen][heartbeat]") {
  Device device;
  device.go_operational();
  REQUIRE(device.write<std::uint32_t>(0x1016, 1, 9 << 16 | 50) == AbortCode::kNone);
  CHECK(device.write<std::uint32_t>(0x1016, 2, 9 << 16 | 70) == AbortCode::kIncompatible);
  CHECK(device.write<std::uint32_t>(0x1016, 2, 10 << 16 | 70) == AbortCode::kNone);
  device.send(0x709, {0x05});
  device.send(0x70A, {0x05});
  CHECK(device.pass(100ms) == Lines{"50 085#3081110900000000", "70 085#3081110A00000000"});
  CHECK(device.send(0x70A, {0x05}) == Lines{"085#0000110000000000"});
  CHECK(device.send(0x709, {0x05}) == Lines{"085#0000000000000000"});
}

TEST_CASE("Heartbeat consumer: a boot-up message of the other node is told as such", "[canopen][heartbeat]") {
  Device device;
  device.start();
  REQUIRE(device.write<std::uint32_t>(0x1016, 1, 9 << 16 | 50) == AbortCode::kNone);
  device.send(0x709, {0x05});
  device.notes.take();
  device.send(0x709, {0x00});
  device.send(0x709, {0x7F});
  device.send(0x709, {0x7F});
  CHECK(device.notes.take() == Lines{"node 9 boot-up", "node 9 state"});
}

TEST_CASE("Node guarding: answers the remote frame with an alternating bit unless a heartbeat is on", "[canopen]") {
  Device device;
  device.start();
  CHECK(device.send_remote(0x705) == Lines{"705#7F"});
  CHECK(device.send_remote(0x705) == Lines{"705#FF"});
  CHECK(device.send_remote(0x705) == Lines{"705#7F"});
  REQUIRE(device.write<std::uint16_t>(0x100C, 0, 20) == AbortCode::kNone);
  REQUIRE(device.write<std::uint8_t>(0x100D, 0, 3) == AbortCode::kNone);
  CHECK(device.pass(100ms).empty());  // Life guarding begins with the first poll.
  device.send_remote(0x705);
  CHECK(device.pass(100ms) == Lines{"160 085#3081110000000000"});
  CHECK(device.send_remote(0x705) == Lines{"705#7F", "085#0000000000000000"});
  device.nmt(NmtCommand::kResetCommunication);
  CHECK(device.send_remote(0x705) == Lines{"705#7F"});
  REQUIRE(device.write<std::uint16_t>(0x1017, 0, 10) == AbortCode::kNone);
  CHECK(device.send_remote(0x705).empty());
}

TEST_CASE("EMCY: an error is told once when it comes and once when it is over", "[canopen][emcy]") {
  Device device;
  device.start();
  device.node.raise_emcy(0x4210, error_register::kTemperature, {1, 2, 3, 4, 5});
  CHECK(device.pass(0ms) == Lines{"0 085#1042090102030405"});
  device.node.raise_emcy(0x4210, error_register::kTemperature, {1, 2, 3, 4, 5});
  CHECK(device.pass(0ms).empty());
  CHECK(device.read<std::uint8_t>(0x1001, 0) == 0x09);
  device.node.raise_emcy(0xFF01, error_register::kManufacturer);
  CHECK(device.pass(0ms) == Lines{"0 085#01FF890000000000"});
  device.node.clear_emcy(0x4210);
  CHECK(device.pass(0ms) == Lines{"0 085#0000810000000000"});
  device.node.clear_emcy(0xFF01);
  CHECK(device.pass(0ms) == Lines{"0 085#0000000000000000"});
  device.node.clear_emcy(0xFF01);
  CHECK(device.pass(0ms).empty());
}

TEST_CASE("EMCY: the history has the newest error first and ends at its depth", "[canopen][emcy]") {
  Device device;
  device.start();
  CHECK(device.read<std::uint8_t>(0x1003, 0) == 0);
  device.read<std::uint32_t>(0x1003, 1);
  CHECK(device.last_code == AbortCode::kNoData);
  for (std::uint16_t i = 1; i <= 6; ++i) {
    device.node.raise_emcy(static_cast<std::uint16_t>(0xFF00 + i), 0, {static_cast<std::uint8_t>(0x10 * i), 0x77});
  }
  CHECK(device.read<std::uint8_t>(0x1003, 0) == 4);
  CHECK(device.read<std::uint32_t>(0x1003, 1) == 0x7760FF06);
  CHECK(device.read<std::uint32_t>(0x1003, 4) == 0x7730FF03);
  CHECK(device.write<std::uint8_t>(0x1003, 0, 1) == AbortCode::kInvalidValue);
  CHECK(device.write<std::uint8_t>(0x1003, 0, 0) == AbortCode::kNone);
  CHECK(device.read<std::uint8_t>(0x1003, 0) == 0);
  CHECK(device.read<std::uint8_t>(0x1001, 0) == 1);  // The errors are still there.
}

TEST_CASE("EMCY: the inhibit time spaces the messages, none is lost", "[canopen][emcy]") {
  Device device;
  device.start();
  REQUIRE(device.write<std::uint16_t>(0x1015, 0, 15000) == AbortCode::kNone);  // 1.5 s.
  device.node.raise_emcy(0x1000, 0);
  device.node.clear_emcy(0x1000);
  device.node.raise_emcy(0x2000, 0);
  CHECK(device.pass(4s) == Lines{"0 085#0010010000000000", "1500 085#0000000000000000", "3000 085#0020010000000000"});
}

TEST_CASE("EMCY: what happens in Stopped is told on leaving it", "[canopen][emcy]") {
  Device device;
  device.start();
  device.nmt(NmtCommand::kStop);
  device.node.raise_emcy(0x1000, 0);
  CHECK(device.pass(1s).empty());
  CHECK(device.nmt(NmtCommand::kEnterPreOperational) == Lines{"085#0010010000000000"});
}

TEST_CASE("EMCY: the COB-ID can be moved when it is switched off first, and stays off while bit 31 is set",
          "[canopen][emcy]") {
  Device device;
  device.start();
  CHECK(device.write<std::uint32_t>(0x1014, 0, 0x681) == AbortCode::kInvalidValue);
  CHECK(device.write<std::uint32_t>(0x1014, 0, 0x8000'0085) == AbortCode::kNone);
  device.node.raise_emcy(0x1000, 0);
  CHECK(device.pass(1s).empty());
  CHECK(device.write<std::uint32_t>(0x1014, 0, 0x605) == AbortCode::kInvalidValue);
  CHECK(device.write<std::uint32_t>(0x1014, 0, 0x681) == AbortCode::kNone);
  device.node.clear_emcy(0x1000);
  CHECK(device.pass(0ms) == Lines{"1000 681#0000000000000000"});
}

TEST_CASE("EMCY consumer: reads the predefined identifiers and says the class of the error", "[canopen][emcy]") {
  const auto received = parse_emcy(can::make_frame(0x085, {0x30, 0x81, 0x11, 9, 0, 0, 0, 0}));
  REQUIRE(received);
  CHECK(received->node == 5);
  CHECK(received->emcy == Emcy{0x8130, 0x11, {9, 0, 0, 0, 0}});
  CHECK(emcy_text(received->emcy.code) == "life guard or heartbeat error");
  CHECK(emcy_text(0x4210) == "device temperature");
  CHECK_FALSE(parse_emcy(can::make_frame(0x080, {0, 0, 0, 0, 0, 0, 0, 0})));
  CHECK_FALSE(parse_emcy(can::make_frame(0x085, {0, 0})));
  CHECK_FALSE(parse_emcy(can::make_frame(0x105, {0, 0, 0, 0, 0, 0, 0, 0})));
}

TEST_CASE("Store: saved values survive power-off as an image, others do not", "[canopen][store]") {
  std::vector<std::uint8_t> image;
  {
    Device device;
    device.start();
    REQUIRE(device.write<std::uint32_t>(0x2000, 0, 1234) == AbortCode::kNone);
    REQUIRE(device.write<std::uint16_t>(0x1017, 0, 50) == AbortCode::kNone);
    CHECK(device.write<std::uint32_t>(0x1010, 1, 0x12345678) == AbortCode::kCannotStore);
    device.notes.take();
    CHECK(device.write(0x1010, 4, kSaveSignature) == AbortCode::kNone);  // Manufacturer objects only.
    CHECK(device.notes.take() == Lines{"stored"});
    CHECK(device.read<std::uint32_t>(0x1010, 4) == 1);
    image = device.node.parameters().to_image();
  }
  Device device;
  REQUIRE(device.node.parameters().load_image(image));
  device.start();
  CHECK(device.read<std::uint32_t>(0x2000, 0) == 1234);
  CHECK(device.read<std::uint16_t>(0x1017, 0) == 0);
}

TEST_CASE("Store: restored defaults take effect with the next reset", "[canopen][store]") {
  Device device;
  device.start();
  REQUIRE(device.write<std::uint32_t>(0x2000, 0, 1234) == AbortCode::kNone);
  REQUIRE(device.write(0x1010, 1, kSaveSignature) == AbortCode::kNone);
  REQUIRE(device.write<std::uint32_t>(0x2000, 0, 5) == AbortCode::kNone);
  device.nmt(NmtCommand::kResetNode);
  CHECK(device.read<std::uint32_t>(0x2000, 0) == 1234);
  CHECK(device.write<std::uint32_t>(0x1011, 1, kSaveSignature) == AbortCode::kCannotStore);
  CHECK(device.write(0x1011, 1, kLoadSignature) == AbortCode::kNone);
  CHECK(device.read<std::uint32_t>(0x2000, 0) == 1234);
  device.nmt(NmtCommand::kResetNode);
  CHECK(device.read<std::uint32_t>(0x2000, 0) == 7);
}

TEST_CASE("Store: a torn or foreign image is refused as a whole", "[canopen][store]") {
  const ObjectDictionary od = make_dictionary();
  ParameterStore store;
  store.save(od, ParameterGroup::kAll);
  const std::vector<std::uint8_t> image = store.to_image();
  ParameterStore other;
  CHECK(other.load_image(image));
  CHECK(other.to_image() == image);
  for (std::size_t size = 0; size < image.size(); ++size) CHECK_FALSE(other.load_image(std::span{image}.first(size)));
  for (std::size_t at = 0; at < image.size(); ++at) {
    std::vector<std::uint8_t> changed = image;
    changed[at] ^= 0x01;
    CHECK_FALSE(other.load_image(changed));
  }
}

TEST_CASE("Node: the application may refuse a write, and refresh a value before it is read", "[canopen][sdo]") {
  Device device;
  device.start();
  device.notes.refuse = [](const OdEntry& entry, std::span<const std::uint8_t>) {
    return entry.address().index == 0x2000 ? AbortCode::kLocalControl : AbortCode::kNone;
  };
  device.notes.refresh = [](OdEntry& entry) {
    if (entry.address().index == 0x6064) entry.set<std::int32_t>(77);
  };
  CHECK(device.write<std::uint32_t>(0x2000, 0, 1) == AbortCode::kLocalControl);
  CHECK(device.read<std::uint32_t>(0x2000, 0) == 7);
  CHECK(device.read<std::int32_t>(0x6064, 0) == 77);
  device.notes.take();
  CHECK(device.write<std::uint32_t>(0x6065, 0, 1) == AbortCode::kNone);
  CHECK(device.notes.take() == Lines{"written 0x6065:0"});
}

TEST_CASE("Node: a dictionary whose PDOs do not fit together is refused with the PDO's index", "[canopen]") {
  ObjectDictionary od = make_dictionary();
  od.at(0x1A00, 1).set<std::uint32_t>(0x9999'0010);
  CHECK_THROWS_WITH(Node(std::move(od), 5), Catch::Contains("0x1800") && Catch::Contains("object does not exist"));
  CHECK_THROWS_WITH(Node(make_dictionary(), 128), Catch::Contains("128"));
}

TEST_CASE("Node: any frames at any times leave it alive and answering", "[canopen][robustness]") {
  for (unsigned seed = 1; seed <= 20; ++seed) {
    std::mt19937 random{seed};
    Device device;
    device.start();
    Frames out;
    constexpr std::array<std::uint32_t, 8> kIds{0x000, 0x080, 0x605, 0x605, 0x205, 0x305, 0x705, 0x185};
    constexpr std::array<std::uint16_t, 16> kIndices{0x1003, 0x1005, 0x1006, 0x1010, 0x1011, 0x1014, 0x1016, 0x1017,
                                                     0x1019, 0x1400, 0x1600, 0x1800, 0x1801, 0x1A00, 0x1A01, 0x2006};
    for (int i = 0; i < 5000; ++i) {
      can::CanFrame frame;
      frame.id = random() % 8 == 0 ? random() & 0x7FFU : kIds[random() % kIds.size()];
      frame.length = random() % 2 == 0 ? 8 : static_cast<std::uint8_t>(random() % 9);
      frame.extended = random() % 64 == 0;
      if (random() % 16 == 0) frame.kind = can::FrameKind::kRemote;
      for (std::uint8_t byte = 0; byte < frame.length; ++byte) frame.bytes[byte] = static_cast<std::uint8_t>(random());
      if (frame.id == 0x605 && random() % 2 == 0) {
        store(std::span{frame.bytes}, 1, kIndices[random() % kIndices.size()]);
        frame.bytes[3] = static_cast<std::uint8_t>(random() % 4);
        if (random() % 2 == 0) frame.bytes[0] = static_cast<std::uint8_t>(0x23 | random() % 4 << 2);
      }
      if (frame.id == 0x000 && random() % 2 == 0) frame.bytes = {static_cast<std::uint8_t>(random() % 2 + 1), 5};
      out.clear();
      device.node.on_frame(device.now, frame, out);
      device.now += Nanos{random() % 20'000'000};
      device.node.on_time(device.now, out);
      REQUIRE(std::ranges::all_of(out, can::is_valid));
      REQUIRE(device.node.next_deadline() > device.now);
    }
    CHECK(device.nmt(NmtCommand::kResetNode).front() == "705#00");
    CHECK(device.read<std::uint32_t>(0x1000, 0) == 0x00020194);
  }
}
