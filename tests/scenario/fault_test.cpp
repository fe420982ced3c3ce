#include <unistd.h>

#include "bench/record/load_recording.hpp"
#include "protocols/link/bench_socket.hpp"
#include "protocols/runtime/bench_protocol.hpp"
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

/// A bench that runs on an embedded bus of its own, in a folder of buses of its own: nobody else is asked.
class LiveBench {
 public:
  LiveBench(const std::filesystem::path& folder, const std::filesystem::path& scenario,
            const std::vector<std::string>& more)
      : folder_{folder}, bus_{"live" + std::to_string(::getpid())} {
    ::setenv("XDG_RUNTIME_DIR", folder.c_str(), 1);
    std::vector<std::string> words{"run", scenario, "--out", folder / "out", "--can", "virtual:" + bus_};
    words.insert(words.end(), more.begin(), more.end());
    process_.emplace(words, folder / "output");
  }
  ~LiveBench() { ::unsetenv("XDG_RUNTIME_DIR"); }
  LiveBench(const LiveBench&) = delete;
  LiveBench& operator=(const LiveBench&) = delete;
  /// Its exit status, once it has ended.
  int wait() { return process_->wait(); }
  void stop() const { ::kill(process_->pid(), SIGTERM); }
  [[nodiscard]] std::string output() const { return process_->output(); }

  /// "meltbench fault", as soon as the bench is there.
  [[nodiscard]] BenchResult fault(std::vector<std::string> words, const std::string& bench) const {
    words.insert(words.begin(), {"fault", bench});
    while (true) {
      BenchResult result = run_bench(words);
      const bool is_over = output().find("report:") != std::string::npos;
      if (is_over || result.output.find("is running") == std::string::npos) return result;
    }
  }
  [[nodiscard]] BenchResult fault(const std::vector<std::string>& words) const { return fault(words, bus_); }

  /// A connection to it, as soon as it is there.
  [[nodiscard]] link::BenchSocket connect() const {
    while (true) {
      try {
        return link::BenchSocket{link::connect_embedded_bus(bus_)};
      } catch (const link::LinkError&) {
        std::this_thread::sleep_for(std::chrono::milliseconds{1});
      }
    }
  }
  [[nodiscard]] std::string read(const std::string& file) const { return read_file(folder_ / "out" / file); }

 private:
  std::filesystem::path folder_;
  std::string bus_;
  std::optional<BenchProcess> process_;
};

