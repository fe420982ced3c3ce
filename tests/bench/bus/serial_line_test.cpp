#include "bench/bus/serial_line.hpp"

#include <catch2/catch.hpp>
#include <random>
#include <string>

using namespace meltbench;
using namespace meltbench::bus;

namespace {

constexpr serial::LineSettings kLine{10'000, serial::Parity::kNone, 1};  // One character takes 1 ms.

SerialLine make_line(const serial::LineSettings& settings, int ends) {
  SerialLine line{settings};
  for (int end = 0; end < ends; ++end) line.add_end();
  return line;
}

void write(SerialLine& line, Instant at, std::size_t sender, std::string_view text) {
  line.write(at, sender, {reinterpret_cast<const std::uint8_t*>(text.data()), text.size()});
}

/// What comes next: "at ms, sender, bytes"; unreadable bytes as '?'.
std::string take(SerialLine& line) {
  const LineDelivery& delivery = line.take();
  std::string text = std::to_string(delivery.at.since_start / 1ms) + " " + std::to_string(delivery.sender) + " ";
  for (const std::uint8_t byte : delivery.bytes) text += byte >= 'a' && byte <= 'z' ? static_cast<char>(byte) : '?';
  return text;
}

}  // namespace

TEST_CASE("Serial line: bytes take the time of their bits, and one piece follows the other without a gap", "[bus]") {
  SerialLine line = make_line(kLine, 2);
  CHECK(line.next_delivery() == Instant::never());
  write(line, Instant{5ms}, 0, "abc");
  write(line, Instant{6ms}, 0, "de");
  CHECK(line.next_delivery() == Instant{8ms});
  CHECK(take(line) == "8 0 abc");
  CHECK(take(line) == "10 0 de");
  CHECK(line.next_delivery() == Instant::never());
  write(line, Instant{20ms}, 1, "f");
  CHECK(take(line) == "21 1 f");
}

TEST_CASE("Serial line: where two ends send at once all hear garbage, and only there", "[bus]") {
  SerialLine line = make_line(kLine, 3);
  write(line, Instant{0ms}, 0, "abcd");
  write(line, Instant{2ms}, 1, "efgh");
  CHECK(take(line) == "4 0 ab??");
  CHECK(take(line) == "6 1 ??gh");
  SECTION("one end after the other is no collision") {
    write(line, Instant{10ms}, 0, "ab");
    write(line, Instant{12ms}, 1, "cd");
    CHECK(take(line) == "12 0 ab");
    CHECK(take(line) == "14 1 cd");
  }
  SECTION("part of a character is enough") {
    write(line, Instant{10ms}, 0, "ab");
    write(line, Instant{10ms + 1999us}, 1, "cd");
    CHECK(take(line) == "12 0 a?");
    CHECK(take(line) == "13 1 ?d");
  }
  SECTION("three ends: what is garbage stays garbage") {
    write(line, Instant{10ms}, 0, "abc");
    write(line, Instant{10ms}, 1, "def");
    write(line, Instant{10ms}, 2, "ghi");
    CHECK(take(line) == "13 0 ???");
    CHECK(take(line) == "13 1 ???");
    CHECK(take(line) == "13 2 ???");
  }
}

TEST_CASE("Serial line: an end that is unplugged is not heard, and what it was sending breaks off", "[bus]") {
  SerialLine line = make_line(kLine, 2);
  write(line, Instant{0ms}, 0, "abcd");
  line.unplug(Instant{2ms + 500us}, 0);
  CHECK_FALSE(line.is_plugged(0));
  CHECK(take(line) == "2 0 ab");
  write(line, Instant{3ms}, 0, "efgh");
  CHECK(line.next_delivery() == Instant::never());
  line.plug(0);
  write(line, Instant{4ms}, 0, "ij");
  CHECK(take(line) == "6 0 ij");
}

TEST_CASE("Serial line: a fault changes, cuts, delays or swallows what is sent", "[bus]") {
  class Fault final : public LineFault {
   public:
    Nanos strike(Instant, std::size_t, std::vector<std::uint8_t>& bytes) override {
      ++pieces;
      if (pieces == 1) bytes[0] = 0xFF;
      if (pieces == 2) bytes.resize(1);
      if (pieces == 3) return 7ms;
      if (pieces == 4) bytes.clear();
      return 0ms;
    }
    int pieces = 0;
  } fault;
  SerialLine line = make_line(kLine, 2);
  line.set_fault(&fault);
  write(line, Instant{0ms}, 0, "abc");
  CHECK(take(line) == "3 0 ?bc");
  write(line, Instant{10ms}, 0, "abc");
  CHECK(take(line) == "11 0 a");
  write(line, Instant{20ms}, 0, "abc");
  CHECK(take(line) == "30 0 abc");
  write(line, Instant{40ms}, 0, "abc");
  CHECK(line.next_delivery() == Instant::never());
  line.set_fault(nullptr);
  write(line, Instant{50ms}, 0, "abc");
  CHECK(take(line) == "53 0 abc");
}

TEST_CASE("Serial line: random traffic loses no byte, goes forward in time, and is the same again", "[bus]") {
  const auto run = [](unsigned seed) {
    std::mt19937 draw{seed};
    SerialLine line = make_line({115'200, serial::Parity::kEven, 1}, 3);
    std::vector<std::uint8_t> bytes;
    std::size_t written = 0;
    std::size_t heard = 0;
    std::string log;
    Instant now{};
    Instant last{};
    for (int i = 0; i < 3000; ++i) {
      now += Nanos{draw() % 2'000'000};
      while (line.next_delivery() <= now) {
        CHECK(line.next_delivery() >= last);
        last = line.next_delivery();
        const LineDelivery& delivery = line.take();
        heard += delivery.bytes.size();
        log.append(delivery.bytes.begin(), delivery.bytes.end());
      }
      bytes.resize(draw() % 40);
      for (std::uint8_t& byte : bytes) byte = static_cast<std::uint8_t>(draw());
      line.write(now, draw() % 3, bytes);
      written += bytes.size();
    }
    while (line.next_delivery() < Instant::never()) heard += line.take().bytes.size();
    CHECK(heard == written);
    return log;
  };
  CHECK(run(1) == run(1));
  CHECK(run(1) != run(2));
}
