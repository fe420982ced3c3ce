#include <random>

#include <catch2/catch.hpp>

#include "protocols/canopen/sdo_client.hpp"
#include "protocols/canopen/sdo_server.hpp"
#include "tests/protocols/canopen/test_device.hpp"

using namespace meltbench;
using namespace meltbench::canopen;
using meltbench::canopen::testing::Lines;
using meltbench::canopen::testing::show;
using Bytes = std::vector<std::uint8_t>;

namespace {

constexpr std::uint8_t kNode = 5;
constexpr ObjectAddress kBlob{0x2006, 0};

/// Client and server on a wire that may lose or change frames.
struct Pair {
  ObjectDictionary od = canopen::testing::make_dictionary();
  DictionaryObjects objects{od};
  SdoServer server{cob_id::sdo_request(kNode), cob_id::sdo_response(kNode), objects};
  SdoClient client{kNode};
  Instant now{};
  std::function<bool(can::CanFrame&)> to_server = [](can::CanFrame&) { return true; };
  std::function<bool(can::CanFrame&)> to_client = [](can::CanFrame&) { return true; };

  /// Runs until the transfer has ended, jumping to the next time-out when nothing is on the wire.
  SdoStatus run(Frames requests) {
    Frames answers;
    for (int rounds = 0; client.status() == SdoStatus::kBusy && rounds < 10000; ++rounds) {
      for (can::CanFrame frame : requests) {
        if (to_server(frame)) server.on_frame(now, frame, answers);
      }
      requests.clear();
      for (can::CanFrame frame : answers) {
        if (to_client(frame)) client.on_frame(now, frame, requests);
      }
      answers.clear();
      if (!requests.empty() || client.status() != SdoStatus::kBusy) continue;
      now = std::min(client.next_deadline(), server.next_deadline());
      server.on_time(now, answers);
      client.on_time(now, requests);
    }
    for (const can::CanFrame& frame : requests)
      server.on_frame(now, frame, answers);  // The last word of a block upload.
    return client.status();
  }
  SdoStatus download(ObjectAddress address, const Bytes& value, SdoMode mode) {
    Frames requests;
    client.start_download(now, address, value, requests, mode);
    return run(requests);
  }
  SdoStatus upload(ObjectAddress address, SdoMode mode) {
    Frames requests;
    client.start_upload(now, address, requests, mode);
    return run(requests);
  }
  Lines ask(std::initializer_list<std::uint8_t> bytes) {
    Frames answers;
    server.on_frame(now, can::make_frame(0x605, bytes), answers);
    return show(answers);
  }
  Bytes blob() const {
    const auto bytes = od.at(0x2006).bytes();
    return {bytes.begin(), bytes.end()};
  }
};

Bytes make_pattern(std::size_t size) {
  std::mt19937 random{static_cast<std::uint32_t>(size)};
  Bytes bytes(size);
  for (auto& byte : bytes) byte = static_cast<std::uint8_t>(random());
  return bytes;
}

}  // namespace

TEST_CASE("SDO: the block CRC has its published check value", "[canopen][sdo]") {
  const std::string text = "123456789";
  const Bytes bytes(text.begin(), text.end());
  CHECK(calc_crc16(bytes) == 0x31C3);
  CHECK(calc_crc16(std::span{bytes}.subspan(4), calc_crc16(std::span{bytes}.first(4))) == 0x31C3);
}

TEST_CASE("SDO server: expedited and segmented transfers are byte for byte as CiA 301 writes them", "[canopen][sdo]") {
  Pair wire;
  CHECK(wire.ask({0x23, 0x00, 0x20, 0x00, 1, 2, 3, 4}) == Lines{"585#6000200000000000"});
  CHECK(wire.ask({0x40, 0x00, 0x20, 0x00, 0, 0, 0, 0}) == Lines{"585#4300200001020304"});
  CHECK(wire.ask({0x2B, 0x05, 0x20, 0x00, 9, 0, 0, 0}) == Lines{"585#6005200000000000"});
  CHECK(wire.ask({0x40, 0x05, 0x20, 0x00, 0, 0, 0, 0}) == Lines{"585#4B05200009000000"});
  CHECK(wire.ask({0x40, 0x03, 0x20, 0x00, 0, 0, 0, 0}) == Lines{"585#4F03200042000000"});
  // Size not given: the object's own size counts.
  CHECK(wire.ask({0x22, 0x05, 0x20, 0x00, 7, 0, 0, 0}) == Lines{"585#6005200000000000"});
  CHECK(wire.od.at(0x2005).get<std::int16_t>() == 7);
  // "Test device", 11 characters.
  CHECK(wire.ask({0x40, 0x08, 0x10, 0x00, 0, 0, 0, 0}) == Lines{"585#410810000B000000"});
  CHECK(wire.ask({0x60, 0, 0, 0, 0, 0, 0, 0}) == Lines{"585#0054657374206465"});
  CHECK(wire.ask({0x70, 0, 0, 0, 0, 0, 0, 0}) == Lines{"585#1776696365000000"});
  // 8 bytes down: two segments.
  CHECK(wire.ask({0x21, 0x06, 0x20, 0x00, 8, 0, 0, 0}) == Lines{"585#6006200000000000"});
  CHECK(wire.ask({0x00, 1, 2, 3, 4, 5, 6, 7}) == Lines{"585#2000000000000000"});
  CHECK(wire.ask({0x1D, 8, 0, 0, 0, 0, 0, 0}) == Lines{"585#3000000000000000"});
  CHECK(wire.blob() == Bytes{1, 2, 3, 4, 5, 6, 7, 8});
}

