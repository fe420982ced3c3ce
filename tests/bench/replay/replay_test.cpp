#include <array>
#include <catch2/catch.hpp>
#include <cmath>
#include <cstring>
#include <filesystem>

#include "bench/bus/virtual_time.hpp"
#include "bench/log/log_reader.hpp"
#include "bench/replay/fits.hpp"
#include "bench/replay/log_partner.hpp"
#include "bench/scenario/scenario.hpp"
#include "controller/machine/controller.hpp"
#include "plant_emulator/emulator.hpp"
#include "protocols/can/candump.hpp"

using namespace meltbench;
using namespace meltbench::replay;
using Catch::Matchers::Contains;
using Kind = Difference::Kind;

namespace {

/// Three seconds of production: boot, 300 cycles, heartbeats.
constexpr Nanos kDuration = 3s;

const scenario::ResolvedRun& run_settings() {
  static const scenario::ResolvedRun run = [] {
    auto runs = scenario::load(std::filesystem::path{MELTBENCH_SOURCE_DIR} / "fixtures/scenarios/set_point_step.toml");
    return std::move(runs.front());
  }();
  return run;
}

class TextLog final : public bus::RunObserver {
 public:
  void on_frame(const can::StampedFrame& frame, std::size_t) override {
    can::append_log_line(text, frame.at, "bench", frame.frame);
  }
  void on_row(Instant, std::span<const double>) override {}
  void on_event(std::size_t, const Event&) override {}
  std::string text;
};

std::unique_ptr<Participant> make_controller() {
  return std::make_unique<machine::Controller>(machine::read_settings(run_settings().root));
}

std::unique_ptr<Participant> make_boards() {
  return std::make_unique<emulator::Emulator>(emulator::read_settings(run_settings().root, run_settings().rig),
                                              run_settings().seed);
}

void run(Participant& first, Participant& second, bus::RunObserver& observer) {
  runtime::InProcessPort one{first};
  runtime::InProcessPort other{second};
  const std::array<runtime::ParticipantPort*, 2> ports{&one, &other};
  REQUIRE(bus::VirtualTime{ports, 10ms, observer}.run(kDuration).kind == bus::RunOutcome::Kind::kCompleted);
}

/// A run of both, recorded, as the replay reads it.
const Script& recorded() {
  static const Script script = [] {
    const auto controller = make_controller();
    const auto boards = make_boards();
    TextLog log;
    run(*controller, *boards, log);
    decode::BusView view{run_settings().rig};
    const auto reader = log::open_log(std::make_unique<log::MemorySource>(std::span{log.text}));
    return read_script(*reader, view);
  }();
  return script;
}

struct Found {
  std::vector<Difference> differences;
  std::uint64_t count = 0;
  std::uint64_t compared = 0;
  Fits fits;
};

Found replay_to(LiveSide live, const Script& script, Tolerance tolerance = {}) {
  decode::BusView view{run_settings().rig};
  Comparison comparison{view, std::move(tolerance)};
  Fits fits;
  comparison.watch([&fits](const ValuePair& pair) { fits.take(pair); });
  LogPartner partner{script, live, comparison};
  TextLog ignored;
  if (live == LiveSide::kController) {
    run(*make_controller(), partner, ignored);
  } else {
    run(partner, *make_boards(), ignored);
  }
  comparison.finish(Instant{kDuration});
  return {comparison.differences(), comparison.count(), comparison.compared(), fits};
}

/// The n-th frame with this identifier.
std::size_t find_frame(const Script& script, std::uint32_t id, int n) {
  for (std::size_t i = 0; i < script.frames.size(); ++i) {
    if (script.frames[i].frame.id == id && n-- == 0) return i;
  }
  FAIL("no such frame");
  return 0;
}

constexpr std::uint32_t kFeederRpdo1 = 0x205;
constexpr std::uint32_t kPressureTpdo1 = 0x187;

}  // namespace

TEST_CASE("Replay: a run's own log, played to either side, is answered as it was recorded, to the microsecond",
          "[replay]") {
  const LiveSide live = GENERATE(LiveSide::kController, LiveSide::kBoards);
  const Found found = replay_to(live, recorded());
  CHECK(found.count == 0);
  CHECK(found.compared > 300);  // One SYNC, or its answers, for each of the 300 cycles at least.
}

