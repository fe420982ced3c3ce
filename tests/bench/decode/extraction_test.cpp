#include "bench/decode/extraction.hpp"

#include <algorithm>
#include <catch2/catch.hpp>
#include <filesystem>

#include "bench/scenario/scenario.hpp"
#include "protocols/config/toml.hpp"

using namespace meltbench;
using namespace meltbench::decode;

namespace {

constexpr Instant kStart{};
constexpr Instant kEnd = kStart + 10s;

/// Coupled rig: feeder 5, melt pressure 7, preconditioner 8, heater 10, controller 127; SYNC every 10 ms.
const config::Rig& rig() {
  static const scenario::ResolvedRun run = [] {
    const auto folder = std::filesystem::path{MELTBENCH_SOURCE_DIR} / "fixtures/scenarios";
    return std::move(scenario::load(folder / "coupled_start_up.toml").front());
  }();
  return run.rig;
}

/// Feeder 5, screw drive 6, melt pressure 7; no heaters.
const config::Rig& bizone() {
  static const scenario::ResolvedRun run = [] {
    const auto folder = std::filesystem::path{MELTBENCH_SOURCE_DIR} / "fixtures/scenarios";
    return std::move(scenario::load(folder / "set_point_step.toml").front());
  }();
  return run.rig;
}

Finding make(FindingKind kind, Nanos at, std::uint8_t node) {
  Finding finding;
  finding.kind = kind;
  finding.at = kStart + at;
  finding.node = node;
  return finding;
}

Finding boot(Nanos at, std::uint8_t node) {
  Finding finding = make(FindingKind::kBoot, at, node);
  finding.id = 0x700U + node;
  finding.code = 1;
  return finding;
}

Finding silence(Nanos at, std::optional<Nanos> until, std::uint8_t node, bool of_all) {
  Finding finding = make(FindingKind::kHeartbeatLost, at, node);
  finding.id = 0x700U + node;
  if (until) finding.until = kStart + *until;
  finding.code = of_all ? 1 : 0;
  return finding;
}

Finding emcy(Nanos at, std::uint8_t node, std::uint16_t code) {
  Finding finding = make(FindingKind::kEmcy, at, node);
  finding.until = finding.at;
  finding.id = 0x80U + node;
  finding.code = code;
  return finding;
}

Finding set_point(Nanos at, Nanos until, std::uint8_t node, canopen::ObjectAddress address, double before, double after,
                  std::uint64_t count) {
  Finding finding = make(FindingKind::kSetPoint, at, node);
  finding.until = kStart + until;
  finding.address = address;
  finding.before = before;
  finding.after = after;
  finding.count = count;
  return finding;
}

Extraction extract_all(std::vector<Finding> findings) {
  std::ranges::stable_sort(findings, {}, &Finding::at);
  return extract(findings, kEnd, rig());
}

/// The only fault, as text: its keys in the order of the file.
std::string only_fault(const Extraction& found) {
  REQUIRE(found.faults.size() == 1);
  std::string text = config::write_toml(found.faults.front());
  std::ranges::replace(text, '\n', ' ');
  return text.substr(0, text.find_last_not_of(' ') + 1);
}

}  // namespace

TEST_CASE("a boot-up that nobody asked for is a reboot", "[decode]") {
  CHECK(only_fault(extract_all({boot(5s, 10)})) == R"(target = "board.heater" kind = "reboot" at_s = 5.0)");
}

TEST_CASE("a silence that ends in a boot-up is a board without power, once", "[decode]") {
  CHECK(only_fault(extract_all({silence(5s, 8s, 5, true), boot(8s, 5)})) ==
        R"(target = "board.feeder" kind = "off" at_s = 5.001 for_s = 2.999)");
}

TEST_CASE("a silence behind which the board goes on is a cable", "[decode]") {
  CHECK(only_fault(extract_all({silence(5s, 6s, 5, true)})) ==
        R"(target = "frame" kind = "drop" at_s = 5.001 for_s = 0.998 id = 5 mask = 127)");
}

TEST_CASE("a heartbeat alone is lost as such; that of the controller as a frame", "[decode]") {
  CHECK(only_fault(extract_all({silence(5s, 6s, 7, false)})) ==
        R"(target = "board.melt_pressure" kind = "heartbeat_lost" at_s = 5.001 for_s = 0.998)");
  CHECK(only_fault(extract_all({silence(5s, {}, 127, false)})) ==
        R"(target = "frame" kind = "drop" at_s = 5.001 id = 1919 mask = 2047)");
}

