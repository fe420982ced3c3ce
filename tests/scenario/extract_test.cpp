#include "bench/cli/extract_command.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <catch2/catch.hpp>
#include <filesystem>
#include <fstream>

#include "bench/cli/prepare_run.hpp"
#include "bench/cli/recorded_log.hpp"
#include "bench/cli/single_run.hpp"
#include "bench/decode/reactions.hpp"
#include "protocols/config/toml.hpp"
#include "tests/tools/temporary_folder.hpp"

using namespace meltbench;
using namespace meltbench::cli;
using Catch::Matchers::Contains;

namespace {

/// A machine, what it was set to, and what failed.
struct Tale {
  std::string rig = "coupled";
  double duration_s = 6;
  std::string settings{};
  std::string faults{};
};

/// Records a tale, extracts a scenario of its log, and runs that.
class Round {
 public:
  explicit Round(const Tale& tale, bool minimise = false) : tale_{tale} {
    write("settings", tale.settings);
    write("told", tale.settings + tale.faults);
    recorded = run("told");
    ExtractRequest request;
    request.log = folder_.path() / "told";
    request.scenario = file("settings");
    request.out = file("again");
    request.minimise = minimise;
    CHECK(extract_scenario(request) == ExitStatus::kHeld);
    const scenario::ResolvedRun found = scenario::load(file("again")).front();
    for (const config::Section& one : found.root.peek_all("fault")) {
      faults.push_back(one.text("target") + " " + one.text("kind"));
    }
    repeated = run("again");
  }

  /// The first reaction that is another one, or more than 20 ms apart; empty if all are the same.
  [[nodiscard]] std::string difference() const {
    return decode::describe_difference(recorded, repeated, scenario::load(file("again")).front().rig);
  }
  [[nodiscard]] bool has_held() const { return held_; }

  std::vector<decode::Reaction> recorded, repeated;
  std::vector<std::string> faults;  ///< "board.heater reboot".

 private:
  [[nodiscard]] std::filesystem::path file(const std::string& name) const { return folder_.path() / (name + ".toml"); }

  void write(const std::string& name, const std::string& tables) const {
    std::ofstream{file(name)} << fmt::format("[scenario]\nname = \"{}\"\nrig = \"{}/fixtures/rigs/{}.toml\"\n", name,
                                             MELTBENCH_SOURCE_DIR, tale_.rig)
                              << fmt::format("duration_s = {}\n{}\n", tale_.duration_s, tables);
  }

  std::vector<decode::Reaction> run(const std::string& name) {
    RunRequest request;
    request.quiet = true;
    request.pace.kind = Pace::Kind::kInProcess;
    request.pace_given = true;
    PreparedRun prepared = prepare(scenario::load(file(name)).front(), folder_.path() / name, request);
    const config::Rig rig = prepared.run.rig;
    const check::CheckSet checks = prepared.checks;
    held_ = checks.judge(execute(prepared, request)).held();
    ChannelLog log{folder_.path() / name / "bus.log", {}};
    decode::Story story{rig};
    log::LogEntry entry;
    while (log.next(entry)) story.take(entry.at, entry.frame);
    story.finish();
    return decode::list_reactions(story.findings(), story.end(), rig);
  }

  Tale tale_;
  test::TemporaryFolder folder_;
  bool held_ = false;
};

std::string make_fault(const std::string& target, const std::string& kind, const std::string& more) {
  return fmt::format("[[fault]]\ntarget = \"{}\"\nkind = \"{}\"\n{}\n", target, kind, more);
}

const std::string kBitTimed = "[bus]\nfidelity = \"bit-timed\"\nrestart_ms = 100\n";

void require_same(const Tale& tale, const std::vector<std::string>& faults) {
  const Round round{tale};
  CHECK(round.faults == faults);
  CHECK(round.difference() == "");
  CHECK(round.has_held());
}

}  // namespace

TEST_CASE("a short circuit is found by its error frames, and its end between the last one and the first frame",
          "[extract]") {
  const auto lasts = GENERATE(as<std::string>{}, "for_s = 1", "for_s = 0.05");
  require_same({.settings = kBitTimed, .faults = make_fault("bus", "short_circuit", "at_s = 2\n" + lasts)},
               {"bus short_circuit"});
}

TEST_CASE("a bus that is held dominant is silent behind its first error", "[extract]") {
  require_same({.settings = kBitTimed, .faults = make_fault("bus", "stuck_dominant", "at_s = 2\nfor_s = 0.05")},
               {"bus stuck_dominant"});
}

