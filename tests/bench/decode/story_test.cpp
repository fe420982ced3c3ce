#include "bench/decode/story.hpp"

#include <linux/can/error.h>

#include <algorithm>
#include <catch2/catch.hpp>
#include <filesystem>

#include "bench/scenario/scenario.hpp"
#include "protocols/can/candump.hpp"

using namespace meltbench;
using namespace meltbench::decode;
using Catch::Matchers::Contains;

namespace {

constexpr Instant kStart{};

/// Coupled rig: feeder 5, screw drive 6, melt pressure 7, preconditioner 8, melt camera 9, heater 10, controller 127.
const config::Rig& rig() {
  static const scenario::ResolvedRun run = [] {
    const auto folder = std::filesystem::path{MELTBENCH_SOURCE_DIR} / "fixtures/scenarios";
    return std::move(scenario::load(folder / "coupled_start_up.toml").front());
  }();
  return run.rig;
}

class Bus {
 public:
  void say(Nanos at, std::string_view text) { frames_.push_back({kStart + at, can::parse_candump(text).value()}); }
  void say(Nanos at, const can::CanFrame& frame) { frames_.push_back({kStart + at, frame}); }
  /// Every `period` from `from` on, before `to`.
  void repeat(Nanos from, Nanos to, Nanos period, std::string_view text) {
    for (Nanos at = from; at < to; at += period) say(at, text);
  }
  [[nodiscard]] std::vector<Finding> findings() {
    std::ranges::stable_sort(frames_, {}, &can::StampedFrame::at);
    Story story{rig()};
    for (const can::StampedFrame& frame : frames_) story.take(frame.at, frame.frame);
    story.finish();
    load = story.load();
    return story.findings();
  }
  [[nodiscard]] std::vector<Finding> findings(FindingKind kind) {
    std::vector<Finding> all = findings();
    std::erase_if(all, [kind](const Finding& finding) { return finding.kind != kind; });
    return all;
  }
  Load load;

 private:
  std::vector<can::StampedFrame> frames_;
};

can::CanFrame error_frame(std::uint32_t error_class) {
  can::CanFrame frame;
  frame.kind = can::FrameKind::kError;
  frame.id = error_class;
  frame.length = CAN_ERR_DLC;
  return frame;
}

}  // namespace

TEST_CASE("a heartbeat that stays away is lost from the last one to the next", "[decode]") {
  Bus bus;
  bus.repeat(0s, 2s, 100ms, "70A#05");
  bus.repeat(3s, 4s, 100ms, "70A#05");
  const auto lost = bus.findings(FindingKind::kHeartbeatLost);
  REQUIRE(lost.size() == 1);
  CHECK(lost[0].node == 10);
  CHECK(lost[0].at == kStart + 1900ms);
  CHECK(lost[0].until == kStart + 3s);
  CHECK(lost[0].code == 0);  // It never sent anything else that could be missed.
  CHECK_THAT(lost[0].text, Contains("heater heartbeat lost") && Contains("1.1 s") && Contains("every 100 ms"));
}

TEST_CASE("one heartbeat that is left out is no loss, and no jitter of a fifth either", "[decode]") {
  Bus bus;
  bus.repeat(0s, 1s, 100ms, "705#05");
  bus.repeat(1100ms, 2s, 100ms, "705#05");  // 200 ms: less than 2.5 periods.
  for (int i = 0; i < 20; ++i) bus.say(2s + i * 100ms + (i % 2) * 20ms, "705#05");
  CHECK(bus.findings(FindingKind::kHeartbeatLost).empty());
  CHECK(bus.findings(FindingKind::kTooOften).empty());
}

TEST_CASE("a heartbeat that never comes back is lost to the end of the log", "[decode]") {
  Bus bus;
  bus.repeat(0s, 1s, 100ms, "70A#05");
  bus.repeat(0s, 3s, 10ms, "080#");
  const auto lost = bus.findings(FindingKind::kHeartbeatLost);
  REQUIRE(lost.size() == 1);
  CHECK_FALSE(lost[0].until.has_value());
  CHECK_THAT(lost[0].text, Contains("to the end of the log"));
}

