#include "tests/scenario/bench_process.hpp"

using namespace meltbench;
using namespace meltbench::test;
using Catch::Contains;

namespace {

/// What stands in column `column` (from 0) of the lines that begin with a time.
std::vector<std::string> read_column(const std::filesystem::path& log, std::size_t column) {
  std::vector<std::string> words;
  std::istringstream lines{read_file(log)};
  for (std::string line; std::getline(lines, line);) {
    if (!line.starts_with('(')) continue;
    std::istringstream stream{line};
    std::string word;
    for (std::size_t i = 0; i <= column; ++i) stream >> word;
    words.push_back(word);
  }
  return words;
}

std::string join(const std::vector<std::string>& words) {
  std::string text;
  for (const std::string& word : words) text += word;
  return text;
}

std::string last(const std::string& text, std::size_t size) {
  return text.substr(text.size() - std::min(size, text.size()));
}

void wait_for_words(const BenchProcess& process, const std::string& words) {
  while (process.output().find(words) == std::string::npos) std::this_thread::sleep_for(std::chrono::milliseconds{1});
}

}  // namespace

TEST_CASE("Record: whoever listens to the embedded bus of a run hears what the run itself records", "[scenario]") {
  const TemporaryFolder folder;
  std::ofstream{folder / "scenario.toml"} << "[scenario]\nname = \"heard\"\nduration_s = 3\nrig = \""
                                          << MELTBENCH_SOURCE_DIR << "/fixtures/rigs/bizone_serial.toml\"\n";
  const std::string bus = "virtual:r" + std::to_string(::getpid());
  BenchProcess bench{{"run", folder / "scenario.toml", "--out", folder / "out", "--can", bus, "--pace", "realtime"},
                     folder / "bench"};
  std::optional<BenchProcess> recorder;
  do {  // Until the bench is there.
    recorder.emplace(std::vector<std::string>{"record", bus, "--line", "dosing", "--out", folder / "heard.log"},
                     folder / "recorder");
    while (recorder->output().empty()) std::this_thread::sleep_for(std::chrono::milliseconds{1});
  } while (recorder->output().find("there is no embedded bus") != std::string::npos);
  const int status = bench.wait();
  CHECK((status == 0 || status == 1));  // The machine may be too slow for the deadlines of a run at wall-clock pace.
  CHECK(recorder->wait() == 0);         // It is told when the run is over.
  INFO(recorder->output());
  CHECK_THAT(recorder->output(), Contains("the run is over"));
  const std::string frames = join(read_column(folder / "heard.log", 2));
  CHECK(frames.size() > 1000);
  CHECK(frames == last(join(read_column(folder / "out/bus.log", 2)), frames.size()));
  const std::string bytes = join(read_column(folder / "heard.serial.log", 3));
  CHECK(bytes.size() > 100);
  CHECK(bytes == last(join(read_column(folder / "out/serial.log", 3)), bytes.size()));
}

TEST_CASE("Record: a serial line alone, until Ctrl-C, under a head that says what it is", "[scenario]") {
  const TemporaryFolder folder;
  const auto port = folder / "port";
  const std::string rig = std::string{MELTBENCH_SOURCE_DIR} + "/fixtures/rigs/bizone_serial.toml";
  BenchProcess recorder{{"record", "none", "--rig", rig, "--line", "dosing=pty:" + port.string(), "--line",
                         "other=pty:" + (folder / "b").string() + "@9600:8N1", "--out", folder / "a.log"},
                        folder / "recorder"};
  wait_for_words(recorder, "Ctrl-C");
  std::ofstream{port} << "abc" << std::flush;
  while (read_column(folder / "a.log", 3).empty()) std::this_thread::sleep_for(std::chrono::milliseconds{1});
  ::kill(recorder.pid(), SIGINT);
  CHECK(recorder.wait() == 0);
  CHECK_THAT(recorder.output(), Contains("1 pieces of 3 bytes"));
  const std::string text = read_file(folder / "a.log");
  CHECK_THAT(text, Contains("# rig: ") && Contains("bizone_serial.toml)") && Contains("pty:") &&
                       Contains("115200 bit/s 8E1") && Contains("/b: 9600 bit/s 8N1") &&
                       Contains(" dosing wire 616263\n"));
}

TEST_CASE("Record: what cannot be recorded is refused with a reason", "[scenario]") {
  const TemporaryFolder folder;
  const auto [words, expected] = GENERATE(table<std::vector<std::string>, std::string>(
      {{{"none"}, "nothing to record"},
       {{"none", "--line", "dosing"}, "NAME=PORT"},
       {{"none", "--line", "=x"}, "NAME=PORT"},
       {{"none", "--line", "a=/dev/none", "--line", "a=/dev/none"}, "twice"},
       {{"none", "--line", "a=/dev/none"}, "/dev/none"},
       {{"virtual:nobody-is-here"}, "nobody-is-here"}}));
  std::vector<std::string> arguments{"record", "--out", folder / "a.log"};
  arguments.insert(arguments.end(), words.begin(), words.end());
  const BenchResult result = run_bench(arguments);
  INFO(result.output);
  CHECK(result.status == 2);
  CHECK_THAT(result.output, Contains(expected));
  CHECK_FALSE(std::filesystem::exists(folder / "a.log"));
}
