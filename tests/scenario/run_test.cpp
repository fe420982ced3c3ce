#include <nlohmann/json.hpp>

#include "bench/record/load_recording.hpp"
#include "tests/scenario/bench_process.hpp"

using namespace meltbench;
using namespace meltbench::test;

namespace {

/// A short run of the exact predictor; `text` is put behind it.
std::filesystem::path write_scenario(const std::filesystem::path& folder, double duration_s,
                                     const std::string& text = "") {
  const auto path = folder / "scenario.toml";
  std::ofstream{path} << "[scenario]\nname = \"short\"\nrig = \"" << MELTBENCH_SOURCE_DIR
                      << "/fixtures/rigs/bizone.toml\"\nduration_s = " << duration_s << "\n"
                      << text;
  return path;
}

/// Waits until the run has written a good part of its recording: it is in the middle of things.
void wait_until_recording(const std::filesystem::path& folder) {
  std::error_code error;
  while (std::filesystem::file_size(folder / "bus.log", error) < 200'000 || error) {
    std::this_thread::sleep_for(std::chrono::milliseconds{1});
  }
}

}  // namespace

TEST_CASE("Run: two runs with one seed leave the same bytes", "[scenario]") {
  const TemporaryFolder folder;
  const auto scenario = write_scenario(folder.path(), 20);
  const auto run = [&](const std::string& out, const std::vector<std::string>& more) {
    std::vector<std::string> arguments{"run", scenario, "--out", folder.path() / out, "--quiet"};
    arguments.insert(arguments.end(), more.begin(), more.end());
    const BenchResult result = run_bench(arguments);
    INFO(result.output);
    REQUIRE(result.status == 0);
  };
  const std::vector<std::string> files{"bus.log", "signals.csv", "result.json", "events.jsonl", "junit.xml"};
  const auto equal = [&](const std::string& one, const std::string& other, const std::string& file) {
    return read_file(folder.path() / one / file) == read_file(folder.path() / other / file);
  };
  run("a", {"--seed", "7"});
  SECTION("on a machine that is busy with something else") {
    std::atomic<bool> busy{true};
    std::vector<std::thread> load;
    for (int i = 0; i < 4; ++i) {
      load.emplace_back([&busy] {
        while (busy) {
        }
      });
    }
    run("b", {"--seed", "7"});
    busy = false;
    for (std::thread& thread : load) thread.join();
    for (const std::string& file : files) CHECK(equal("a", "b", file));
  }
  SECTION("as objects of one process instead of three processes: the same frames and signals") {
    run("b", {"--seed", "7", "--in-process"});
    CHECK(equal("a", "b", "bus.log"));
    CHECK(equal("a", "b", "signals.csv"));
  }
  SECTION("and another seed gives other bytes: the boards sample at another phase") {
    run("b", {"--seed", "8"});
    CHECK_FALSE(equal("a", "b", "signals.csv"));
  }
  SECTION("repeated from its repro.toml, which is all that is needed") {
    const BenchResult result =
        run_bench({"run", folder.path() / "a/repro.toml", "--out", folder.path() / "b", "--quiet"});
    INFO(result.output);
    REQUIRE(result.status == 0);
    CHECK(equal("a", "b", "bus.log"));
    CHECK(equal("a", "b", "signals.csv"));
  }
}