TEST_CASE("Replay to the controller: one changed byte of its own is found and named", "[replay]") {
  Script script = recorded();
  const std::size_t at = find_frame(script, kFeederRpdo1, 100);
  script.frames[at].frame.bytes[1] ^= 0x10;
  const Found found = replay_to(LiveSide::kController, script);
  REQUIRE(found.count == 1);
  CHECK(found.differences[0].kind == Kind::kChanged);
  CHECK(found.differences[0].at == script.frames[at].at);
  CHECK(found.differences[0].line == script.frames[at].line);
  CHECK_THAT(found.differences[0].text, Contains("feeder"));
}

TEST_CASE("Replay: the message of a changed value has as many digits as tell it from the recorded one", "[replay]") {
  Script script = recorded();
  const std::size_t at = find_frame(script, kFeederRpdo1, 100);
  script.frames[at].frame.bytes[0] ^= 0x01;  // Lowest bit of a REAL32.
  const Found found = replay_to(LiveSide::kController, script);
  REQUIRE(found.count == 1);
  const std::string& text = found.differences[0].text;
  const std::size_t middle = text.find(" instead of ");
  REQUIRE(middle != std::string::npos);
  const std::size_t begin = text.rfind(' ', middle - 1) + 1;
  const std::size_t second = middle + std::strlen(" instead of ");
  const std::string now = text.substr(begin, middle - begin);
  const std::string was = text.substr(second, text.find(' ', second) - second);
  CHECK(now != was);
  CHECK(std::max(now.size(), was.size()) <= 10);  // Nine digits tell all REAL32 apart.
}

TEST_CASE("Replay: the fit of a signal counts what was compared, and has the largest difference with its place",
          "[replay]") {
  Script script = recorded();
  const std::size_t at = find_frame(script, kFeederRpdo1, 100);
  float set_point = 0;
  std::memcpy(&set_point, script.frames[at].frame.bytes.data(), sizeof set_point);
  const float moved = set_point + 3;
  std::memcpy(script.frames[at].frame.bytes.data(), &moved, sizeof moved);
  const Found found = replay_to(LiveSide::kController, script);
  std::size_t differing = 0;
  for (const auto& [key, fit] : found.fits.signals()) {
    CHECK(fit.compared > 0);
    if (fit.differing == 0) {
      CHECK(fit.largest == 0);
      continue;
    }
    ++differing;
    CHECK(fit.differing == 1);
    CHECK(fit.largest == Approx(3));
    CHECK(fit.at == script.frames[at].at);
    CHECK(fit.line == script.frames[at].line);
    CHECK(fit.rms() == Approx(3 / std::sqrt(static_cast<double>(fit.compared))));
  }
  CHECK(differing == 1);
}

TEST_CASE("Replay: in a fit, one that is no number differs from a number, and from no other that is none", "[replay]") {
  const double nan = std::nan("");
  Fits fits;
  const auto take = [&fits](double was, double now) {
    const decode::DecodedValue recorded{{0x2000, 0}, "x", was};
    const decode::DecodedValue answered{{0x2000, 0}, "x", now};
    fits.take({5, Instant{1s}, 7, recorded, answered});
  };
  take(nan, nan);
  take(2, 5);
  take(nan, 1);
  const SignalFit& fit = fits.signals().begin()->second;
  CHECK(fit.compared == 3);
  CHECK(fit.differing == 2);
  CHECK(fit.largest == 3);
  CHECK(fit.rms() == 3);  // Of the one pair that has a difference.
}

TEST_CASE("Replay to the controller: a changed byte of a board shows in what the laws make of it", "[replay]") {
  Script script = recorded();
  const std::size_t at = find_frame(script, kPressureTpdo1, 100);
  script.frames[at].frame.bytes[1] ^= 0x01;
  const Found found = replay_to(LiveSide::kController, script);
  REQUIRE(found.count >= 1);
  CHECK(found.differences[0].kind == Kind::kChanged);
  CHECK(found.differences[0].at >= script.frames[at].at);
  CHECK(found.differences[0].at <= script.frames[at].at + 10ms);
}

