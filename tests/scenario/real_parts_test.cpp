#include "bench/record/load_recording.hpp"
#include "tests/scenario/bench_process.hpp"

using namespace meltbench;
using namespace meltbench::test;

namespace {

const std::string kRig = std::string{MELTBENCH_SOURCE_DIR} + "/fixtures/rigs/bizone.toml";

constexpr const char* kRealBoards = R"(
[board.feeder]
part = "real"
[board.screw_drive]
part = "real"
[board.melt_pressure]
part = "real"
)";

std::filesystem::path write_scenario(const std::filesystem::path& folder, const std::string& text) {
  const auto path = folder / "scenario.toml";
  std::ofstream{path} << "[scenario]\nname = \"parts\"\nrig = \"" << kRig << "\"\nduration_s = 6\n" << text;
  return path;
}

std::string band(const std::string& name, const std::string& signal, double min, double max, double from_s) {
  std::ostringstream text;
  text << "[[check]]\nname = \"" << name << "\"\nkind = \"band\"\nsignal = \"" << signal << "\"\nmin = " << min
       << "\nmax = " << max << "\nfrom_s = " << from_s << "\n";
  return text.str();
}

/// A bench at three times wall-clock speed on an embedded bus of its own, and a program started by hand that joins it.
class RunWithOutsider {
 public:
  RunWithOutsider(const std::filesystem::path& folder, const std::filesystem::path& scenario,
                  const std::string& program, const std::vector<std::string>& pace = {"--pace", "realtime:3"})
      : bus_{"virtual:t" + std::to_string(::getpid())} {
    std::vector<std::string> arguments{"run", scenario, "--out", folder / "out", "--can", bus_};
    arguments.insert(arguments.end(), pace.begin(), pace.end());
    bench_.emplace(arguments, folder / "output");
    while (bench_->output().find(bus_) == std::string::npos) std::this_thread::sleep_for(std::chrono::milliseconds{1});
    outsider_.emplace(std::vector<std::string>{"--rig", kRig, "--can", bus_}, folder / "outsider", program);
  }
  int wait() { return bench_->wait(); }
  int wait_for_outsider() { return outsider_->wait(); }
  [[nodiscard]] std::string output() const { return bench_->output() + outsider_->output(); }

 private:
  std::string bus_;
  std::optional<BenchProcess> bench_;
  std::optional<BenchProcess> outsider_;
};

}  // namespace

TEST_CASE("Real parts: boards that the bench does not emulate are controlled, and judged by what is on the wire",
          "[scenario]") {
  const TemporaryFolder folder;
  const auto scenario = write_scenario(folder.path(), std::string{"[controller]\nboot_timeout_s = 60\n"} + kRealBoards +
                                                          band("filled length", "plant.x_m", 0, 0.2, 3) +
                                                          band("flow on the wire", "wire.feeder.2001", 1, 22, 5) +
                                                          band("set point on the wire", "wire.feeder.2000", 1, 22, 5) +
                                                          band("command", "controller.U_command", 0, 1, 5));
  RunWithOutsider run{folder.path(), scenario, "plant_emulator"};  // It stands for the machine.
  const int status = run.wait();
  const std::string output = run.output();
  INFO(output);
  CHECK((status == 0 || status == 1));  // The machine may be too slow for its deadlines: the health gate says so.
  CHECK_THAT(output, Catch::Contains("skipped filled length"));
  CHECK_THAT(output, Catch::Contains("held    flow on the wire"));
  CHECK_THAT(output, Catch::Contains("held    set point on the wire"));
  CHECK_THAT(output, Catch::Contains("held    command"));
  CHECK_THAT(read_file(folder.path() / "out/junit.xml"),
             Catch::Contains("skipped=\"1\"") && Catch::Contains("<skipped"));
  CHECK_THAT(read_file(folder.path() / "out/result.json"), Catch::Contains("\"skipped\""));
  CHECK(run.wait_for_outsider() == 0);  // It is told when the run is over.
}