TEST_CASE("a node that babbles is named by its identifier and by who does not complain", "[extract]") {
  const auto id = GENERATE(as<std::string>{}, "id = 0x3F0", "id = 1");
  const Round round{
      {.settings = kBitTimed, .faults = make_fault("bus.melt_camera", "babble", "at_s = 2\nfor_s = 0.5\n" + id)}};
  REQUIRE(round.faults.size() == 1);
  CHECK_THAT(round.faults.front(), Contains("babble"));  // With 1 nobody's frame comes through: it could be anyone.
  CHECK(round.difference() == "");
  CHECK(round.has_held());
}

TEST_CASE("a second device with a board's node id is told from a reboot by its going on", "[extract]") {
  require_same({.faults = make_fault("board.heater", "reboot", "at_s = 3")}, {"board.heater reboot"});
  require_same({.faults = make_fault("board.heater", "same_node_id", "at_s = 3")}, {"board.heater same_node_id"});
  require_same({.faults = make_fault("board.heater", "same_node_id", "at_s = 3\nrunning = 1\nfor_s = 2")},
               {"board.heater same_node_id"});
}

TEST_CASE("a controller that starts anew boots all, one that dies leaves its boards to their watchdogs", "[extract]") {
  require_same({.faults = make_fault("program.controller", "restart", "at_s = 3")}, {"program.controller restart"});
  require_same({.faults = make_fault("program.controller", "killed", "at_s = 3")}, {"program.controller killed"});
  require_same({.faults = make_fault("program.controller", "killed", "at_s = 2\nfor_s = 2")},
               {"program.controller killed"});
}

TEST_CASE("a welded relay is found by running the machine again", "[extract]") {
  require_same({.duration_s = 82, .faults = make_fault("actuator.zone2", "welded_on", "at_s = 5")},
               {"actuator.zone2 welded_on"});
}

TEST_CASE("a feeder that bridges is found, though its board reports what it should", "[extract]") {
  require_same({.duration_s = 40, .faults = make_fault("plant", "feeder_bridging", "at_s = 5")},
               {"plant feeder_bridging"});
}

TEST_CASE("a sensor that drifts or is stuck is found by running the machine again", "[extract]") {
  require_same(
      {.duration_s = 20, .faults = make_fault("sensor.melt_pressure", "drift", "at_s = 5\ndrift_Pa_per_s = 2000")},
      {"sensor.melt_pressure drift"});
  require_same({.duration_s = 30, .faults = make_fault("sensor.melt_pressure", "stuck", "at_s = 2")},
               {"sensor.melt_pressure stuck"});
}

TEST_CASE("a slow drift is found before anybody reacts", "[extract]") {
  const Round round{{.duration_s = 20, .faults = make_fault("sensor.zone2", "drift", "at_s = 5\ndrift_K_per_s = 0.2")}};
  CHECK(round.faults == std::vector<std::string>{"sensor.zone2 drift"});
  CHECK(round.recorded.empty());
  CHECK(round.has_held());  // Its check: the temperature ends where it did.
}

TEST_CASE("errors of a serial line that stop the machine are repeated one by one", "[extract]") {
  const Tale tale{.rig = "coupled_serial",
                  .duration_s = 10,
                  .faults = make_fault("line.zones", "noise", "at_s = 5\nfor_s = 2\nshare = 0.1")};
  const Round round{tale};
  REQUIRE(round.recorded.size() == 1);
  CHECK(std::ranges::count(round.faults, "line.zones noise") == std::ssize(round.faults));
  CHECK(round.faults.size() > 3);
  CHECK(round.difference() == "");
}

TEST_CASE("errors of a serial line that nobody minds are a share of its bytes", "[extract]") {
  const Tale tale{.rig = "coupled_serial",
                  .duration_s = 10,
                  .faults = make_fault("line.zones", "noise", "at_s = 5\nfor_s = 2\nshare = 0.002")};
  const Round round{tale};
  CHECK(round.recorded.empty());
  CHECK(round.faults == std::vector<std::string>{"line.zones noise"});
}

TEST_CASE("of two faults the one that the controller let go for is left", "[extract]") {
  const Tale tale{.faults = make_fault("frame", "drop", "id = 0x187\nat_s = 1.5\nfor_s = 0.1") +
                            make_fault("board.heater", "reboot", "at_s = 4")};
  const Round whole{tale};
  CHECK(whole.faults.size() == 2);
  const Round least{tale, true};
  CHECK(least.faults == std::vector<std::string>{"board.heater reboot"});
  CHECK(least.difference() == "");
}
