#include "bench/scenario/scenario.hpp"

#include <unistd.h>

#include <catch2/catch.hpp>
#include <filesystem>
#include <fstream>
#include <string>

#include "bench/check/read_checks.hpp"
#include "protocols/config/toml.hpp"
#include "tests/protocols/config/complaint.hpp"

using namespace meltbench;
using Catch::Contains;
using config::complaint_of;
namespace fs = std::filesystem;

namespace {

/// A folder with rigs/r.toml and boards/b.eds; scenarios are written into scenarios/.
class Files {
 public:
  Files() : root_{fs::temp_directory_path() / ("meltbench_scenario_" + std::to_string(::getpid()))} {
    (void)write("boards/b.eds", "[FileInfo]\n");
    (void)write("rigs/r.toml", R"([rig]
name = "lab"
[plant]
preset = "slow"
x0_m = 0.1
[controller]
law = "open_loop"
[board.feeder]
kind = "feeder"
node_id = 5
eds = "../boards/b.eds"
)");
  }
  ~Files() { fs::remove_all(root_); }
  Files(const Files&) = delete;
  Files& operator=(const Files&) = delete;

  [[nodiscard]] fs::path write(const std::string& name, std::string_view text) const {
    const fs::path file = root_ / name;
    fs::create_directories(file.parent_path());
    std::ofstream{file} << text;
    return file;
  }
  [[nodiscard]] std::vector<scenario::ResolvedRun> load(std::string_view scenario_text) const {
    return scenario::load(write("scenarios/s.toml", scenario_text));
  }
  [[nodiscard]] std::string complaint(std::string_view scenario_text) const {
    return complaint_of([&] { (void)load(scenario_text); });
  }
  [[nodiscard]] const fs::path& root() const { return root_; }

 private:
  fs::path root_;
};

const std::string kHead = "[scenario]\nname = \"s\"\nrig = \"../rigs/r.toml\"\nduration_s = 60\n";

std::string law_of(const scenario::ResolvedRun& run) {
  return run.root.section("controller").text("law");
}

}  // namespace

TEST_CASE("Scenario: a scenario without variants is one run, with defaults", "[scenario]") {
  const Files files;
  const auto runs = files.load(kHead);
  REQUIRE(runs.size() == 1);
  CHECK(runs[0].name == "s");
  CHECK(runs[0].label() == "s");
  CHECK(runs[0].title == "s");
  CHECK(runs[0].duration == 60s);
  CHECK(runs[0].record_period == 10ms);
  CHECK(runs[0].seed == 1);
  CHECK(runs[0].rig.boards.at(0).name == "feeder");
  CHECK(law_of(runs[0]) == "open_loop");
}

TEST_CASE("Scenario: its tables lie over the rig key by key, a variant's over both", "[scenario]") {
  const Files files;
  const auto runs = files.load(kHead + R"(
[plant]
x0_m = 0.12
[[variant]]
name = "a"
[[variant]]
name = "b"
title = "B"
[variant.controller]
law = "exact_predictor"
[variant.bus]
sync_period_ms = 5
)");
  REQUIRE(runs.size() == 2);
  CHECK(runs[0].label() == "s.a");
  CHECK(runs[0].variant_title == "a");
  CHECK(law_of(runs[0]) == "open_loop");
  CHECK(runs[1].variant_title == "B");
  CHECK(law_of(runs[1]) == "exact_predictor");
  CHECK(runs[1].rig.bus.sync_period == 5ms);
  for (const auto& run : runs) {
    CHECK(run.root.section("plant").number("x0_m") == 0.12);
    CHECK(run.root.section("plant").text("preset") == "slow");
  }
}

TEST_CASE("Scenario: a complaint about a merged key names the file that said it", "[scenario]") {
  const Files files;
  const auto runs = files.load(kHead + "[plant]\nepsilon = 2\n");
  const config::Section plant = runs[0].root.section("plant");
  CHECK_THAT(complaint_of([&] { (void)plant.number("epsilon", config::from_below(0, 1)); }),
             Contains("scenarios/s.toml:6:11: plant.epsilon = 2, must be >= 0 and < 1"));
  CHECK_THAT(complaint_of([&] { (void)plant.number("x0_m", config::above(1)); }), Contains("rigs/r.toml:5:8"));
}

