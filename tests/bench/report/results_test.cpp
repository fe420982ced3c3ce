#include "bench/report/results.hpp"

#include <unistd.h>

#include <catch2/catch.hpp>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <limits>
#include <nlohmann/json.hpp>

#include "bench/record/load_recording.hpp"
#include "tests/bench/report/sample_runs.hpp"
#include "tests/tools/temporary_folder.hpp"

namespace meltbench::report {
namespace {

namespace fs = std::filesystem;

std::size_t count(const std::string& text, const std::string& word) {
  std::size_t n = 0;
  for (std::size_t at = text.find(word); at != std::string::npos; at = text.find(word, at + 1)) ++n;
  return n;
}

}  // namespace

TEST_CASE("result.json: holds what scripts ask for", "[report]") {
  const SampleRun run = make_sample_run(1, 2);
  const nlohmann::json result = nlohmann::json::parse(write_result_json(run.recording, run.results));
  CHECK(result.at("scenario") == "delay_compensation");
  CHECK(result.at("variant") == "uncompensated");
  CHECK(result.at("seed") == 7);
  CHECK(result.at("held") == false);
  CHECK(result.at("real_time_factor").is_null());
  REQUIRE(result.at("checks").size() == run.results.checks.size());
  const nlohmann::json& swings = result.at("checks")[1];
  CHECK(swings.at("name") == "swings");
  CHECK(swings.at("held") == false);
  CHECK(swings.at("margin") == -0.0001);
  CHECK(swings.at("unit") == "m");
  CHECK(swings.at("at_s") == 52.1);
  CHECK(result.at("checks")[3].contains("skipped"));
  CHECK(result.at("health").at("findings").size() == 2);
  CHECK(result.at("bus").at("ids")[0].at("cob_id") == "080");
  CHECK(result.at("signals").at("plant.x_m").at("last") == 0.1);
  CHECK(result.at("signals").at("controller.x_m").at("min").is_number());
}

TEST_CASE("result.json: a run that somebody else has sent into is not reproducible", "[report]") {
  SampleRun run = make_sample_run(1, 2);
  const auto is_reproducible = [&run] {
    return nlohmann::json::parse(write_result_json(run.recording, run.results)).at("reproducible").get<bool>();
  };
  CHECK(is_reproducible());
  run.recording.frames.push_back(Instant{59s}, can::make_frame(0x605, {0x40}), record::kTapSender);
  CHECK_FALSE(is_reproducible());
}

TEST_CASE("result.json: equal runs give equal bytes, the speed of the machine is not in them", "[report]") {
  SampleRun first = make_sample_run(2, 2);
  const SampleRun second = make_sample_run(2, 2);
  first.recording.ending.real_time_factor = 1234.5;
  CHECK(write_result_json(first.recording, first.results) == write_result_json(second.recording, second.results));
  first.recording.info.pace = "realtime:2";
  const std::string text = write_result_json(first.recording, first.results);
  CHECK(nlohmann::json::parse(text).at("real_time_factor") == 1234.5);
}

TEST_CASE("result.json: what is not a number is null, and bytes that are no text do not stop it", "[report]") {
  SampleRun run = make_sample_run(0, 1);
  run.results.checks[0].margin = -std::numeric_limits<double>::infinity();
  run.results.checks[0].held = false;
  run.results.checks[0].text = "\xFF\xFE";
  const nlohmann::json result = nlohmann::json::parse(write_result_json(run.recording, run.results));
  CHECK(result.at("checks")[0].at("margin").is_null());
}

TEST_CASE("Run folder: recording and verdict are read back as they were judged", "[report]") {
  const test::TemporaryFolder scratch;
  const SampleRun run = make_sample_run(1, 2, scratch.path().string());
  write_run_results(scratch.path(), run.recording, run.results);
  const record::Recording recording = record::load_recording(scratch.path());
  const check::CheckResults results = load_run_results(scratch.path());
  // Judged again or shown again from the folder: the same bytes.
  CHECK(write_result_json(recording, results) == write_result_json(run.recording, run.results));
  CHECK(write_junit_xml(recording, results) == write_junit_xml(run.recording, run.results));
  CHECK_FALSE(fs::exists(scratch.path() / "result.json.part"));
}

TEST_CASE("Run folder: a missing or foreign result.json is a clear error", "[report]") {
  const test::TemporaryFolder scratch;
  CHECK_THROWS_WITH(load_run_results(scratch.path()), Catch::EndsWith("result.json: cannot be read"));
  std::ofstream{scratch.path() / "result.json"} << "{\"checks\": 3}";
  CHECK_THROWS_AS(load_run_results(scratch.path()), record::LoadError);
  CHECK_THROWS(write_run_results(scratch.path() / "no" / "such", {}, {}));
}

TEST_CASE("junit.xml: one case per check, failures and skips marked, text escaped", "[report]") {
  const SampleRun run = make_sample_run(1, 2);
  const std::string xml = write_junit_xml(run.recording, run.results);
  CHECK(xml.starts_with("<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n"));
  CHECK(count(xml, "<testcase ") == 5);
  CHECK(count(xml, "<failure ") == 2);
  CHECK(count(xml, "<skipped ") == 1);
  CHECK(xml.find("tests=\"5\" failures=\"2\" errors=\"0\" skipped=\"1\"") != std::string::npos);
  CHECK(xml.find("SYNC 12 ms after the last &lt;/script&gt;") != std::string::npos);
  CHECK(xml.find("name=\"delay_compensation.uncompensated\"") != std::string::npos);
}

}  // namespace meltbench::report