TEST_CASE("Replay to the controller: a shift of 2 ms is found, of its own frame and of a board's", "[replay]") {
  Script script = recorded();
  const std::uint32_t id = GENERATE(kFeederRpdo1, kPressureTpdo1);
  const std::size_t at = find_frame(script, id, 100);
  ScriptFrame moved = script.frames[at];
  moved.at += 2ms;
  script.frames.erase(script.frames.begin() + static_cast<std::ptrdiff_t>(at));
  std::size_t to = at;
  while (script.frames[to].at <= moved.at) ++to;
  script.frames.insert(script.frames.begin() + static_cast<std::ptrdiff_t>(to), moved);
  const Found found = replay_to(LiveSide::kController, script);
  REQUIRE(found.count >= 1);
  CHECK(found.differences[0].kind == (id == kFeederRpdo1 ? Kind::kEarly : Kind::kLate));
  CHECK_THAT(found.differences[0].text, Contains("2.000 ms"));
}

TEST_CASE("Replay to the controller: a frame that is missing from the log is found, and nothing else is blamed",
          "[replay]") {
  Script script = recorded();
  const std::size_t at = find_frame(script, kFeederRpdo1, 100);
  const Instant when = script.frames[at].at;
  script.frames.erase(script.frames.begin() + static_cast<std::ptrdiff_t>(at));
  const Found found = replay_to(LiveSide::kController, script);
  REQUIRE(found.count == 1);
  CHECK(found.differences[0].kind == Kind::kUnexpected);
  CHECK(found.differences[0].at == when);
}

TEST_CASE("Replay to the controller: a frame that it did not say is missing, and nothing else is blamed", "[replay]") {
  Script script = recorded();
  const std::size_t at = find_frame(script, kFeederRpdo1, 100);
  ScriptFrame more = script.frames[at];
  more.frame.bytes[0] ^= 0xFF;
  script.frames.insert(script.frames.begin() + static_cast<std::ptrdiff_t>(at), more);
  const Found found = replay_to(LiveSide::kController, script);
  REQUIRE(found.count >= 1);
  CHECK(found.differences[0].at == more.at);
}

TEST_CASE("Replay to the boards: a changed set point is seen in their telemetry; tolerances are by object",
          "[replay]") {
  Script script = recorded();
  const std::size_t at = find_frame(script, kFeederRpdo1, 100);
  script.frames[at].frame.bytes[2] ^= 0x40;  // Some per cent of the set point, a REAL32.
  const Found found = replay_to(LiveSide::kBoards, script);
  CHECK(found.count >= 1);
  CHECK(found.fits.signals().size() > 1);

  Tolerance wide;
  for (const auto& board : run_settings().rig.boards) {
    for (std::uint16_t index = 0x2000; index < 0xA000; ++index) {
      for (std::uint8_t sub = 0; sub < 9; ++sub) wide.values[{board.node_id, {index, sub}}] = 1e9;
    }
  }
  CHECK(replay_to(LiveSide::kBoards, script, wide).count == 0);
}

TEST_CASE("Bus view: frames are told in words, with the values as they are mapped", "[replay]") {
  decode::BusView view{run_settings().rig};
  CHECK(view.describe(can::make_frame(0x000, {0x81, 0x00})) == "NMT: reset all");
  CHECK(view.describe(can::make_frame(0x080, {})) == "SYNC");
  CHECK(view.describe(can::make_frame(0x705, {0x00})) == "feeder boot-up");
  CHECK(view.describe(can::make_frame(0x77F, {0x05})) == "controller heartbeat: operational");
  CHECK_THAT(view.describe(can::make_frame(0x087, {0x30, 0x81, 0x11, 0, 0, 0, 0, 0})),
             Contains("melt_pressure EMCY 8130h"));
  CHECK_THAT(view.describe(can::make_frame(0x585, {0x80, 0x18, 0x10, 0x09, 0x11, 0x00, 0x09, 0x06})),
             Contains("feeder SDO abort 0x1018:9"));
  bool has_values = false;
  for (const ScriptFrame& frame : recorded().frames) {
    view.take(frame.frame);
    has_values = has_values || (frame.frame.id == kFeederRpdo1 && !view.values_of(frame.frame).empty());
  }
  CHECK(has_values);
}
