#include "protocols/can/candump.hpp"

#include <catch2/catch.hpp>

#include <random>

using namespace meltbench;
using namespace meltbench::can;

namespace {

/// Any frame that can exist, drawn so that every kind and every length comes up.
CanFrame random_frame(std::mt19937& draw) {
  CanFrame frame;
  const auto below = [&draw](std::uint32_t limit) { return static_cast<std::uint32_t>(draw() % limit); };
  frame.extended = below(2) == 1;
  const std::uint32_t kind = below(8);
  if (kind == 0) {
    frame.kind = FrameKind::kError;
    frame.extended = false;
    frame.id = below(kMaxExtendedId + 1);
    frame.length = 8;
  } else {
    frame.id = below((frame.extended ? kMaxExtendedId : kMaxStandardId) + 1);
    frame.kind = kind == 1 ? FrameKind::kRemote : FrameKind::kData;
    frame.fd = frame.kind == FrameKind::kData && below(2) == 1;
    frame.length = frame.fd ? round_up_to_fd_length(below(65)) : static_cast<std::uint8_t>(below(9));
    frame.brs = frame.fd && below(2) == 1;
    frame.esi = frame.fd && below(2) == 1;
    if (!frame.fd && frame.length == 8 && below(4) == 0) frame.raw_dlc = static_cast<std::uint8_t>(9 + below(7));
  }
  for (std::size_t i = 0; i < frame.data().size(); ++i) frame.bytes[i] = static_cast<std::uint8_t>(below(256));
  return frame;
}

}  // namespace

TEST_CASE("Candump text: each kind of frame has the spelling of can-utils", "[can]") {
  CanFrame extended = make_frame(0, {0x00});
  extended.extended = true;
  extended.id = 0x12345678;
  CanFrame remote;
  remote.id = 0x123;
  remote.kind = FrameKind::kRemote;
  CanFrame remote8 = remote;
  remote8.length = 8;
  CanFrame fd = make_frame(0x123, {0xAA, 0xBB});
  fd.fd = fd.brs = true;
  CanFrame error;
  error.kind = FrameKind::kError;
  error.id = 0x4;
  error.length = 8;
  CanFrame long_dlc = make_frame(0x123, {1, 2, 3, 4, 5, 6, 7, 8});
  long_dlc.raw_dlc = 11;

  CHECK(to_candump(make_frame(0x123, {0xDE, 0xAD, 0xBE, 0xEF})) == "123#DEADBEEF");
  CHECK(to_candump(make_frame(0x80, {})) == "080#");
  CHECK(to_candump(extended) == "12345678#00");
  CHECK(to_candump(remote) == "123#R");
  CHECK(to_candump(remote8) == "123#R8");
  CHECK(to_candump(fd) == "123##1AABB");
  CHECK(to_candump(error) == "20000004#0000000000000000");
  CHECK(to_candump(long_dlc) == "123#0102030405060708_B");
}

TEST_CASE("Candump text: every frame that can exist survives print and parse", "[can]") {
  std::mt19937 draw{1};
  for (int i = 0; i < 20000; ++i) {
    const CanFrame frame = random_frame(draw);
    REQUIRE(is_valid(frame));
    const auto back = parse_candump(to_candump(frame));
    INFO(to_candump(frame));
    REQUIRE(back.has_value());
    REQUIRE(*back == frame);
  }
}

TEST_CASE("Candump text: dots between bytes and lower case are read", "[can]") {
  CHECK(parse_candump("123#11.22.33") == make_frame(0x123, {0x11, 0x22, 0x33}));
  CHECK(parse_candump("7ff#de.ADbe") == make_frame(0x7FF, {0xDE, 0xAD, 0xBE}));
}

TEST_CASE("Candump text: what is not exactly one frame is refused", "[can]") {
  const char* const text =
      GENERATE("", "#", "123", "123#1", "12#00", "1234#00", "800#00", "123#112233445566778899", "123#..11",
               "123#11..22", "123#R9", "123#0102_9", "123##", "123##0112233445566778899", "A0000004#00", "123#00 ",
               "12G#00", "123#R8_8", "FFFFFFFF#00", "20000004#R");
  INFO(text);
  CHECK_FALSE(parse_candump(text).has_value());
}

TEST_CASE("Log line: time, device and frame survive print and parse", "[can]") {
  std::string line;
  append_log_line(line, Instant{1'010'000us}, "bench", make_frame(0x185, {1, 2}));
  CHECK(line == "(0000000001.010000) bench 185#0102\n");
  const ParsedLogLine parsed = parse_log_line(line);
  REQUIRE(parsed.kind == LogLineKind::kFrame);
  CHECK(parsed.line.at == Instant{1'010'000us});
  CHECK(parsed.line.device == "bench");
  CHECK(parsed.line.frame == make_frame(0x185, {1, 2}));
}

TEST_CASE("Log line: nine digits, a direction and CRLF are read", "[can]") {
  const ParsedLogLine parsed = parse_log_line("(1436509052.249713123) vcan0 044#2A366C2BBA T\r\n");
  REQUIRE(parsed.kind == LogLineKind::kFrame);
  CHECK(parsed.line.at == Instant{Nanos{1'436'509'052'249'713'123}});
  CHECK(parsed.line.frame.length == 5);
}

TEST_CASE("Log line: comments are told from damage, and damage is told with its column", "[can]") {
  CHECK(parse_log_line("# seed 1").kind == LogLineKind::kComment);
  CHECK(parse_log_line("").kind == LogLineKind::kComment);
  CHECK(parse_log_line("DROPCOUNT: dropped 3 CAN frames").kind == LogLineKind::kComment);
  const auto [text, column] = GENERATE(table<std::string, std::size_t>({{"(1.0", 1},
                                                                        {"(1.0) can0 123#", 2},
                                                                        {"(99999999999.000000) can0 123#", 2},
                                                                        {"(9999999999.000000) can0 123#", 2},
                                                                        {"(0000000001.000000)", 20},
                                                                        {"(0000000001.000000) can0", 20},
                                                                        {"(0000000001.000000)  123#", 20},
                                                                        {"(0000000001.000000) can0 12#", 26}}));
  INFO(text);
  const ParsedLogLine parsed = parse_log_line(text);
  CHECK(parsed.kind == LogLineKind::kBad);
  CHECK(parsed.column == column);
  CHECK_FALSE(parsed.complaint.empty());
}