TEST_CASE("frames of a silent node are not missed one by one, but those of a node that lives are", "[decode]") {
  Bus bus;
  const bool is_silent = GENERATE(true, false);
  bus.repeat(0s, 2s, 100ms, "707#05");
  bus.repeat(5ms, 2s, 10ms, "187#2B660000008408");
  if (!is_silent) bus.repeat(2s, 4s, 100ms, "707#05");
  bus.repeat(3s, 4s, 10ms, "187#2B660000008408");
  bus.repeat(3s, 4s, 100ms, is_silent ? "707#05" : "080#");
  const auto gaps = bus.findings(FindingKind::kGap);
  if (is_silent) {
    CHECK(gaps.empty());
    const auto lost = bus.findings(FindingKind::kHeartbeatLost);
    REQUIRE(lost.size() == 1);
    CHECK(lost[0].at == kStart + 1995ms);  // Its very last frame.
    CHECK(lost[0].code == 1);
  } else {
    REQUIRE(gaps.size() == 1);
    CHECK_THAT(gaps[0].text, Contains("melt_pressure TPDO1 lost") && Contains("every 10 ms"));
  }
}

TEST_CASE("answers to a SYNC that does not come are not missed", "[decode]") {
  Bus bus;
  for (const auto& [from, to] : {std::pair{0s, 1s}, std::pair{2s, 3s}}) {
    bus.repeat(from, to, 10ms, "080#");
    bus.repeat(from + 1ms, to, 10ms, "187#2B660000008408");
  }
  const auto gaps = bus.findings(FindingKind::kGap);
  REQUIRE(gaps.size() == 1);
  CHECK_THAT(gaps[0].text, Contains("SYNC lost"));
}

TEST_CASE("a report that comes when something changes is not missed when nothing does", "[decode]") {
  Bus bus;
  bus.repeat(0s, 1s, 10ms, "186#3702");  // Statusword of the drive, event-driven.
  bus.repeat(0s, 5s, 100ms, "706#05");
  CHECK(bus.findings(FindingKind::kGap).empty());
}

TEST_CASE("a boot-up is told apart by whether the master has asked for it", "[decode]") {
  Bus bus;
  bus.say(0s, "000#8200");
  bus.say(1ms, "70A#00");
  bus.repeat(100ms, 4s, 100ms, "70A#05");
  bus.say(4s, "70A#00");
  const auto boots = bus.findings(FindingKind::kBoot);
  REQUIRE(boots.size() == 2);
  CHECK(boots[0].code == 0);
  CHECK(boots[1].code == 1);
  CHECK_THAT(boots[1].text, Contains("although nobody has asked"));
}

TEST_CASE("emergencies of one code in a row are one finding, another code is another", "[decode]") {
  Bus bus;
  bus.repeat(1s, 2s, 10ms, "087#0010010000000000");
  bus.say(2s, "087#0000000000000000");
  const auto emcys = bus.findings(FindingKind::kEmcy);
  REQUIRE(emcys.size() == 2);
  CHECK(emcys[0].code == 0x1000);
  CHECK(emcys[0].count == 100);
  CHECK_THAT(emcys[0].text, Contains("melt_pressure EMCY 1000h") && Contains("100 of them to 1.990000 s"));
  CHECK_THAT(emcys[1].text, Contains("an error is over"));
}

TEST_CASE("SDO dialogues are summed up, what fails is told in full", "[decode]") {
  Bus bus;
  for (int i = 0; i < 10; ++i) {
    bus.say(i * 10ms, "60A#4000100000000000");
    bus.say(i * 10ms + 1ms, "58A#4300100094011200");
  }
  bus.say(200ms, "60A#2B17100064000000");
  bus.say(201ms, "58A#8017100030000906");
  bus.say(300ms, "605#4018100100000000");
  bus.say(3s, "080#");
  const auto talks = bus.findings(FindingKind::kSdo);
  REQUIRE(talks.size() == 2);
  CHECK_THAT(talks[0].text, Contains("heater: 11 transfers"));
  const auto failed = bus.findings(FindingKind::kSdoFailed);
  REQUIRE(failed.size() == 2);
  CHECK_THAT(failed[0].text, Contains("0x1017:0 of heater: aborted by heater with 06090030"));
  CHECK_THAT(failed[1].text, Contains("0x1018:1 of feeder: no answer"));
}