TEST_CASE("Scenario: checks go to all variants, to those named, or to the one they stand in", "[scenario]") {
  const Files files;
  const auto runs = files.load(kHead + R"(
[[check]]
name = "all"
[[check]]
name = "only b"
variants = ["b"]
[[variant]]
name = "a"
[[variant.check]]
name = "in a"
[[variant]]
name = "b"
)");
  const auto names = [](const scenario::ResolvedRun& run) {
    std::vector<std::string> result;
    for (const auto& check : run.root.sections("check")) {
      result.push_back(check.text("name"));
      check.finish();  // "variants" is gone: the reader of checks need not know it.
    }
    return result;
  };
  CHECK(names(runs.at(0)) == std::vector<std::string>{"all", "in a"});
  CHECK(names(runs.at(1)) == std::vector<std::string>{"all", "only b"});
  CHECK_THAT(files.complaint(kHead + "[[check]]\nvariants = [\"c\"]\n[[variant]]\nname = \"a\"\n"),
             Contains("there is no variant \"c\" | variants here: a"));
}

TEST_CASE("Scenario: events of the scenario and of the variant form one timeline", "[scenario]") {
  const Files files;
  const auto runs = files.load(kHead + R"(
[[event]]
at_s = 20
target = "controller"
action = "set_point"
[[variant]]
name = "a"
[[variant.event]]
at_s = 10
target = "board.feeder"
action = "x"
)");
  REQUIRE(runs.at(0).events.size() == 2);
  CHECK(runs[0].events[0].target == "board.feeder");
  CHECK(runs[0].events[1].at == Instant{20s});
  CHECK_THAT(files.complaint(kHead + "[[event]]\nat_s = 61\ntarget = \"bus\"\naction = \"x\"\n"),
             Contains("s.toml:6:8: event[1].at_s = 61, the run ends at 60 s"));
}

TEST_CASE("Scenario: unknown keys and tables are refused with their place and the nearest name", "[scenario]") {
  const Files files;
  CHECK_THAT(files.complaint(kHead + "titel = \"x\"\n"),
             Contains("s.toml:5:1: scenario.titel: unknown key") && Contains("did you mean title?"));
  CHECK_THAT(files.complaint(kHead + "[plnat]\nx = 1\n"), Contains("s.toml:5:2: plnat: unknown key"));
  CHECK_THAT(files.complaint(kHead + "[[variant]]\nname = \"a\"\n[variant.contoller]\n"),
             Contains("variant[1].contoller: unknown key | did you mean controller?"));
  CHECK_THAT(files.complaint("[scenario]\nname = \"s\"\nrig = \"../rigs/r.toml\"\nduration_ms = 6\n"),
             Contains("duration_ms: wrong unit, this key is duration_s"));
  CHECK_THAT(files.complaint(kHead + "[bus]\nsync_ms = 6\n"), Contains("s.toml:6:1: bus.sync_ms: unknown key"));
}

TEST_CASE("Scenario: values without sense are refused", "[scenario]") {
  const Files files;
  const auto with = [&](std::string_view line) {
    return files.complaint("[scenario]\nrig = \"../rigs/r.toml\"\n" + std::string{line});
  };
  CHECK_THAT(with("name = \"s\"\nduration_s = 0\n"), Contains("duration_s = 0, must be > 0 and <= 1000000"));
  CHECK_THAT(with("name = \"s\"\nduration_s = nan\n"), Contains("duration_s = nan, must be"));
  CHECK_THAT(with("name = \"../s\"\nduration_s = 1\n"), Contains("must be letters, digits"));
  CHECK_THAT(with("name = \"s\"\nduration_s = 1\nseed = -1\n"), Contains("seed = -1, must be >= 0"));
  CHECK_THAT(with("name = \"s\"\nduration_s = 1\nrecord_period_ms = 2000\n"),
             Contains("not be longer than duration_s"));
  CHECK_THAT(files.complaint(kHead + "[[variant]]\nname = \"a\"\n[[variant]]\nname = \"a\"\n"),
             Contains("s.toml:8:8: variant[2].name = \"a\", another variant has this name"));
}