void ask(link::BenchSocket& socket, runtime::Question::About about, const std::string& text = {}) {
  link::MessageWriter writer;
  runtime::write_question(writer, {about, text});
  REQUIRE(socket.send(writer.bytes()));
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

TEST_CASE("Faults: given to a run in lockstep they happen at once, and its repro.toml repeats it to the byte",
          "[scenario]") {
  const TemporaryFolder folder;
  LiveBench bench{folder.path(), write_scenario(folder.path(), "bizone.toml", 240, ""), {}};
  const BenchResult stuck = bench.fault({"target = \"sensor.melt_pressure\", kind = \"stuck\""});
  CHECK(stuck.status == 0);
  CHECK_THAT(stuck.output, Catch::Contains("sensor.melt_pressure stuck begins at "));
  const BenchResult drop =
      bench.fault({"target = \"frame\", kind = \"drop\", probability = 0.2, at_frame = { id = 0x80, n = 7 }"},
                  folder.path() / "out");  // By its folder.
  CHECK_THAT(drop.output, Catch::Contains("frame drop waits for its trigger from "));
  const BenchResult cleared = bench.fault({"--clear", "sensor.melt_pressure stuck"});
  CHECK_THAT(cleared.output, Catch::Contains("sensor.melt_pressure stuck ends at "));
  INFO(stuck.output << drop.output << cleared.output);
  CHECK(bench.wait() == 1);  // The health gate: a fault was told of by the controller.
  INFO(bench.output());
  const std::string events = bench.read("events.jsonl");
  CHECK_THAT(events, Catch::Contains("fault-given") && Catch::Contains("fault-on") && Catch::Contains("fault-cleared"));
  CHECK_THAT(bench.read("report.html"), Catch::Contains("meltbench run repro.toml"));
  const auto again = folder.path() / "again";
  CHECK(run_bench({"run", folder.path() / "out/repro.toml", "--in-process", "--out", again}).status == 1);
  CHECK((read_file(again / "bus.log") == bench.read("bus.log")));
  CHECK((read_file(again / "signals.csv") == bench.read("signals.csv")));
}

TEST_CASE("Faults: at wall-clock pace they are given, cleared, listed and refused, whoever else hangs at the bench",
          "[scenario]") {
  const TemporaryFolder folder;
  LiveBench bench{folder.path(), write_scenario(folder.path(), "bizone.toml", 20, ""), {"--pace", "realtime:4"}};
  const link::BenchSocket silent = bench.connect();
  const link::BenchSocket silent_too = bench.connect();
  link::BenchSocket babbler = bench.connect();
  REQUIRE(babbler.send(std::vector<std::uint8_t>{1, 2, 3}));
  link::BenchSocket impatient = bench.connect();
  ask(impatient, runtime::Question::About::kBeginFault, "target = \"frame\", kind = \"drop\", count = 1");
  impatient = link::BenchSocket{link::UniqueFd{}};
  const BenchResult on = bench.fault({"target = \"actuator.feed\", kind = \"dead\", name = \"empty\""});
  CHECK(on.status == 0);
  const BenchResult list = bench.fault({"--list"});
  CHECK_THAT(list.output, Catch::Contains("on      empty, until it is cleared") && Catch::Contains("sensor.encoder") &&
                              !Catch::Contains("clock.plant"));
  const BenchResult refused = bench.fault({"target = \"frame\", kind = \"babble\""});
  CHECK(refused.status == 2);
  CHECK_THAT(refused.output, Catch::Contains("error: fault:1:") && Catch::Contains("hint: it can: drop, delay"));
  CHECK_THAT(bench.fault({"target = \"clock.plant\", kind = \"step\", step_ms = 1"}).output,
             Catch::Contains("the clock of this machine"));
  CHECK(bench.fault({"--clear", "empty"}).status == 0);
  const BenchResult unknown = bench.fault({"--clear", "empty"});
  CHECK(unknown.status == 2);
  INFO(on.output << list.output << refused.output << unknown.output);
  CHECK((bench.wait() != 3));
  const record::Recording recording = record::load_recording(folder.path() / "out");
  CHECK(recording.ending.reason == record::EndReason::kCompleted);
  const auto count = [&](const std::string& code) {
    return std::ranges::count_if(recording.events, [&](const auto& one) { return one.event.code == code; });
  };
  CHECK(count("fault-given") == 2);
  CHECK(count("fault-on") == 2);
  CHECK(count("fault-cleared") == 1);
  CHECK_THAT(bench.read("repro.toml"), Catch::Contains("name = \"empty\"") && Catch::Contains("cleared_at_s = "));
}

TEST_CASE("Faults: who asks a bench that ends instead of answering is told, as is who finds none", "[scenario]") {
  const TemporaryFolder folder;
  const auto scenario = write_scenario(folder.path(), "bizone.toml", 5, "[controller]\nexternal = true\n");
  LiveBench bench{folder.path(), scenario, {}};  // Waits for a controller that does not come.
  link::BenchSocket asking = bench.connect();
  ask(asking, runtime::Question::About::kFaults);
  bench.stop();
  std::span<const std::uint8_t> message;
  CHECK(asking.receive(message) == link::ReceiveStatus::kClosed);
  CHECK(bench.wait() == 3);
  const BenchResult none = run_bench({"fault", "virtual:nobody-is-there", "--list"});
  CHECK(none.status == 2);
  CHECK_THAT(none.output, Catch::Contains("is running"));
}