TEST_CASE("a set point that moves in every cycle is one finding, with where from and where to", "[decode]") {
  Bus bus;
  bus.say(0s, "205#0000803F");    // 1.0
  bus.say(10ms, "205#0000C03F");  // 1.5
  bus.say(20ms, "205#00000040");  // 2.0
  bus.repeat(30ms, 2s, 10ms, "205#00000040");
  bus.say(2s, "205#00004040");  // 3.0
  const auto moves = bus.findings(FindingKind::kSetPoint);
  REQUIRE(moves.size() == 2);
  CHECK(moves[0].count == 3);
  CHECK(moves[0].before == 1.0);
  CHECK(moves[0].after == 2.0);
  CHECK(moves[0].until == kStart + 20ms);
  CHECK(moves[1].at == kStart + 2s);
  CHECK_THAT(moves[1].text, Contains("to feeder") && Contains("2 -> 3"));
}

TEST_CASE("a loop at work is one finding, however seldom it changes its set point a little", "[decode]") {
  Bus bus;
  for (int i = 0; i < 5; ++i) {
    can::CanFrame frame = can::parse_candump("205#00000000").value();
    const float value = 1.0F + 0.01F * static_cast<float>(i);
    canopen::store(std::span{frame.bytes}, 0, value);
    bus.say(i * 3s, frame);
  }
  CHECK(bus.findings(FindingKind::kSetPoint).size() == 1);
}

TEST_CASE("a measurement that its board calls invalid is told until it is valid again", "[decode]") {
  Bus bus;
  bus.say(0s, "187#2B660000008408");
  bus.say(1s, "187#2B660000058408");  // 6150: not valid, below its range.
  bus.say(2s, "187#2B660000008408");
  const auto invalid = bus.findings(FindingKind::kInvalid);
  REQUIRE(invalid.size() == 1);
  CHECK(invalid[0].code == 5);
  CHECK(invalid[0].until == kStart + 2s);
  CHECK_THAT(invalid[0].text, Contains("melt_pressure") && Contains("not valid, below its range"));
}

TEST_CASE("error frames are counted, bus-off and the return from it told one by one", "[decode]") {
  Bus bus;
  for (int i = 0; i < 32; ++i) bus.say(i * 1ms, error_frame(CAN_ERR_PROT | CAN_ERR_BUSERROR));
  bus.say(32ms, error_frame(CAN_ERR_BUSOFF));
  bus.say(100ms, error_frame(CAN_ERR_RESTARTED));
  const auto errors = bus.findings(FindingKind::kErrorFrames);
  REQUIRE(errors.size() == 1);
  CHECK(errors[0].count == 32);
  const auto states = bus.findings(FindingKind::kErrorState);
  REQUIRE(states.size() == 2);
  CHECK(states[0].text == "bus-off");
  CHECK(states[1].text == "restarted after bus-off");
}

TEST_CASE("frames of nobody are told once for each time that they come", "[decode]") {
  Bus bus;
  bus.repeat(1s, 1100ms, 1ms, "001#FF");
  bus.repeat(5s, 5100ms, 1ms, "001#FF");
  bus.say(6s, "71E#05");  // Heartbeat of node 30.
  const auto unknown = bus.findings(FindingKind::kUnknown);
  REQUIRE(unknown.size() == 3);
  CHECK(unknown[0].count == 100);
  CHECK_THAT(unknown[0].text, Contains("identifier 001h"));
  CHECK_THAT(unknown[2].text, Contains("identifier 71Eh"));
}