TEST_CASE("SDO server: block transfers are byte for byte as CiA 301 writes them", "[canopen][sdo]") {
  Pair wire;
  CHECK(wire.ask({0xC6, 0x06, 0x20, 0x00, 9, 0, 0, 0}) == Lines{"585#A40620007F000000"});
  CHECK(wire.ask({0x01, '1', '2', '3', '4', '5', '6', '7'}).empty());
  CHECK(wire.ask({0x82, '8', '9', 0, 0, 0, 0, 0}) == Lines{"585#A2027F0000000000"});
  CHECK(wire.ask({0xD5, 0xC3, 0x31, 0, 0, 0, 0, 0}) == Lines{"585#A100000000000000"});
  CHECK(wire.blob() == Bytes{'1', '2', '3', '4', '5', '6', '7', '8', '9'});

  CHECK(wire.ask({0xA4, 0x06, 0x20, 0x00, 4, 0, 0, 0}) == Lines{"585#C606200009000000"});
  CHECK(wire.ask({0xA3, 0, 0, 0, 0, 0, 0, 0}) == Lines{"585#0131323334353637", "585#8238390000000000"});
  CHECK(wire.ask({0xA2, 2, 4, 0, 0, 0, 0, 0}) == Lines{"585#D5C3310000000000"});
  CHECK(wire.ask({0xA1, 0, 0, 0, 0, 0, 0, 0}).empty());
  CHECK(wire.server.is_idle());
  // The client allows a plain upload of up to 20 bytes, so it gets one.
  CHECK(wire.ask({0xA4, 0x06, 0x20, 0x00, 4, 20, 0, 0}) == Lines{"585#4106200009000000"});
}

