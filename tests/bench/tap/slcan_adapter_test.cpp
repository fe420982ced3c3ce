#include "bench/tap/slcan_adapter.hpp"

#include <catch2/catch.hpp>

using namespace meltbench;
using tap::SlcanAdapter;

namespace {

struct Talk {
  explicit Talk(bool read_only = false) : adapter{read_only} {}
  SlcanAdapter adapter;
  std::vector<can::CanFrame> sent;

  std::string hear(std::string_view said) {
    std::string answers;
    CHECK(adapter.hear(said, 100, answers, sent) == said.size());
    return answers;
  }
  std::string tell(const can::CanFrame& frame) {
    std::string out;
    adapter.tell({Instant{61'234ms}, frame}, out);
    return out;
  }
};

const can::CanFrame kFrame = can::make_frame(0x605, {0x40, 0x00});

}  // namespace

TEST_CASE("slcan adapter: python-can's blind way to open works, and opening twice is no mistake", "[tap]") {
  Talk talk;
  CHECK(talk.hear("C\rS6\rO\rO\r") == "\r\r\r\r");
  CHECK(talk.adapter.wants_frames());
  CHECK(talk.tell(kFrame) == "t60524000\r");
  CHECK(talk.hear("C\r") == "\r");
  CHECK_FALSE(talk.adapter.wants_frames());
}

TEST_CASE("slcan adapter: it says who it is in as many characters as python-can wants", "[tap]") {
  Talk talk;
  CHECK(talk.hear("V\r") == "V1013\r");
  CHECK(talk.hear("v\r") == "v1013\r");
  CHECK(talk.hear("N\r") == "NA123\r");
}

TEST_CASE("slcan adapter: frames of each kind are sent once it is open, and refused before", "[tap]") {
  Talk talk;
  CHECK(talk.hear("t60524000\r") == "\a");
  CHECK(talk.sent.empty());
  CHECK(talk.hear("O\rt60524000\rT123456781AA\rr7050\rR123456780\r") == "\rz\rZ\rz\rZ\r");
  REQUIRE(talk.sent.size() == 4);
  CHECK(talk.sent[0] == kFrame);
  CHECK(talk.sent[1].id == 0x12345678);
  CHECK(talk.sent[1].extended);
  CHECK(talk.sent[2].kind == can::FrameKind::kRemote);
  CHECK(talk.sent[3].extended);
}

TEST_CASE("slcan adapter: who listens only cannot send", "[tap]") {
  Talk listening;
  CHECK(listening.hear("L\rt60524000\r") == "\r\a");
  CHECK(listening.adapter.wants_frames());
  Talk read_only{true};
  CHECK(read_only.hear("O\rt60524000\r") == "\r\a");
  CHECK(listening.sent.empty());
  CHECK(read_only.sent.empty());
}

TEST_CASE("slcan adapter: what it does not know, cannot do now or gets torn is refused, and the next line works",
          "[tap]") {
  Talk talk;
  CHECK(talk.hear("q\rt6052400\rSx\rP\rA\rF\rM1\rm12345678\r") == "\a\a\a\a\a\a\a\a");
  CHECK(talk.hear("O\rS6\rt6052400\rV\r") == "\r\a\aV1013\r");
  CHECK(talk.hear(std::string(1000, 'x')) == "\a");
}

TEST_CASE("slcan adapter: a filter that lets everything pass is taken", "[tap]") {
  Talk talk;
  CHECK(talk.hear("M00000000\rmFFFFFFFF\r") == "\r\r");
}

TEST_CASE("slcan adapter: stamps are milliseconds that begin anew each minute", "[tap]") {
  Talk talk;
  CHECK(talk.hear("Z1\rO\r") == "\r\r");
  CHECK(talk.tell(kFrame) == "t6052400004D2\r");  // 61.234 s: 0x04D2 = 1234.
  CHECK(talk.hear("Z0\r") == "\r");
  CHECK(talk.tell(kFrame) == "t60524000\r");
}

TEST_CASE("slcan adapter: with automatic polling off frames wait to be asked for", "[tap]") {
  Talk talk;
  talk.hear("X0\rO\r");
  CHECK(talk.hear("t60524000\r") == "\r");
  CHECK(talk.hear("P\r") == "\r");
  for (int i = 0; i < 3; ++i) CHECK(talk.tell(kFrame).empty());
  CHECK(talk.hear("P\r") == "t60524000\r");
  CHECK(talk.hear("A\r") == "t60524000\rt60524000\rA\r");
  CHECK(talk.hear("A\r") == "A\r");
  CHECK(talk.hear("F\r") == "F00\r");
  for (int i = 0; i < 100; ++i) CHECK(talk.tell(kFrame).empty());
  CHECK(talk.hear("F\r") == "F01\r");
  CHECK(talk.hear("F\r") == "F00\r");
}

TEST_CASE("slcan adapter: lines in pieces, and line feeds behind them, are understood", "[tap]") {
  Talk talk;
  std::string answers;
  CHECK(talk.adapter.hear("t6052", 9, answers, talk.sent) == 0);
  CHECK(talk.hear("O\r\nt60524000\r") == "\rz\r");
}

TEST_CASE("slcan adapter: it stops before the frame that it has no room for", "[tap]") {
  Talk talk;
  talk.hear("O\r");
  std::string answers;
  const std::string said = "t1000\rt2000\rV\r";
  CHECK(talk.adapter.hear(said, 1, answers, talk.sent) == 6);
  CHECK(talk.sent.size() == 1);
  CHECK(answers == "z\r");
}
