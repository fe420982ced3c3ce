#include <catch2/catch.hpp>

#include "bench/check/kinds.hpp"

namespace meltbench::check {
namespace {

using record::Recording;

Recording make_healthy() {
  Recording recording;
  recording.info.nodes = {{5, "feeder"}};
  recording.signals = {{"plant.rejected_feed_count", SignalKind::kErrorCounter}, {"plant.x_m"}};
  recording.row_times = {Instant{0s}, Instant{1s}};
  recording.values = {0, 0.1, 0, 0.2};
  recording.ending.at = Instant{1s};
  recording.events = {{"bench", {Instant{}, Severity::kInfo, "start", ""}}};
  recording.frames.push_back(Instant{}, can::make_frame(0x85, {0, 0, 0, 0, 0, 0, 0, 0}), 0);  // EMCY "error reset".
  return recording;
}

/// The gate finds one thing in `recording`, and nothing once `entry` is expected.
void check_found_unless_expected(const Recording& recording, const std::string& entry) {
  const Health health = HealthGate{}.judge(recording);
  CHECK_FALSE(health.held);
  CHECK(health.findings.size() == 1);
  const Health forgiven = HealthGate{{entry}}.judge(recording);
  CHECK(forgiven.held);
  CHECK(forgiven.expected == std::vector<std::string>{entry});
  CHECK(forgiven.absent.empty());
}

}  // namespace

TEST_CASE("Health gate: a clean run is healthy", "[check]") {
  const Health health = HealthGate{{"controller.law-refused"}}.judge(make_healthy());
  CHECK(health.held);
  CHECK(health.absent == std::vector<std::string>{"controller.law-refused"});
}

TEST_CASE("Health gate: warnings and faults", "[check]") {
  Recording recording = make_healthy();
  recording.events.push_back({"controller", {Instant{1s}, Severity::kWarning, "law-refused", "denominator"}});
  recording.events.push_back({"controller", {Instant{2s}, Severity::kWarning, "law-refused", "denominator"}});
  check_found_unless_expected(recording, "controller.law-refused");
  CHECK(HealthGate{}.judge(recording).findings[0] == "controller: warning law-refused at 1 s: denominator (2 times)");
}

TEST_CASE("Health gate: error counters, also ones that went back to zero", "[check]") {
  Recording recording = make_healthy();
  recording.values[0] = 3;
  check_found_unless_expected(recording, "plant.rejected_feed_count");
}

TEST_CASE("Health gate: emergency messages, by board or by node id", "[check]") {
  Recording recording = make_healthy();
  recording.frames.push_back(Instant{1s}, can::make_frame(0x85, {0x30, 0x81, 0x11, 0, 0, 0, 0, 0}), 0);
  check_found_unless_expected(recording, "emcy:feeder:8130");
  check_found_unless_expected(recording, "emcy:5:8130");
  check_found_unless_expected(recording, "emcy:feeder:*");
  CHECK_FALSE(HealthGate{{"emcy:feeder:8131", "emcy:6:8130"}}.judge(recording).held);
}

TEST_CASE("Health gate: error frames, lost frames", "[check]") {
  Recording recording = make_healthy();
  SECTION("error frame") {
    can::CanFrame error;
    error.kind = can::FrameKind::kError;
    error.id = 0x85;  // Looks like an EMCY identifier, and is none.
    error.length = 8;
    error.bytes[0] = 1;
    recording.frames.push_back(Instant{1s}, error, record::kUnknownSender);
    check_found_unless_expected(recording, "error-frames");
  }
  SECTION("lost frame") {
    recording.ending.lost_frames = 1;
    check_found_unless_expected(recording, "lost-frames");
  }
}

TEST_CASE("Health gate: a run that did not come to its end fails, and nothing excuses it", "[check]") {
  Recording recording = make_healthy();
  recording.ending.reason = record::EndReason::kParticipantLost;
  recording.ending.text = "controller exited with status 9";
  const Health health = HealthGate{{"end"}}.judge(recording);
  REQUIRE_FALSE(health.held);
  CHECK(health.findings[0].find("controller exited with status 9") != std::string::npos);
}

}  // namespace meltbench::check
