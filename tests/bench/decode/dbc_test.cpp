#include "bench/decode/dbc.hpp"

#include <catch2/catch.hpp>
#include <string>

#include "bench/decode/story.hpp"
#include "protocols/config/toml.hpp"

using namespace meltbench;
using namespace meltbench::decode;

namespace {

Dbc read_motor() {
  const std::string file = std::string{MELTBENCH_SOURCE_DIR} + "/tests/fuzz/corpus/dbc/motor.dbc";
  return read_dbc(config::read_text_file(file), "motor.dbc");
}

/// A signal of a message of 8 bytes, by what stands behind "SG_ S :"; `more` follows it.
std::string describe(const std::string& layout, std::initializer_list<std::uint8_t> data,
                     const std::string& more = "") {
  const Dbc dbc = read_dbc("BO_ 291 A: 8 X\n SG_ S : " + layout + " X\n" + more, "one.dbc");
  const can::CanFrame frame = can::make_frame(291, data);
  return describe_message(*dbc.find(frame), frame.data());
}

/// What is wrong with a text; empty if nothing is.
std::string complaint(const std::string& text) {
  try {
    static_cast<void>(read_dbc(text, "a.dbc"));
  } catch (const config::ConfigError& error) {
    return error.what();
  }
  return {};
}

}  // namespace

// Worked out by hand. A5 3C is 1010 0101 0011 1100.
TEST_CASE("Bits of both byte orders are where the format says", "[decode]") {
  const std::initializer_list<std::uint8_t> data = {0xA5, 0x3C, 0, 0, 0, 0, 0, 0x81};
  CHECK(describe("4|12@1+ (1,0) [0|0] \"\"", data) == "A: S=970");   // 3C, then the upper half of A5: 3CAh
  CHECK(describe("7|12@0+ (1,0) [0|0] \"\"", data) == "A: S=2643");  // A53h
  CHECK(describe("3|12@0+ (1,0) [0|0] \"\"", data) == "A: S=1340");  // 53Ch
  CHECK(describe("4|4@1- (1,0) [0|0] \"\"", data) == "A: S=-6");     // 1010 of two's complement
  CHECK(describe("7|4@0- (1,0) [0|0] \"\"", data) == "A: S=-6");
  CHECK(describe("56|8@1- (1,0) [0|0] \"\"", data) == "A: S=-127");
  CHECK(describe("0|64@1+ (1,0) [0|0] \"\"", data) == "A: S=9295429630892719269");   // 8100 0000 0000 3CA5h
  CHECK(describe("7|64@0- (1,0) [0|0] \"\"", data) == "A: S=-6540352558848802687");  // A53C 0000 0000 0081h
}

TEST_CASE("Raw values become physical ones, with unit and text", "[decode]") {
  CHECK(describe("0|8@1+ (0.5,-40) [0|0] \"degC\"", {100}) == "A: S=10 degC");
  CHECK(describe("0|8@1+ (1,0) [0|0] \"\"", {3}, "VAL_ 291 S 3 \"third\" 4 \"fourth\" ;") == "A: S=3 (third)");
  CHECK(describe("0|8@1- (1,0) [0|0] \"\"", {0xFF}, "VAL_ 291 S -1 \"none\" ;") == "A: S=-1 (none)");
  const std::string is_float = "SIG_VALTYPE_ 291 S : 1;";
  CHECK(describe("0|32@1- (1,0) [0|0] \"\"", {0, 0, 0xC0, 0x3F}, is_float) == "A: S=1.5");
  CHECK(describe("7|32@0- (2,1) [0|0] \"\"", {0x3F, 0xC0, 0, 0}, is_float) == "A: S=4");
  CHECK(describe("7|64@0- (1,0) [0|0] \"\"", {0xC0, 0x04, 0, 0, 0, 0, 0, 0}, "SIG_VALTYPE_ 291 S : 2;") == "A: S=-2.5");
  CHECK(describe("0|8@1+ (1,0) [0|0] \"\xB0"
                 "C\"",
                 {20}) ==
        "A: S=20 \xC2\xB0"
        "C");
}

TEST_CASE("A multiplexor says which signals are there, and a short frame has only what it has", "[decode]") {
  const Dbc dbc = read_motor();
  const auto tell = [&](std::initializer_list<std::uint8_t> data) {
    const can::CanFrame frame = can::make_frame(291, data);
    return describe_message(*dbc.find(frame), frame.data());
  };
  CHECK(tell({0, 40, 3, 0, 0, 0, 0x20, 0xC0}) == "Motor: Speed=10 rpm, Gear=3 (third), Page=0, Torque=-2.5 Nm");
  CHECK(tell({0xFF, 0xFE, 4, 1, 0x01, 0x20, 0, 0}) == "Motor: Speed=-11 rpm, Gear=4, Page=1, Current=1.8 A");
  CHECK(tell({0, 40, 15}) == "Motor: Speed=10 rpm, Gear=15 (none)");
  CHECK(tell({0}) == "Motor:");
}

