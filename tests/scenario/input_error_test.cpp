#include <algorithm>

#include "protocols/link/bench_socket.hpp"
#include "tests/scenario/bench_process.hpp"

using namespace meltbench;
using namespace meltbench::test;

namespace {

const std::string kRig = std::string{MELTBENCH_SOURCE_DIR} + "/fixtures/rigs/bizone.toml";

std::string scenario_text(const std::string& more) {
  return "[scenario]\nname = \"bad\"\nrig = \"" + kRig + "\"\nduration_s = 1\n" + more;
}

}  // namespace

TEST_CASE("Bad input: one clear error with its place and a hint, and exit status 2", "[scenario]") {
  const auto [what, text, expected] = GENERATE_COPY(table<std::string, std::string, std::string>({
      {"unknown key", scenario_text("[controller]\nlawn = \"open_loop\"\n"), "law"},
      {"unknown law", scenario_text("[controller]\nlaw = \"magic\"\n"), "exact_predictor"},
      {"wrong unit", scenario_text("[plant]\nx0_mm = 100\n"), "x0_m"},
      {"set point beyond the screw", scenario_text("[controller]\nset_point_m = 0.2\n"), "set_point_m"},
      {"set point of zero", scenario_text("[controller]\nset_point_m = 0\n"), "set_point_m"},
      {"missing EDS", scenario_text("[board.feeder]\neds = \"nowhere.eds\"\n"), "nowhere.eds"},
      {"node id twice", scenario_text("[board.feeder]\nnode_id = 6\n"), "node_id"},
      {"unknown event", scenario_text("[[event]]\nat_s = 1\ntarget = \"controller\"\naction = \"dance\"\n"), "dance"},
      {"event that nobody reads", scenario_text("[[event]]\nat_s = 1\ntarget = \"plant\"\naction = \"clog\"\n"),
       "plant"},
      {"unknown check", scenario_text("[[check]]\nname = \"x\"\nkind = \"beautiful\"\n"), "beautiful"},
      {"check of an unknown signal",
       scenario_text("[[check]]\nname = \"x\"\nkind = \"band\"\nsignal = \"plant.x_mm\"\nmin = 0\nmax = 1\n"),
       "plant.x_m"},
      {"no duration", "[scenario]\nname = \"bad\"\nrig = \"" + kRig + "\"\n", "duration_s"},
      {"no rig", "[scenario]\nname = \"bad\"\nrig = \"nowhere.toml\"\nduration_s = 1\n", "nowhere.toml"},
      {"broken TOML", "[scenario\n", "scenario.toml:1:"},
  }));
  const TemporaryFolder folder;
  const auto scenario = folder.path() / "scenario.toml";
  std::ofstream{scenario} << text;
  const BenchResult run = run_bench({"run", scenario, "--out", folder.path() / "out"});
  INFO(what << ":\n" << run.output);
  CHECK(run.status == 2);
  CHECK(run.output.starts_with("error: "));
  CHECK_THAT(run.output, Catch::Contains(".toml:") && Catch::Contains(expected) && Catch::Contains("\nhint: "));
  CHECK_FALSE(std::filesystem::exists(folder.path() / "out"));  // Nothing is begun that cannot be done.
}

TEST_CASE("Bad usage: files that are not there, paces that do not exist, buses that are taken", "[scenario]") {
  const std::string good = scenario_file("delay_compensation");
  const std::string log = std::string{MELTBENCH_SOURCE_DIR} + "/fixtures/recordings/board_reboot.log.gz";
  auto [arguments, expected] = GENERATE_COPY(table<std::vector<std::string>, std::string>({
      {{"run", "nowhere.toml"}, "nowhere.toml"},
      {{"run", good, "--pace", "fast"}, "realtime:FACTOR"},
      {{"run", good, "--pace", "realtime", "--in-process"}, "--in-process"},
      {{"run", good, "--can", "nosuchcan7", "--out", "OUT"}, "nosuchcan7"},
      {{"run", good, "--can", "can 0"}, "no CAN bus"},
      {{"run", good, "--out", "/proc/nowhere"}, "/proc/nowhere"},
      {{"run", good, "--tap", "can0", "--out", "OUT"}, "--tap can0"},
      {{"run", good, "--tap", "29536", "--can", "can0"}, "a kernel bus is open to every program"},
      {{"run", good, "--tap-wait", "1"}, "--tap"},
      {{"run", good, "--slcan-pty", "/proc/nowhere", "--out", "OUT"}, "/proc/nowhere"},
      {{"report", "/nowhere"}, "/nowhere"},
      {{"fly"}, "fly"},
      {{"replay", log, "--speed", "2"}, "--speed requires --can"},
      {{"replay", log, "--to", "controller", "--can", "can0", "--speed", "2"}, "excludes"},
      {{"replay", log}, "meltbench replay --help"},
      {{"convert", log, "/proc/x.mp3"}, "NAME.log"},
      {{"convert", log, "/proc/x.blf.gz"}, "leave .gz away"},
      {{"show", "nowhere.log"}, "nowhere.log: No such file"},
      {{"show", log, "--scenario", scenario_file("set_point_step"), "--channel", "can7"}, "it has "},
      {std::vector<std::string>{}, "subcommand"},
  }));
  const TemporaryFolder folder;
  std::ranges::replace(arguments, "OUT", folder.path() / "out");  // Each of them has a folder of its own.
  const BenchResult run = run_bench(arguments);
  INFO(run.output);
  CHECK(run.status == 2);
  CHECK_THAT(run.output, Catch::Contains(expected));
  CHECK(std::filesystem::is_empty(folder.path()));
}

TEST_CASE("Bad usage: a bus name that another run uses is refused", "[scenario]") {
  const TemporaryFolder folder;
  const link::UniqueFd other_run = link::listen_embedded_bus("taken-by-a-test");
  const BenchResult run = run_bench({"run", scenario_file("delay_compensation"), "--can", "virtual:taken-by-a-test",
                                     "--pace", "realtime", "--out", folder.path() / "out"});
  link::remove_embedded_bus("taken-by-a-test");
  INFO(run.output);
  CHECK(run.status == 2);
  CHECK_THAT(run.output, Catch::Contains("running already") && Catch::Contains("hint: "));
  CHECK(std::filesystem::is_empty(folder.path()));
}

TEST_CASE("Bad usage: the emulator and the controller explain themselves when started by hand", "[scenario]") {
  const std::string program = GENERATE("plant_emulator", "controller");
  const BenchResult no_bus = run_bench({"--rig", kRig, "--can", "virtual:no-such-bench"}, program);
  INFO(no_bus.output);
  CHECK(no_bus.status == 2);
  CHECK_THAT(no_bus.output, Catch::Contains("no-such-bench") && Catch::Contains("hint: "));
  const BenchResult no_rig = run_bench({"--rig", "nowhere.toml"}, program);
  CHECK(no_rig.status == 2);
  CHECK_THAT(no_rig.output, Catch::Contains("nowhere.toml"));
}

TEST_CASE("Bad usage: a port that a program of the run cannot open is bad usage of the run", "[scenario]") {
  const TemporaryFolder folder;
  const BenchResult run =
      run_bench({"run", scenario_file("feeder_serial"), "--line", "dosing=/dev/null", "--out", folder.path() / "out"});
  INFO(run.output);
  CHECK(run.status == 2);
  CHECK_THAT(run.output, Catch::Contains("/dev/null is no serial port") && Catch::Contains("plant_emulator ended"));
}