TEST_CASE("Run: a lost participant ends it with status 3, its name, and a readable recording", "[scenario]") {
  const TemporaryFolder folder;
  const auto scenario = write_scenario(folder.path(), 36'000);
  const auto out = folder.path() / "out";
  BenchProcess bench{{"run", scenario, "--out", out}, folder.path() / "output"};
  wait_until_recording(out);
  std::string culprit;
  SECTION("killed emulator") {
    ::kill(bench.find_child("plant_emulator"), SIGKILL);
    culprit = "plant has died";
  }
  SECTION("killed controller") {
    ::kill(bench.find_child("controller"), SIGKILL);
    culprit = "controller has died";
  }
  SECTION("hanging emulator") {
    ::kill(bench.find_child("plant_emulator"), SIGSTOP);
    culprit = "plant hangs";
  }
  SECTION("Ctrl-C") {
    ::kill(bench.pid(), SIGINT);
    culprit = "interrupted";
  }
  CHECK(bench.wait() == 3);
  CHECK_THAT(bench.output(), Catch::Contains(culprit));
  const record::Recording recording = record::load_recording(out);
  CHECK(recording.row_count() > 100);
  CHECK(recording.frames.size() > 1000);
  CHECK_THAT(recording.ending.text, Catch::Contains(culprit));
  CHECK(std::filesystem::exists(out / "report.html"));
}

TEST_CASE("Run: no child process outlives a bench that was killed", "[scenario]") {
  const TemporaryFolder folder;
  const auto scenario = write_scenario(folder.path(), 36'000);
  const auto out = folder.path() / "out";
  BenchProcess bench{{"run", scenario, "--out", out}, folder.path() / "output"};
  wait_until_recording(out);
  const pid_t emulator = bench.find_child("plant_emulator");
  const pid_t controller = bench.find_child("controller");
  ::kill(bench.pid(), SIGKILL);
  CHECK(bench.wait() == 128 + SIGKILL);
  const auto gone = [](pid_t process) {
    for (int i = 0; i < 2000 && ::kill(process, 0) == 0; ++i) {
      // A killed process whose new parent has not yet fetched its status is gone, too.
      if (read_file("/proc/" + std::to_string(process) + "/stat").find(") Z ") != std::string::npos) return true;
      std::this_thread::sleep_for(std::chrono::milliseconds{1});
    }
    return ::kill(process, 0) != 0;
  };
  CHECK(gone(emulator));
  CHECK(gone(controller));
  const record::Recording recording = record::load_recording(out);
  CHECK(recording.ending.reason == record::EndReason::kCutShort);
  CHECK(recording.row_count() > 100);
}

TEST_CASE("Run: a folder of a variant that is gone goes with the next run; what is not ours stays", "[scenario]") {
  const TemporaryFolder folder;
  const auto out = folder.path() / "out";
  const auto variants = [](const std::string& second) {
    return "[[variant]]\nname = \"one\"\n[[variant]]\nname = \"" + second + "\"\n";
  };
  REQUIRE(run_bench({"run", write_scenario(folder.path(), 1, variants("two")), "--in-process", "--out", out}).status ==
          0);
  std::filesystem::copy(out / "two", out / "another");
  std::filesystem::create_directories(out / "other");
  REQUIRE(run_bench({"run", scenario_file("set_point_step"), "--in-process", "--out", out / "other"}).status == 0);
  std::ofstream{out / "two/notes.txt"} << "of the user";
  REQUIRE(
      run_bench({"run", write_scenario(folder.path(), 1, variants("three")), "--in-process", "--out", out}).status ==
      0);
  CHECK(std::filesystem::exists(out / "one/result.json"));
  CHECK(std::filesystem::exists(out / "three/result.json"));
  CHECK_FALSE(std::filesystem::exists(out / "another"));
  CHECK_FALSE(std::filesystem::exists(out / "two/events.jsonl"));
  CHECK(std::filesystem::exists(out / "two/notes.txt"));
  CHECK(std::filesystem::exists(out / "other/result.json"));  // A run of another scenario.
}

TEST_CASE("Run: the command that repeats a run keeps its pace", "[scenario]") {
  const TemporaryFolder folder;
  const auto scenario = write_scenario(folder.path(), 0.2);
  const auto repeat_of = [&](const std::vector<std::string>& pace) {
    std::vector<std::string> words{"run", scenario, "--seed", "5", "--out", folder.path() / "out"};
    words.insert(words.end(), pace.begin(), pace.end());
    static_cast<void>(run_bench(words));
    return record::load_recording(folder.path() / "out").info.repeat_command;
  };
  const std::string command = "meltbench run " + scenario.string() + " --seed 5";
  CHECK(repeat_of({}) == command);
  CHECK(repeat_of({"--in-process"}) == command + " --in-process");
  CHECK(repeat_of({"--pace", "realtime:8"}) == command + " --pace realtime:8");
}

TEST_CASE("Run: result.json has the names that scripts rely on", "[scenario]") {
  const TemporaryFolder folder;
  const auto scenario = write_scenario(folder.path(), 2, R"(
[[check]]
name = "stays inside"
kind = "band"
signal = "plant.x_m"
min = 0.0
max = 0.2
)");
  const BenchResult run = run_bench({"run", scenario, "--out", folder.path() / "out", "--seed", "3"});
  INFO(run.output);
  REQUIRE(run.status == 0);
  const auto result = nlohmann::json::parse(read_file(folder.path() / "out/result.json"));
  CHECK(result.at("scenario") == "short");
  CHECK(result.at("seed") == 3);
  CHECK(result.at("held") == true);
  CHECK(result.at("real_time_factor").is_null());  // There is no wall clock in a virtual run's result.
  CHECK(result.at("bus").is_object());
  const auto& check = result.at("checks").at(0);
  for (const char* key : {"name", "held", "margin", "unit", "at_s"}) CHECK(check.contains(key));
  const std::string signals = read_file(folder.path() / "out/signals.csv");
  CHECK(signals.starts_with("t_s,"));
  const std::string header = signals.substr(0, signals.find('\n'));
  for (const char* name : {"plant.x_m", "plant.U", "plant.delay_s", "plant.flow_kg_per_s", "plant.pressure_Pa",
                           "controller.P_m", "controller.U_command"}) {
    CHECK_THAT(header, Catch::Contains(name));
  }
}

TEST_CASE("Run: a failed check is exit status 1, and says by how much", "[scenario]") {
  const TemporaryFolder folder;
  const auto scenario = write_scenario(folder.path(), 2, R"(
[[check]]
name = "impossible"
kind = "band"
signal = "plant.x_m"
min = 0.15
max = 0.2
)");
  const BenchResult run = run_bench({"run", scenario, "--out", folder.path() / "out"});
  CHECK(run.status == 1);
  CHECK_THAT(run.output, Catch::Contains("FAILED") && Catch::Contains("impossible"));
}

TEST_CASE("Run: wall-clock pace boots the boards and controls over the same wire", "[scenario]") {
  const TemporaryFolder folder;
  const auto scenario = write_scenario(folder.path(), 4);
  const BenchResult run = run_bench({"run", scenario, "--out", folder.path() / "out", "--pace", "realtime:4"});
  INFO(run.output);
  // The machine may be too slow for its deadlines, which the health gate then says: that is a failed check, no more.
  CHECK((run.status == 0 || run.status == 1));
  const record::Recording recording = record::load_recording(folder.path() / "out");
  CHECK(recording.ending.reason == record::EndReason::kCompleted);
  CHECK(recording.row_count() == 401);
  const auto state = recording.find_signal("controller.U_command");
  REQUIRE(state.has_value());
  CHECK(recording.value(300, *state) > 0.0);
}

TEST_CASE("Report: the page can be made anew from the run's folder, and judged anew", "[scenario]") {
  const TemporaryFolder folder;
  const auto scenario = write_scenario(folder.path(), 2);
  const auto out = folder.path() / "out";
  REQUIRE(run_bench({"run", scenario, "--out", out}).status == 0);
  const std::string page = read_file(out / "report.html");
  const std::string result = read_file(out / "result.json");
  std::filesystem::remove(out / "report.html");
  REQUIRE(run_bench({"report", out}).status == 0);
  CHECK(read_file(out / "report.html") == page);
  REQUIRE(run_bench({"check", out}).status == 0);
  CHECK(read_file(out / "result.json") == result);
}