TEST_CASE("Real parts: an external controller joins a running bench, and its frames move the emulated plant",
          "[scenario]") {
  const TemporaryFolder folder;
  // From 3 s on: on a busy host the plant's first rows come late.
  const auto scenario =
      write_scenario(folder.path(), "[controller]\nexternal = true\n" + band("filled length", "plant.x_m", 0, 0.2, 3) +
                                        band("command", "controller.U_command", 0, 1, 5));
  SECTION("at wall-clock pace, whenever it comes") {
    RunWithOutsider run{folder.path(), scenario, "controller"};
    const int status = run.wait();
    INFO(run.output());
    CHECK((status == 0 || status == 1));
    CHECK_THAT(run.output(), Catch::Contains("held    filled length") && Catch::Contains("skipped command"));
    const record::Recording recording = record::load_recording(folder.path() / "out");
    CHECK(std::ranges::any_of(recording.events, [](const record::RecordedEvent& e) {
      return e.source == "controller" && e.event.code == "running";
    }));
    CHECK(run.wait_for_outsider() == 0);
  }
  SECTION("in lockstep, where the run waits for it, and knows its signals") {
    RunWithOutsider run{folder.path(), scenario, "controller", {"--pace", "lockstep"}};
    const int status = run.wait();
    INFO(run.output());
    CHECK(status == 0);
    CHECK_THAT(run.output(), Catch::Contains("6 s") && Catch::Contains("held    command"));
    CHECK(run.wait_for_outsider() == 0);
  }
}

TEST_CASE("Real parts: what they cannot do is refused with a hint before anything starts", "[scenario]") {
  const TemporaryFolder folder;
  const auto [text, words, expected] = GENERATE_COPY(table<std::string, std::vector<std::string>, std::string>({
      {kRealBoards, {"--pace", "lockstep"}, "--pace realtime"},
      {kRealBoards, {"--in-process"}, "--pace realtime"},
      {"[controller]\nexternal = true\n", {"--in-process"}, "--pace realtime"},
      {std::string{kRealBoards} + "[[event]]\nat_s = 1\ntarget = \"plant\"\naction = \"material\"\n", {}, "real"},
      {"[controller]\nexternal = true\n[[event]]\nat_s = 1\ntarget = \"controller\"\naction = \"set_point\"\n",
       {},
       "external"},
      {kRealBoards + band("typo", "controller.U_comand", 0, 1, 0), {}, "controller.U_command"},
      {kRealBoards + band("typo", "wire.feeder.2FFF", 0, 1, 0), {}, "wire.feeder"},
      {"[board.feeder]\npart = \"unreal\"\n", {}, "emulated"},
  }));
  std::vector<std::string> arguments{"run", write_scenario(folder.path(), text), "--out", folder.path() / "out"};
  arguments.insert(arguments.end(), words.begin(), words.end());
  const BenchResult run = run_bench(arguments);
  INFO(text << run.output);
  CHECK(run.status == 2);
  CHECK_THAT(run.output, Catch::Contains(expected));
  CHECK_FALSE(std::filesystem::exists(folder.path() / "out"));
}

TEST_CASE("Real parts: a rig without emulated boards gives the emulator nothing to do, and it says so", "[scenario]") {
  const TemporaryFolder folder;
  const auto rig = folder.path() / "rig.toml";
  std::string text = read_file(kRig);
  const std::string boards = std::string{MELTBENCH_SOURCE_DIR} + "/fixtures/boards/";
  for (std::size_t at = text.find("../boards/"); at != std::string::npos; at = text.find("../boards/", at)) {
    text.replace(at, 10, boards);
  }
  for (std::size_t at = text.find("kind         ="); at != std::string::npos;
       at = text.find("kind         =", at + 20)) {
    text.insert(at, "part = \"real\"\n");
  }
  std::ofstream{rig} << text;
  const BenchResult run = run_bench({"--rig", rig, "--can", "virtual:nobody"}, "plant_emulator");
  CHECK(run.status == 2);
  CHECK_THAT(run.output, Catch::Contains("nothing to emulate"));
}