TEST_CASE("a sensor fails one cycle before its board has told it, by report or EMCY, which is no fault of its own",
          "[decode]") {
  Finding invalid = make(FindingKind::kInvalid, 5s, 10);
  invalid.address = {0x6150, 2};
  invalid.code = 3;
  CHECK(only_fault(extract_all({invalid})) == R"(target = "sensor.zone2" kind = "open_circuit" at_s = 4.991)");
  CHECK(only_fault(extract_all({emcy(4990ms, 10, 0x5000), invalid})) ==
        R"(target = "sensor.zone2" kind = "open_circuit" at_s = 4.981)");
}

TEST_CASE("a pressure loop above its range is shorted, below it open", "[decode]") {
  const auto [status, kind] = GENERATE(table<std::uint16_t, std::string>({{3, "short_circuit"}, {5, "open_circuit"}}));
  Finding invalid = make(FindingKind::kInvalid, 5s, 7);
  invalid.address = {0x6150, 1};
  invalid.code = status;
  invalid.until = kStart + 6s;
  CHECK(only_fault(extract_all({invalid})) ==
        "target = \"sensor.melt_pressure\" kind = \"" + kind + "\" at_s = 4.991 for_s = 1.009");
}

TEST_CASE("what is not valid while a board starts is no fault", "[decode]") {
  Finding start = boot(0s, 9);
  start.code = 0;
  Finding invalid = make(FindingKind::kInvalid, 20ms, 9);
  invalid.address = {0x6150, 2};
  invalid.code = 1;
  CHECK(extract_all({start, invalid}).faults.empty());
}

TEST_CASE("emergencies that nothing explains are sent as often as in the log", "[decode]") {
  Finding storm = emcy(5s, 7, 0x1000);
  storm.count = 11;
  storm.until = kStart + 5100ms;
  const Extraction found = extract_all({storm});
  CHECK(only_fault(found) ==
        R"(target = "board.melt_pressure" kind = "emcy_storm" at_s = 5.0 for_s = 0.105 code = 4096 period_ms = 10.0)");
  CHECK(std::ranges::find(found.expect, "emcy:melt_pressure:1000") != found.expect.end());
  CHECK(extract_all({emcy(5s, 7, 0x8130)}).faults.empty());  // Its consumer of heartbeats: the master's is the fault.
}

TEST_CASE("the safe state is checked within 20 ms of when set points went to zero, or the feed stood still",
          "[decode]") {
  Finding feed = set_point(0s, 5s, 5, {0x2000, 0}, 1.5, 2.0, 500);
  feed.code = 1;  // It changed in every frame.
  const Finding off = set_point(5300ms, 5300ms, 10, {0x2000, 0}, 31, 0, 1);
  const auto check_of = [](const Extraction& found) { return config::write_toml(found.checks.back()); };
  using Catch::Matchers::Contains;
  CHECK_THAT(check_of(extract_all({feed, off})), Contains("not_before_s = 5.28\n") && Contains("within_s = 5.32\n"));
  // A bus with heaters shows its safe state by them; only one without by its feed.
  CHECK_THAT(check_of(extract_all({feed})), Contains("kind = \"always\""));
  CHECK_THAT(check_of(extract(std::vector{feed}, kEnd, bizone())),
             Contains("not_before_s = 4.98\n") && Contains("within_s = 5.02\n"));
  const Finding busy = set_point(0s, 10s, 5, {0x2000, 0}, 1.5, 2.0, 1000);
  CHECK_THAT(check_of(extract_all({busy})), Contains("kind = \"always\"") && Contains("below = 3.5"));
}

TEST_CASE("a safe state without a fault, and what has no fault of its own, is said to be missing", "[decode]") {
  CHECK(extract_all({set_point(5s, 5s, 10, {0x2000, 0}, 31, 0, 1)}).is_unexplained);
  CHECK(extract_all({make(FindingKind::kErrorState, 5s, 0)}).notes.size() == 1);
}

