#include "tests/protocols/link/pseudo_terminal.hpp"
#include "tests/scenario/bench_process.hpp"

using namespace meltbench;
using namespace meltbench::test;

TEST_CASE("slcan: the bench and real boards meet over adapters, and the controller closes its loop", "[scenario]") {
  const TemporaryFolder folder;
  const std::string rig = std::string{MELTBENCH_SOURCE_DIR} + "/fixtures/rigs/bizone.toml";
  const std::filesystem::path scenario = folder.path() / "scenario.toml";
  std::ofstream{scenario} << "[scenario]\nname = \"adapter\"\nrig = \"" << rig << "\"\nduration_s = 5\n"
                          << "[controller]\nboot_timeout_s = 60\n"  // The boards come when their process is there.
                          << "[board.feeder]\npart = \"real\"\n[board.screw_drive]\npart = \"real\"\n"
                          << "[board.melt_pressure]\npart = \"real\"\n";
  // Two hosts on one line: each takes the other for an adapter.
  const std::filesystem::path line = folder.path() / "line";
  BenchProcess bench{
      {"run", scenario, "--can", "slcan:pty:" + line.string() + "@500000", "--out", folder.path() / "out"},
      folder.path() / "bench.txt"};
  while (!std::filesystem::is_symlink(line)) std::this_thread::sleep_for(std::chrono::milliseconds{1});
  BenchProcess boards{
      {"--rig", rig, "--can", "slcan:" + line.string() + "@500000"}, folder.path() / "boards.txt", "plant_emulator"};
  static_cast<void>(bench.wait());
  INFO(bench.output() << boards.output());
  const std::string events = read_file(folder.path() / "out/events.jsonl");
  CHECK(events.find("3 boards configured and started") != std::string::npos);
  CHECK(events.find("\"running\"") != std::string::npos);
  CHECK(read_file(folder.path() / "out/bus.log").find(" 205#") != std::string::npos);  // The feeder's set point.
}

TEST_CASE("slcan: an adapter has no virtual time, and one that is not there is told", "[scenario]") {
  const auto scenario = scenario_file("set_point_step");
  const BenchResult virtual_time = run_bench({"run", scenario, "--pace", "lockstep", "--can", "slcan:/dev/ttyACM77"});
  CHECK(virtual_time.status == 2);
  CHECK_THAT(virtual_time.output, Catch::Contains("no virtual time"));
  const BenchResult missing = run_bench({"run", scenario, "--can", "slcan:/dev/ttyACM77"});
  CHECK(missing.status == 2);
  CHECK_THAT(missing.output, Catch::Contains("/dev/ttyACM77") && Catch::Contains("by-id"));
}

TEST_CASE("slcan: a log is replayed onto an adapter, and what that refuses is told", "[scenario]") {
  const TemporaryFolder folder;
  std::ofstream{folder / "night.log"}
      << "(1.000000) can0 181#0102\n"
         "(1.002000) can0 20000088#0000000000000000\n"  // An error frame stays where it was.
         "(1.004000) can0 01234567#R\n"
         "(1.004000) can1 701#05\n";
  const Device adapter;
  BenchProcess replay{{"replay", folder / "night.log", "--can", "slcan:" + adapter.name() + "@250000", "--loop", "0"},
                      folder / "said.txt"};
  const std::string expected = "\rC\rS5\rO\rt18120102\rR012345670\r";
  CHECK(adapter.read(expected.size()) == expected);
  adapter.write("z\r\a");
  ::kill(replay.pid(), SIGINT);
  const int status = replay.wait();
  INFO(replay.output());
  CHECK(status == 0);
  CHECK_THAT(replay.output(), Catch::Contains("frames sent on " + adapter.name()) && Catch::Contains("0 not for") &&
                                  Catch::Contains("1 of them refused by the adapter"));
}