TEST_CASE("Scenario: a rig that is missing, unreadable, given twice or itself passed in is explained", "[scenario]") {
  const Files files;
  CHECK_THAT(files.complaint("[scenario]\nname = \"s\"\nduration_s = 1\n"), Contains("scenario.rig is missing"));
  CHECK_THAT(files.complaint("[scenario]\nname = \"s\"\nduration_s = 1\nrig = \"no.toml\"\n"),
             Contains("s.toml:4:7: cannot read") && Contains("No such file"));
  CHECK_THAT(files.complaint(kHead + "[rig]\nname = \"x\"\n"), Contains("this file has a [rig] of its own"));
  CHECK_THAT(complaint_of([&] { (void)scenario::load(files.root() / "rigs/r.toml"); }),
             Contains("this file is a rig, not a scenario"));
  (void)files.write("rigs/r.toml", "[rig]\nname = \"x\"\n[health]\n");
  CHECK_THAT(files.complaint(kHead), Contains("rigs/r.toml:3:2: health: unknown key"));
}

TEST_CASE("Repro: the text of a run loads from another folder as one equal run", "[scenario]") {
  const Files files;
  auto runs = files.load(kHead + R"(
title = "A title with \"quotes\""
text = """two
lines"""
[[event]]
at_s = 20
target = "controller"
action = "set_point"
set_point_m = 0.12
[[check]]
name = "all"
variants = ["b"]
[health]
expect = ["controller.law-refused"]
[[variant]]
name = "a"
[[variant]]
name = "b"
title = "B"
[variant.plant]
epsilon = 0.1
)");
  scenario::ResolvedRun& run = runs.at(1);
  run.seed = 77;
  const std::string text = scenario::write_repro(run, "meltbench 0.1.0");
  CHECK_THAT(text, Contains("program = \"meltbench 0.1.0\""));
  const auto again = scenario::load(files.write("elsewhere/deep/repro.toml", text));
  REQUIRE(again.size() == 1);
  CHECK(again[0].label() == "s.b");
  CHECK(again[0].title == run.title);
  CHECK(again[0].variant_title == "B");
  CHECK(again[0].text == "two\nlines");
  CHECK(again[0].duration == run.duration);
  CHECK(again[0].record_period == run.record_period);
  CHECK(again[0].seed == 77);
  CHECK(again[0].events.size() == 1);
  CHECK(again[0].rig.boards.at(0).eds == run.rig.boards.at(0).eds);
  for (const auto* key : {"rig", "plant", "controller", "board", "event", "check", "health"}) {
    INFO(key);
    CHECK(again[0].root.table().find(key)->value == run.root.table().find(key)->value);
  }
  CHECK(scenario::write_repro(again[0], "meltbench 0.1.0") == text);
}

TEST_CASE("Repro: the rig reader of the other programs accepts it as their rig", "[scenario]") {
  const Files files;
  const auto runs = files.load(kHead + "[[check]]\nname = \"x\"\n");
  const config::Section root{
      config::read_toml_file(files.write("repro.toml", scenario::write_repro(runs.at(0), "meltbench 0.1.0")))};
  const config::Rig rig = config::read_rig(root);
  CHECK(rig.boards.size() == 1);
  root.finish();
}

TEST_CASE("Fixtures: every scenario of the project loads with its checks, and is named as its file", "[scenario]") {
  std::size_t count = 0;
  for (const auto& entry : fs::directory_iterator{fs::path{MELTBENCH_SOURCE_DIR} / "fixtures/scenarios"}) {
    if (entry.path().extension() != ".toml") continue;
    INFO(entry.path());
    CHECK(complaint_of([&] {
            for (const auto& run : scenario::load(entry.path())) {
              CHECK(run.name == entry.path().stem());
              CHECK_FALSE(check::read_checks(run.root).checks.empty());
            }
          }) == "");
    ++count;
  }
  CHECK(count >= 10);
}