TEST_CASE("an ordered shut-down lets go of the heaters while it stops the screw in steps: no safe state", "[decode]") {
  const Finding off = set_point(5s, 5s, 10, {0x2000, 0}, 31, 0, 1);
  const Finding ramp = set_point(5s, 6500ms, 6, {0x60FF, 0}, 98304, 0, 150);
  const Finding flux_off = set_point(6300ms, 6300ms, 8, {0x2002, 0}, 2, 0, 1);
  const auto kinds = [](const Extraction& found) { return config::write_toml(found.checks.back()); };
  CHECK_THAT(kinds(extract_all({off, ramp, flux_off})), Catch::Matchers::Contains("no safe state"));
  // A screw that was told its speed and turns on is that of a safe state.
  const Finding start = set_point(1s, 2500ms, 6, {0x60FF, 0}, 0, 98304, 150);
  CHECK_THAT(kinds(extract_all({start, off})), Catch::Matchers::Contains("goes to its safe state"));
}

TEST_CASE("error frames between which nobody comes through are a short circuit, else noise, or a frame or two",
          "[decode]") {
  Finding errors = make(FindingKind::kErrorFrames, 5s, 0);
  errors.id = 0x288;  // Protocol violation, bus error.
  errors.code = 1;
  errors.count = 40;
  errors.until = kStart + 5500ms;
  errors.before = 0.008;
  errors.after = 0.1;
  const Extraction dead = extract_all({errors});
  CHECK(only_fault(dead) == R"(target = "bus" kind = "short_circuit" at_s = 4.996 for_s = 0.553865)");
  CHECK(dead.needs_bit_timed);
  errors.code = 2;
  CHECK_THAT(only_fault(extract_all({errors})), Catch::Matchers::Contains("kind = \"noise\" at_s = 5.0 for_s = 0.5"));
  errors.count = 2;
  CHECK(only_fault(extract_all({errors})) == R"(target = "frame" kind = "corrupt" at_s = 4.999 count = 2)");
}

TEST_CASE("a foreign identifier again and again is babble, now and then it is a note", "[decode]") {
  Finding foreign = make(FindingKind::kUnknown, 5s, 0);
  foreign.id = 0x3F0;
  foreign.count = 500;
  foreign.until = kStart + 5500ms;
  CHECK_THAT(only_fault(extract_all({foreign})),
             Catch::Matchers::Contains("kind = \"babble\"") && Catch::Matchers::Contains("id = 1008"));
  foreign.count = 5;
  const Extraction rare = extract_all({foreign});
  CHECK(rare.faults.empty());
  CHECK(rare.notes.size() == 1);
}

TEST_CASE("SYNC and the heartbeat that stay away together are the controller's, one alone is a frame", "[decode]") {
  Finding sync = make(FindingKind::kGap, 4990ms, 0);
  sync.id = 0x80;
  CHECK(only_fault(extract_all({silence(4950ms, {}, 127, false), sync})) ==
        R"(target = "program.controller" kind = "killed" at_s = 4.991)");
  CHECK_THAT(only_fault(extract_all({sync})), Catch::Matchers::Contains("id = 128"));
}

TEST_CASE("what nobody would read is counted", "[decode]") {
  std::vector<Finding> findings;
  for (int i = 0; i < 800; ++i) findings.push_back(boot(i * 10ms, 10));
  const Extraction found = extract_all(std::move(findings));
  CHECK(found.faults.size() == 500);
  CHECK(found.checks.size() == 501);  // And that of no safe state.
  REQUIRE(found.notes.size() == 1);
  CHECK_THAT(found.notes.front(), Catch::Matchers::Contains("300 more"));
}

TEST_CASE("reactions are the same within their tolerance, in any order within it, and without others", "[decode]") {
  const auto boots = [](Nanos at, std::uint8_t node) {
    return Reaction{Reaction::Kind::kBoot, kStart + at, node, 0x700U + node, 0, 0, {}};
  };
  const std::vector<Reaction> log{boots(1s, 5), boots(1010ms, 10)};
  CHECK(describe_difference(log, std::vector{boots(1005ms, 10), boots(1020ms, 5)}, rig()).empty());
  CHECK_THAT(describe_difference(log, std::vector{boots(1s, 5), boots(1031ms, 10)}, rig()),
             Catch::Matchers::Contains("heater boots up, now at 1.031000 s"));
  CHECK_THAT(describe_difference(log, std::vector{boots(1s, 5)}, rig()), Catch::Matchers::Contains("not again"));
  CHECK_THAT(describe_difference(log, std::vector{boots(1s, 5), boots(1010ms, 10), boots(2s, 7)}, rig()),
             Catch::Matchers::Contains("melt_pressure boots up, which is not in the log"));
}
