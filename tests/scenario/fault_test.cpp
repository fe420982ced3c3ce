#include "tests/scenario/bench_process.hpp"

using namespace meltbench;
using namespace meltbench::test;

namespace {

const std::string kRigs = std::string{MELTBENCH_SOURCE_DIR} + "/fixtures/rigs/";

std::filesystem::path write_scenario(const std::filesystem::path& folder, const std::string& rig, double duration_s,
                                     const std::string& more) {
  const auto path = folder / "scenario.toml";
  std::ofstream{path} << "[scenario]\nname = \"faulty\"\nrig = \"" << kRigs << rig << "\"\nduration_s = " << duration_s
                      << "\n"
                      << more;
  return path;
}

}  // namespace

TEST_CASE("Faults: what the way of a run's frames, bytes and clocks leaves no room for is refused with the reason",
          "[scenario]") {
  const std::string frame = "[[fault]]\ntarget = \"frame\"\nkind = \"drop\"\nat_s = 1\n";
  const std::string clock = "[[fault]]\ntarget = \"clock.plant\"\nkind = \"drift\"\ndrift_ppm = 100\nat_s = 1\n";
  const std::string line = "[[fault]]\ntarget = \"line.dosing\"\nkind = \"drop\"\nat_s = 1\n";
  const std::string plant = "[[fault]]\ntarget = \"plant\"\nkind = \"hopper_empty\"\nat_s = 1\n";
  const std::string real = "[board.screw_drive]\npart = \"real\"\n";
  const std::string timed = "[bus]\nfidelity = \"bit-timed\"\n";
  const std::string wire = "[[fault]]\ntarget = \"bus.controller\"\nkind = \"bus_off\"\nat_s = 1\n";
  const std::string twin = "[[fault]]\ntarget = \"board.feeder\"\nkind = \"same_node_id\"\nat_s = 1\n";
  const auto [rig, text, words, expected] =
      GENERATE_COPY(table<std::string, std::string, std::vector<std::string>, std::string>({
          {"bizone.toml", frame, {"--can", "can0"}, "cangw"},
          {"bizone.toml", frame, {"--can", "slcan:/dev/ttyACM0@500000"}, "behind an adapter"},
          {"bizone.toml", timed + wire, {"--can", "vcan0"}, "the kernel carries the frames"},
          {"bizone.toml", twin, {"--can", "vcan0"}, "the kernel carries the frames"},
          {"bizone.toml", timed + wire + "[controller]\nexternal = true\n", {}, "the controller is external"},
          {"bizone.toml", clock, {"--pace", "realtime"}, "the clock of this machine"},
          {"bizone_serial.toml", line, {"--pace", "realtime", "--line", "dosing=/dev/ttyS9"}, "/dev/ttyS9"},
          {"bizone.toml", real + plant, {}, "the model is not the machine"},
      }));
  const TemporaryFolder folder;
  std::vector<std::string> arguments{"run", write_scenario(folder.path(), rig, 2, text), "--out",
                                     folder.path() / "out"};
  arguments.insert(arguments.end(), words.begin(), words.end());
  const BenchResult run = run_bench(arguments);
  INFO(text << run.output);
  CHECK(run.status == 2);
  CHECK_THAT(run.output, Catch::Contains(expected) && Catch::Contains("fault.target = ") && Catch::Contains("hint: "));
  CHECK_FALSE(std::filesystem::exists(folder.path() / "out"));
}
