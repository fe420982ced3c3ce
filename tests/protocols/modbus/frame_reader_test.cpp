#include "protocols/modbus/frame_reader.hpp"

#include <catch2/catch.hpp>

#include "tests/protocols/modbus/small_map.hpp"

using namespace meltbench;
using namespace meltbench::modbus;

namespace {

const LineTiming kTiming = make_line_timing(19'200);
using Bytes = std::vector<std::uint8_t>;

struct Reading {
  explicit Reading(Direction direction = Direction::kRequests) : reader{direction, kTiming} {}
  FrameReader reader;
  Instant now{};
  std::vector<Bytes> pdus;

  /// Bytes that follow the last ones after a gap.
  void hear(std::span<const std::uint8_t> bytes, Nanos gap = Nanos{}) {
    now += gap + kTiming.on_wire(bytes.size());
    while (!bytes.empty()) {
      bytes = bytes.subspan(reader.take(now, bytes));
      collect();
    }
  }
  void pause(Nanos silence) {
    now += silence;
    reader.on_time(now);
    collect();
  }
  void collect() {
    if (const auto frame = reader.take_frame()) pdus.emplace_back(frame->pdu.begin(), frame->pdu.end());
  }
};

const Bytes kRead = make_frame(1, make_read(Function::kReadHoldingRegisters, 0, 2));
const Bytes kUnknown = make_frame(1, Pdu{0x42, 0x01, 0x02});

}  // namespace

TEST_CASE("Frames: of a known function end by their length, without waiting for silence", "[modbus]") {
  Reading line;
  line.hear(kRead);
  REQUIRE(line.pdus.size() == 1);
  CHECK(line.pdus[0] == Bytes{3, 0, 0, 0, 2});
  CHECK(line.reader.next_deadline() == Instant::never());
  line.hear(kRead);  // A master that does not wait.
  CHECK(line.pdus.size() == 2);
}

TEST_CASE("Frames: each request and answer is found byte by byte and at once", "[modbus]") {
  const std::array<std::uint16_t, 3> words{1, 2, 3};
  const std::array<bool, 11> bits{true};
  const std::vector<std::pair<Direction, Pdu>> frames{
      {Direction::kRequests, make_read(Function::kReadCoils, 0, 9)},
      {Direction::kRequests, make_write_coil(4, true)},
      {Direction::kRequests, make_write_register(4, 7)},
      {Direction::kRequests, make_write_coils(2, bits)},
      {Direction::kRequests, make_write_registers(2, words)},
      {Direction::kRequests, make_read_write(0, 4, 2, words)},
      {Direction::kRequests, make_read_identification(1, 0)},
      {Direction::kAnswers, Pdu{1, 2, 0xFF, 0x01}},
      {Direction::kAnswers, Pdu{3, 4, 0, 1, 0, 2}},
      {Direction::kAnswers, Pdu{16, 0, 2, 0, 3}},
      {Direction::kAnswers, Pdu{23, 2, 0, 1}},
      {Direction::kAnswers, Pdu{0x83, 2}},
      {Direction::kAnswers, Pdu{43, 14, 1, 0x82, 0, 0, 2, 0, 1, 'a', 1, 2, 'b', 'c'}},
  };
  for (const auto& [direction, pdu] : frames) {
    const Bytes bytes = make_frame(9, pdu);
    CAPTURE(bytes);
    Reading whole{direction};
    whole.hear(bytes);
    CHECK(whole.pdus == std::vector<Bytes>{Bytes(pdu.bytes().begin(), pdu.bytes().end())});
    Reading single{direction};
    for (std::size_t i = 0; i + 1 < bytes.size(); ++i) single.hear(std::span{bytes}.subspan(i, 1));
    CHECK(single.pdus.empty());
    single.hear(std::span{bytes}.last(1));
    CHECK(single.pdus == whole.pdus);
  }
}

TEST_CASE("Frames: of an unknown function end by 3.5 characters of silence", "[modbus]") {
  Reading line;
  line.hear(kUnknown);
  CHECK(line.pdus.empty());
  CHECK(line.reader.next_deadline() == line.now + kTiming.t3_5);
  line.pause(kTiming.t3_5 - 1ns);
  CHECK(line.pdus.empty());
  line.pause(1ns);
  CHECK(line.pdus == std::vector<Bytes>{Bytes{0x42, 0x01, 0x02}});
}

TEST_CASE("Frames: a gap up to 3.5 characters is taken, a longer one breaks the frame off", "[modbus]") {
  Reading line;
  line.hear(std::span{kRead}.first(5));
  line.hear(std::span{kRead}.subspan(5), kTiming.t3_5);
  CHECK(line.pdus.size() == 1);
  line.hear(std::span{kRead}.first(5), 10ms);
  line.hear(std::span{kRead}.subspan(5), kTiming.t3_5 + 1ns);
  CHECK(line.pdus.size() == 1);
  CHECK(line.reader.frames_lost() == 1);
  line.hear(kRead, 10ms);
  CHECK(line.pdus.size() == 2);
}

TEST_CASE("Frames: after a wrong checksum nothing counts until the line is silent", "[modbus]") {
  Bytes wrong = kRead;
  wrong[3] ^= 1U;
  Reading line;
  line.hear(wrong);
  line.hear(kRead);
  CHECK(line.pdus.empty());
  CHECK(line.reader.frames_lost() == 1);
  line.hear(kRead, kTiming.t3_5 + 1ns);
  CHECK(line.pdus.size() == 1);
}

TEST_CASE("Frames: of every single wrong bit the checksum knows", "[modbus]") {
  for (std::size_t bit = 0; bit < 8 * kUnknown.size(); ++bit) {
    Bytes wrong = kUnknown;
    wrong[bit / 8] = static_cast<std::uint8_t>(wrong[bit / 8] ^ (1U << (bit % 8)));
    Reading line;
    line.hear(wrong);
    line.pause(10ms);
    CHECK(line.pdus.empty());
  }
}

TEST_CASE("Frames: more bytes than a frame can have are noise", "[modbus]") {
  Reading line;
  line.hear(Bytes(300, 0x42));
  line.pause(10ms);
  CHECK(line.pdus.empty());
  CHECK(line.reader.frames_lost() == 1);
  line.hear(kRead);
  CHECK(line.pdus.size() == 1);
}

TEST_CASE("Frames: bytes of a pty come faster than the wire could carry them", "[modbus]") {
  FrameReader reader{Direction::kRequests, kTiming};
  CHECK(reader.take(Instant{1us}, std::span{kRead}.first(3)) == 3);
  CHECK(reader.take(Instant{2us}, std::span{kRead}.subspan(3)) == 5);
  CHECK(reader.take_frame().has_value());
}