TEST_CASE("SDO server: what cannot be done is answered with the right abort code", "[canopen][sdo]") {
  Pair wire;
  const auto code_of = [&](std::initializer_list<std::uint8_t> bytes) {
    const Lines answer = wire.ask(bytes);
    REQUIRE(answer.size() == 1);
    REQUIRE(answer[0].substr(0, 6) == "585#80");
    return answer[0].substr(12);
  };
  CHECK(code_of({0x40, 0xFF, 0x2F, 0, 0, 0, 0, 0}) == "00000206");        // No object.
  CHECK(code_of({0x40, 0x00, 0x10, 7, 0, 0, 0, 0}) == "11000906");        // No sub-index.
  CHECK(code_of({0x40, 0x04, 0x20, 0, 0, 0, 0, 0}) == "01000106");        // Write-only.
  CHECK(code_of({0x23, 0x00, 0x10, 0, 0, 0, 0, 0}) == "02000106");        // Read-only.
  CHECK(code_of({0x23, 0x05, 0x20, 0, 0, 0, 0, 0}) == "12000706");        // 4 bytes into an INTEGER16.
  CHECK(code_of({0x2F, 0x05, 0x20, 0, 0, 0, 0, 0}) == "13000706");        // 1 byte into an INTEGER16.
  CHECK(code_of({0x2B, 0x05, 0x20, 0, 101, 0, 0, 0}) == "31000906");      // Above the limit.
  CHECK(code_of({0x2B, 0x05, 0x20, 0, 0xF5, 0xFF, 0, 0}) == "32000906");  // -11, below it.
  CHECK(code_of({0xE0, 0, 0, 0, 0, 0, 0, 0}) == "01000405");              // Unknown command.
  CHECK(code_of({0x00, 0, 0, 0, 0, 0, 0, 0}) == "01000405");              // Segment of no transfer.
  CHECK(code_of({0x60, 0, 0, 0, 0, 0, 0, 0}) == "01000405");
  CHECK(code_of({0xA3, 0, 0, 0, 0, 0, 0, 0}) == "01000405");
  CHECK(code_of({0xC1, 0, 0, 0, 0, 0, 0, 0}) == "01000405");
  CHECK(code_of({0xA4, 0x06, 0x20, 0, 0, 0, 0, 0}) == "02000405");  // Block size 0.
  CHECK(code_of({0xA4, 0x06, 0x20, 0, 128, 0, 0, 0}) == "02000405");
  CHECK(code_of({0x21, 0x06, 0x20, 0, 1, 0, 1, 0}) == "12000706");  // 65537 bytes into a DOMAIN.
  CHECK(code_of({0xC2, 0x06, 0x20, 0, 1, 0, 1, 0}) == "12000706");

  SECTION("toggle bit") {
    wire.ask({0x21, 0x06, 0x20, 0, 20, 0, 0, 0});
    CHECK(code_of({0x10, 1, 2, 3, 4, 5, 6, 7}) == "00000305");
    wire.ask({0x40, 0x08, 0x10, 0, 0, 0, 0, 0});
    CHECK(code_of({0x70, 0, 0, 0, 0, 0, 0, 0}) == "00000305");
  }
  SECTION("fewer or more bytes than announced") {
    wire.ask({0x21, 0x06, 0x20, 0, 20, 0, 0, 0});
    CHECK(code_of({0x01, 1, 2, 3, 4, 5, 6, 7}) == "10000706");
    wire.ask({0x21, 0x06, 0x20, 0, 5, 0, 0, 0});
    CHECK(code_of({0x00, 1, 2, 3, 4, 5, 6, 7}) == "12000706");
  }
  SECTION("a block's CRC") {
    wire.ask({0xC6, 0x06, 0x20, 0, 7, 0, 0, 0});
    wire.ask({0x81, '1', '2', '3', '4', '5', '6', '7'});
    CHECK(code_of({0xC1, 0x12, 0x34, 0, 0, 0, 0, 0}) == "04000405");
    CHECK(wire.blob().empty());
  }
  SECTION("more segments acknowledged than were sent") {
    wire.od.at(0x2006).assign(make_pattern(30));
    wire.ask({0xA4, 0x06, 0x20, 0, 2, 0, 0, 0});
    wire.ask({0xA3, 0, 0, 0, 0, 0, 0, 0});
    CHECK(code_of({0xA2, 3, 2, 0, 0, 0, 0, 0}) == "03000405");
  }
}

TEST_CASE("SDO server: frames that are no SDO to this node get no answer", "[canopen][sdo]") {
  Pair wire;
  Frames out;
  wire.server.on_frame({}, can::make_frame(0x606, {0x40, 0, 0x10, 0, 0, 0, 0, 0}), out);
  wire.server.on_frame({}, can::make_frame(0x605, {0x40, 0, 0x10, 0}), out);
  wire.server.on_frame({}, can::make_frame(0x605, {0x80, 0, 0x10, 0, 0, 0, 0, 0}), out);
  can::CanFrame remote = can::make_frame(0x605, {0x40, 0, 0x10, 0, 0, 0, 0, 0});
  remote.kind = can::FrameKind::kRemote;
  wire.server.on_frame({}, remote, out);
  CHECK(out.empty());
}

TEST_CASE("SDO server: a client that falls silent is told so after the time-out", "[canopen][sdo]") {
  Pair wire;
  wire.ask({0x21, 0x06, 0x20, 0, 20, 0, 0, 0});
  CHECK(wire.server.next_deadline() == Instant{500ms});
  Frames out;
  wire.server.on_time(Instant{499ms}, out);
  CHECK(out.empty());
  wire.server.on_time(Instant{500ms}, out);
  CHECK(show(out) == Lines{"585#8006200000000405"});
  CHECK(wire.server.next_deadline() == Instant::never());
}

TEST_CASE("SDO: every size from 0 to 2000 bytes goes there and back unchanged, segmented and in blocks",
          "[canopen][sdo]") {
  const auto [down, up] =
      GENERATE(std::pair{SdoMode::kPlain, SdoMode::kBlock}, std::pair{SdoMode::kBlock, SdoMode::kPlain},
               std::pair{SdoMode::kBlock, SdoMode::kBlock});
  Pair wire;
  for (std::size_t size = 0; size <= 2000; ++size) {
    const Bytes value = make_pattern(size);
    INFO("size " << size);
    REQUIRE(wire.download(kBlob, value, down) == SdoStatus::kDone);
    REQUIRE(wire.blob() == value);
    REQUIRE(wire.upload(kBlob, up) == SdoStatus::kDone);
    REQUIRE(wire.client.result().value == value);
    REQUIRE(wire.server.is_idle());
  }
  CHECK(wire.now == Instant{});  // No time-out was needed.
}

