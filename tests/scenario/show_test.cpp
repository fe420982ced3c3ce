#include <catch2/catch.hpp>

#include "tests/scenario/bench_process.hpp"

using namespace meltbench::test;
using Catch::Contains;

namespace {

std::string recording(const std::string& name) {
  return std::string{MELTBENCH_SOURCE_DIR} + "/fixtures/recordings/" + name;
}

}  // namespace

TEST_CASE("Show: the page of a log tells the same story as the text, with plots", "[scenario]") {
  const TemporaryFolder folder;
  const std::string page = (folder / "night.html").string();
  const std::string log = recording("board_reboot.log.gz");
  const std::string scenario = recording("production.toml");
  const BenchResult text = run_bench({"show", log, "--scenario", scenario});
  CHECK(text.status == 0);
  CHECK_THAT(text.output, Contains("heater boots up although nobody has asked for it"));
  const BenchResult made = run_bench({"show", log, "--scenario", scenario, "--html", page});
  CHECK(made.status == 0);
  CHECK_THAT(made.output, Contains(page));
  const std::string html = read_file(page);
  for (const char* words :
       {"<h1>What happened on the bus: board_reboot.log.gz</h1>", "heater boots up although nobody has asked for it",
        "1 × boot unasked", "heater SDO value 0x1018:1, Vendor-ID = 0", "\"title\":\"Bus load per second\"",
        "\"title\":\"melt_pressure 9130h\"", "TPDO1 heater"}) {
    CAPTURE(words);
    CHECK(html.find(words) != std::string::npos);
  }
}

TEST_CASE("Show: the page has no frames in it, and says so before anything is written", "[scenario]") {
  const TemporaryFolder folder;
  const BenchResult result = run_bench({"show", "none.log", "--frames", "--html", (folder / "night.html").string()});
  CHECK(result.status == 2);
  CHECK_FALSE(std::filesystem::exists(folder / "night.html"));
}

TEST_CASE("Show: a night's load is told in means, and channels that nobody asked for are named", "[scenario]") {
  const TemporaryFolder folder;
  std::ofstream log{folder / "night.log"};
  for (int second = 0; second < 3600; ++second) log << "(" << second << ".000000) can0 701#05\n";
  log << "(3600.000000) can1 701#05\n";
  log.close();
  const BenchResult shown = run_bench({"show", folder / "night.log", "--scenario", scenario_file("set_point_step")});
  INFO(shown.output);
  CHECK(shown.status == 0);
  CHECK_THAT(shown.output, Contains("means of 60 s each") && Contains("\n    3000 s"));
  CHECK_THAT(shown.output, Contains("can0, can1 only can0 was looked at"));
}

TEST_CASE("Show: what serial lines tell stands among what the bus tells", "[scenario]") {
  const TemporaryFolder folder;
  std::ofstream{folder / "scenario.toml"} << "[scenario]\nname = \"lines\"\nduration_s = 3\nrig = \""
                                          << MELTBENCH_SOURCE_DIR << "/fixtures/rigs/bizone_serial.toml\"\n";
  const std::string out = (folder / "out").string();
  REQUIRE(run_bench({"run", folder / "scenario.toml", "--out", out, "--in-process", "--quiet"}).status == 0);
  const BenchResult text = run_bench({"show", out});
  CHECK_THAT(text.output, Contains("dosing: feeder is asked to write 2 registers from"));
  std::filesystem::rename(folder / "out/serial.log", folder / "out/bus.serial.log");
  const std::string page = (folder / "page.html").string();
  CHECK(run_bench({"show", out, "--html", page}).status == 0);
  const std::string html = read_file(page);
  CHECK(html.find("data-kind=\"polls\" data-node=\"line dosing\"") != std::string::npos);
}
