#include "protocols/can/slcan.hpp"

#include <catch2/catch.hpp>
#include <random>
#include <vector>

using namespace meltbench;
using namespace meltbench::can;

namespace {

std::string text_of(const CanFrame& frame) {
  std::string text;
  append_slcan(text, frame);
  return text;
}

std::span<const std::uint8_t> bytes_of(std::string_view text) {
  return {reinterpret_cast<const std::uint8_t*>(text.data()), text.size()};
}

std::vector<std::string> lines_of(SlcanLines& lines, std::string_view text) {
  lines.feed(bytes_of(text));
  std::vector<std::string> all;
  while (const auto line = lines.next()) all.emplace_back(*line);
  return all;
}

/// Any frame that slcan can say.
CanFrame draw_frame(std::mt19937& draw) {
  CanFrame frame;
  frame.extended = draw() % 2 == 0;
  frame.id = static_cast<std::uint32_t>(draw()) & (frame.extended ? kMaxExtendedId : kMaxStandardId);
  frame.fd = draw() % 3 == 0;
  frame.brs = frame.fd && draw() % 2 == 0;
  if (!frame.fd && draw() % 4 == 0) frame.kind = FrameKind::kRemote;
  frame.length = frame.fd ? from_fd_dlc(draw() % 16) : static_cast<std::uint8_t>(draw() % (kMaxClassicLength + 1));
  for (std::size_t i = 0; i < frame.data().size(); ++i) frame.bytes[i] = static_cast<std::uint8_t>(draw());
  return frame;
}

}  // namespace

TEST_CASE("slcan: each kind of frame has its letter", "[can]") {
  CanFrame frame = make_frame(0x123, {0xDE, 0xAD});
  CHECK(text_of(frame) == "t1232DEAD\r");
  frame.extended = true;
  CHECK(text_of(frame) == "T000001232DEAD\r");
  frame.fd = true;
  CHECK(text_of(frame) == "D000001232DEAD\r");
  frame.brs = true;
  frame.extended = false;
  CHECK(text_of(frame) == "b1232DEAD\r");
  frame.length = 12;
  CHECK(text_of(frame) == "b1239DEAD00000000000000000000\r");
  CanFrame remote = make_frame(0x7FF, {});
  remote.kind = FrameKind::kRemote;
  remote.length = 8;
  CHECK(text_of(remote) == "r7FF8\r");
}

TEST_CASE("slcan: an error frame has no text", "[can]") {
  CanFrame frame;
  frame.kind = FrameKind::kError;
  frame.length = 8;
  std::string text = "before";
  CHECK_FALSE(append_slcan(text, frame));
  CHECK(text == "before");
}

TEST_CASE("slcan: any frame reads back as it was written, whole or in pieces", "[can]") {
  std::mt19937 draw{4};
  std::string text;
  std::vector<CanFrame> sent;
  for (int i = 0; i < 5000; ++i) {
    sent.push_back(draw_frame(draw));
    REQUIRE(append_slcan(text, sent.back()));
  }
  SlcanLines lines;
  std::vector<CanFrame> read;
  for (std::size_t at = 0; at < text.size();) {
    const std::size_t size = std::min<std::size_t>(1 + draw() % 300, text.size() - at);
    lines.feed(bytes_of(std::string_view{text}.substr(at, size)));
    while (const auto line = lines.next()) read.push_back(parse_slcan(*line).value().frame);
    at += size;
  }
  CHECK(read == sent);
}

TEST_CASE("slcan: stamps behind the data are read, lower-case digits too", "[can]") {
  const auto stamped = parse_slcan("t1ab2deadEA5F");
  REQUIRE(stamped.has_value());
  CHECK(stamped->frame == make_frame(0x1AB, {0xDE, 0xAD}));
  CHECK(stamped->stamp == 59999);
  CHECK(parse_slcan("r1238000A")->stamp == 10);
  CHECK(parse_slcan("t123000000010")->stamp == 16);
  CHECK_FALSE(parse_slcan("t1230")->stamp.has_value());
}

TEST_CASE("slcan: a line that is no whole frame is none", "[can]") {
  for (const char* line : {"",        "z",        "Z",           "t",     "t12",      "t123",        "t1239",
                           "t123200", "t1232001", "t12320011FF", "t12g0", "t123100x", "T2000000000", "T1234567",
                           "d123G",   "dFFF0",    "t8000",       "V1013", "F00",      "x1230",       "t123000g0"}) {
    INFO(line);
    CHECK_FALSE(parse_slcan(line).has_value());
  }
}

TEST_CASE("slcan: lines end with a carriage return, a BEL is a line of its own, line feeds do not count", "[can]") {
  SlcanLines lines;
  CHECK(lines_of(lines, "\rz\rt12").size() == 2);
  CHECK(lines_of(lines, "30\r\aF00\r\n\n\a") == std::vector<std::string>{"t1230", "\a", "F00", "\a"});
  CHECK(lines_of(lines, "V10\a") == std::vector<std::string>{"V10", "\a"});
  CHECK(lines.dropped() == 0);
}

TEST_CASE("slcan: garbage without an end is dropped and counted, and what follows is read", "[can]") {
  SlcanLines lines;
  for (int i = 0; i < 100; ++i) CHECK(lines_of(lines, std::string(100, 'x')).empty());
  CHECK(lines_of(lines, "t1230\rt1240\r") == std::vector<std::string>{"t1240"});  // The first ends the garbage.
  CHECK(lines.dropped() == 1);
  CHECK(lines_of(lines, std::string(SlcanLines::kMaxLine + 1, 'x') + "\rt1240\r") == std::vector<std::string>{"t1240"});
  CHECK(lines.dropped() == 2);
  lines.feed(bytes_of("t12"));
  lines.clear();
  CHECK(lines_of(lines, "t1230\r") == std::vector<std::string>{"t1230"});
}

TEST_CASE("slcan: bit rates have one digit each", "[can]") {
  CHECK(slcan_bit_rate_digit(500'000) == '6');
  CHECK(slcan_bit_rate_digit(1'000'000) == '8');
  CHECK_FALSE(slcan_bit_rate_digit(123).has_value());
  CHECK(slcan_bit_rate_digit(10'000) == '0');
}