TEST_CASE("two senders of one heartbeat are suspected", "[decode]") {
  Bus bus;
  bus.repeat(0s, 2s, 100ms, "705#05");
  bus.say(1510ms, "705#05");
  const auto early = bus.findings(FindingKind::kTooOften);
  REQUIRE(early.size() == 1);
  CHECK(early[0].at == kStart + 1510ms);
}

TEST_CASE("load counts every bit of a frame and the pause behind it", "[decode]") {
  Bus bus;
  bus.repeat(0s, 2s, 1ms, "555#AAAAAAAAAAAAAAAA");  // 8 bytes, hardly stuffed: 111 bits and up, with the pause.
  (void)bus.findings();
  REQUIRE(bus.load.per_second.size() == 2);
  // 1000 frames of 111 to 114 bits at 2 us.
  CHECK(bus.load.per_second[0] >= 0.222F);
  CHECK(bus.load.per_second[0] <= 0.228F);
  CHECK(bus.load.mean == Approx(bus.load.per_second[0]).epsilon(0.01));
}

TEST_CASE("gaps of a node that is silent again and again belong to its silences, however many there are", "[decode]") {
  Bus bus;
  constexpr int kTimes = 400;
  for (int i = 0; i < kTimes; ++i) {  // A second of life, a second of silence.
    bus.repeat(i * 2s, i * 2s + 1s, 100ms, "707#05");
    bus.repeat(i * 2s + 5ms, i * 2s + 1s, 10ms, "187#2B660000008408");
  }
  const auto all = bus.findings();
  const auto is_gap = [](const Finding& finding) { return finding.kind == FindingKind::kGap; };
  CHECK(std::ranges::count_if(all, is_gap) == 0);
  const auto is_whole = [](const Finding& finding) {
    return finding.kind == FindingKind::kHeartbeatLost && finding.code == 1;
  };
  CHECK(std::ranges::count_if(all, is_whole) == kTimes - 1);  // The log ends with the last life.
}

TEST_CASE("heartbeats that had to wait while the bus was dead are no second sender", "[decode]") {
  Bus bus;
  bus.repeat(0s, 2s, 100ms, "70A#05");
  bus.say(3s, "70A#05");
  bus.say(3s + 200us, "70A#05");
  bus.repeat(3100ms, 4s, 100ms, "70A#05");
  CHECK(bus.findings(FindingKind::kTooOften).empty());
  CHECK(bus.findings(FindingKind::kHeartbeatLost).size() == 1);
}

TEST_CASE("a second sender of heartbeats is told from its first one on, wherever it lies between those of the first",
          "[decode]") {
  const Nanos behind = GENERATE(0ms, 20ms, 45ms, 55ms, 80ms);
  Bus bus;
  bus.repeat(0s, 4s, 100ms, "707#05");
  bus.repeat(2s + behind, 4s, 100ms, "707#05");
  const auto rows = bus.findings(FindingKind::kTooOften);
  REQUIRE(rows.size() == 1);
  CHECK(rows[0].node == 7);
  CHECK(rows[0].at == kStart + 2s + behind);
  CHECK(rows[0].count >= 19);
  CHECK(rows[0].before == Approx(0.1));
}

TEST_CASE("error frames tell for how long nobody came through on either side", "[decode]") {
  Bus bus;
  bus.repeat(0s, 1s, 10ms, "080#");
  bus.say(1s, error_frame(CAN_ERR_PROT | CAN_ERR_BUSERROR));
  bus.say(1100ms, error_frame(CAN_ERR_PROT | CAN_ERR_BUSERROR));
  bus.repeat(1150ms, 2s, 10ms, "080#");
  const auto errors = bus.findings(FindingKind::kErrorFrames);
  REQUIRE(errors.size() == 1);
  CHECK(errors[0].count == 2);
  CHECK(errors[0].before == Approx(0.010));
  CHECK(errors[0].after == Approx(0.050));
  CHECK((errors[0].code & 2U) == 0);
}