TEST_CASE("SDO blocks: segments lost anywhere are repeated until all has come", "[canopen][sdo]") {
  const Bytes value = make_pattern(2000);
  for (unsigned seed = 1; seed <= 20; ++seed) {
    std::mt19937 random{seed};
    Pair wire;
    bool in_data = false;
    // Only data segments are lost: a lost acknowledge ends the transfer by time-out, as the protocol has it.
    const auto lose_segments = [&](can::CanFrame&) { return !in_data || random() % 10 != 0; };
    INFO("seed " << seed);

    wire.to_server = [&](can::CanFrame& frame) {
      in_data = wire.client.status() == SdoStatus::kBusy && (frame.bytes[0] & 0x7FU) >= 1 && frame.bytes[0] != 0xC6 &&
                (frame.bytes[0] & 0xE3U) != 0xC1;
      return lose_segments(frame);
    };
    REQUIRE(wire.download(kBlob, value, SdoMode::kBlock) == SdoStatus::kDone);
    REQUIRE(wire.blob() == value);

    wire.to_server = [](can::CanFrame&) { return true; };
    wire.to_client = [&](can::CanFrame& frame) {
      in_data = frame.bytes[0] != 0xC6 && (frame.bytes[0] & 0xE3U) != 0xC1;
      return lose_segments(frame);
    };
    REQUIRE(wire.upload(kBlob, SdoMode::kBlock) == SdoStatus::kDone);
    REQUIRE(wire.client.result().value == value);
  }
}

TEST_CASE("SDO blocks: a changed byte is found by the CRC, on both sides", "[canopen][sdo]") {
  Pair wire;
  const Bytes value = make_pattern(100);
  wire.to_server = [](can::CanFrame& frame) {
    if (frame.bytes[0] == 3) frame.bytes[4] ^= 0x10;
    return true;
  };
  CHECK(wire.download(kBlob, value, SdoMode::kBlock) == SdoStatus::kAborted);
  CHECK(wire.client.result().abort_code == AbortCode::kBadCrc);
  CHECK(wire.client.result().aborted_by_server);

  wire.to_server = [](can::CanFrame&) { return true; };
  REQUIRE(wire.download(kBlob, value, SdoMode::kBlock) == SdoStatus::kDone);
  wire.to_client = [](can::CanFrame& frame) {
    if (frame.bytes[0] == 3) frame.bytes[4] ^= 0x10;
    return true;
  };
  CHECK(wire.upload(kBlob, SdoMode::kBlock) == SdoStatus::kAborted);
  CHECK(wire.client.result().abort_code == AbortCode::kBadCrc);
  CHECK_FALSE(wire.client.result().aborted_by_server);
}

TEST_CASE("SDO client: no answer is a time-out with its duration, and the server is told", "[canopen][sdo]") {
  SdoClient client{kNode, 100ms};
  Frames out;
  client.start_upload(Instant{1s}, {0x1018, 1}, out);
  CHECK(show(out) == Lines{"605#4018100100000000"});
  out.clear();
  client.on_time(Instant{1099ms}, out);
  CHECK(client.status() == SdoStatus::kBusy);
  client.on_time(Instant{1100ms}, out);
  CHECK(client.status() == SdoStatus::kTimedOut);
  CHECK(client.result().took == 100ms);
  CHECK(show(out) == Lines{"605#8018100100000405"});
  CHECK(text(client.result()) == "0x1018:1: no answer within 100 ms");
}

TEST_CASE("SDO client: an answer about another object or with a wrong toggle bit ends the transfer", "[canopen][sdo]") {
  SdoClient client{kNode};
  Frames out;
  client.start_upload({}, {0x1018, 1}, out);
  client.on_frame({}, can::make_frame(0x585, {0x43, 0x18, 0x10, 0x02, 1, 0, 0, 0}), out);
  CHECK(client.status() == SdoStatus::kAborted);
  CHECK(client.result().abort_code == AbortCode::kIncompatible);

  client.start_upload({}, {0x1008, 0}, out);
  client.on_frame({}, can::make_frame(0x585, {0x41, 0x08, 0x10, 0x00, 20, 0, 0, 0}), out);
  client.on_frame({}, can::make_frame(0x585, {0x10, 1, 2, 3, 4, 5, 6, 7}), out);
  CHECK(client.result().abort_code == AbortCode::kToggle);
}

TEST_CASE("SDO client: an abort by the server is reported with its code in words", "[canopen][sdo]") {
  Pair wire;
  CHECK(wire.upload({0x3000, 0}, SdoMode::kPlain) == SdoStatus::kAborted);
  CHECK(text(wire.client.result()) == "0x3000:0: aborted by the node with 06020000, object does not exist");
}