TEST_CASE("Bit 31 of an identifier makes it extended", "[decode]") {
  const Dbc dbc = read_dbc("BO_ 2147483939 Long: 1 X\nBO_ 291 Short: 1 X\n", "ids.dbc");
  can::CanFrame frame = can::make_frame(291, {0});
  CHECK(dbc.find(frame)->name == "Short");
  frame.extended = true;
  CHECK(dbc.find(frame)->name == "Long");
  frame.kind = can::FrameKind::kError;
  CHECK(dbc.find(frame) == nullptr);
}

TEST_CASE("What is wrong in a DBC is told with its line", "[decode]") {
  const std::string head = "BU_: X\nBO_ 1 A: 2 X\n SG_ S : 0|8@1+ (1,0) [0|0] \"\" X\n";
  CHECK(complaint(head).empty());
  const std::vector<std::pair<std::string, std::string>> cases = {
      {" SG_ S : 8|8@1+ (1,0) [0|0] \"\" X\n", "a.dbc:4:1: A has signal S twice"},
      {" SG_ T : 7|8@1+ (1,0) [0|0] \"\" X\n", "a.dbc:4:1: signals S and T of A overlap"},
      {" SG_ T : 7|2@0+ (1,0) [0|0] \"\" X\n", "a.dbc:4:1: signals S and T of A overlap"},
      {" SG_ T : 9|8@1+ (1,0) [0|0] \"\" X\n", "a.dbc:4:1: signal T (9|8) is not within the 2 bytes of A"},
      {" SG_ T : 8|2@0+ (1,0) [0|0] \"\" X\n", "a.dbc:4:1: signal T (8|2) is not within the 2 bytes of A"},
      {" SG_ T m0 : 8|8@1+ (1,0) [0|0] \"\" X\nBU_: X", "signal T of A is multiplexed, but there is no multiplexor"},
      {" SG_ T m0M : 8|8@1+ (1,0) [0|0] \"\" X\n", "a.dbc:4:1: \"m0M\" of signal T"},
      {" SG_ T : 8|8@2+ (1,0) [0|0] \"\" X\n", "a.dbc:4:1: expected '1' before \"2+ (1,0)"},
      {"BO_ 1 B: 2 X\n", "a.dbc:4:1: B has the identifier of A"},
      {"BO_ 2048 B: 2 X\n", "a.dbc:4:1: identifier 2048 is too large"},
      {"BO_ 2 B: 65 X\n", "a.dbc:4:1: B has more than 64 bytes"},
      {"BU_: X\n SG_ T : 8|8@1+ (1,0) [0|0] \"\" X\n", "a.dbc:5:1: SG_ stands outside of a message"},
      {"VAL_ 1 T 0 \"off\" ;\n", "a.dbc:4:1: A has no signal T"},
      {"VAL_ 9 S 0 \"off\" ;\n", "a.dbc:4:1: there is no message 9 before this"},
      {"VAL_ 1 S 0 \"off\" 0 \"on\" ;\n", "a.dbc:4:1: value 0 of signal S has two texts"},
      {"SIG_VALTYPE_ 1 S : 1;\n", "a.dbc:4:1: signal S needs 32 bits for this type"},
      {"CM_ \"no end", "the quotes of a text have no end"}};
  for (const auto& [text, wanted] : cases) {
    INFO(text);
    CHECK_THAT(complaint(head + text), Catch::Contains(wanted));
  }
}

TEST_CASE("The story names messages of the DBC, and without a rig takes nothing for CANopen", "[decode]") {
  const Dbc dbc = read_dbc("BO_ 1797 Wiper: 1 X\n", "car.dbc");  // 705h: a heartbeat, if there were a node 5.
  const config::Rig none;
  Story story{none, &dbc};
  for (int i = 0; i < 3; ++i) story.take(Instant{i * 1s}, can::make_frame(0x705, {5}));
  story.take(Instant{3s}, can::make_frame(0x706, {5}));
  story.finish();
  REQUIRE(story.findings().size() == 2);
  CHECK(story.findings()[0].kind == FindingKind::kMessage);
  CHECK(story.findings()[0].text == "message Wiper (705h); 3 of them to 2.000000 s");
  CHECK(story.findings()[1].text == "identifier 706h is nobody's of this rig");
}
