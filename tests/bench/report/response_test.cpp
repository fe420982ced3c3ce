#include "bench/report/response.hpp"

#include <catch2/catch.hpp>

#include "bench/report/results.hpp"
#include "tests/bench/report/sample_runs.hpp"

using namespace meltbench;
using namespace meltbench::report;

namespace {

/// Answers to SYNC after 1 ms but once after 7 ms, and a controller that was woken late by 50 us.
record::Recording make_recording() {
  record::Recording recording;
  recording.info.scenario = std::string{"s"};  // g++ 12 warns of the shorter form.
  for (int i = 0; i < 100; ++i) {
    recording.frames.push_back(Instant{i * 10ms}, can::make_frame(0x080, {}), 0);
    recording.frames.push_back(Instant{i * 10ms + (i == 40 ? 7ms : 1ms)}, can::make_frame(0x205, {}), 0);
  }
  recording.signals = {{"controller.deadline_misses", SignalKind::kErrorCounter}};
  recording.row_times = {Instant{0s}, Instant{1s}};
  recording.values = {0, 2};
  LogHistogram lateness;
  lateness.add(50us, Instant{300ms});
  recording.ending.wakeups.push_back({"controller", lateness});
  return recording;
}

}  // namespace

TEST_CASE("Responses: reactions and wake-ups are told with their quantiles and their worst", "[report]") {
  const record::Recording recording = make_recording();
  const std::vector<Response> responses = collect_responses(recording);
  REQUIRE(responses.size() == 2);
  CHECK(responses[0].times.max() == 7ms);
  CHECK(responses[0].times.max_at() == Instant{407ms});
  CHECK(responses[1].overruns == 2.0);
  const std::string json = write_result_json(recording, {});
  CHECK_THAT(json, Catch::Contains("\"SYNC to command\"") && Catch::Contains("\"max_s\": 0.007") &&
                       Catch::Contains("\"controller wakes up late by\"") && Catch::Contains("\"deadline_misses\": 2"));
  const check::CheckResults results;
  const Run run{&recording, &results};
  const std::string page = render_responses(std::span{&run, 1});
  CHECK_THAT(page, Catch::Contains("7 ms") && Catch::Contains("0.407 s") && Catch::Contains("50 µs"));
}

TEST_CASE("Responses: nothing to tell is nothing on the page", "[report]") {
  const record::Recording empty;
  const check::CheckResults results;
  const Run run{&empty, &results};
  CHECK(render_responses(std::span{&run, 1}).empty());
}

TEST_CASE("Responses: the picture's bins hold every count, between its ends", "[report]") {
  LogHistogram fast;
  LogHistogram slow;
  for (int i = 0; i < 10; ++i) fast.add(10us, Instant{});
  slow.add(5ms, Instant{});
  const std::array<const LogHistogram*, 2> runs{&fast, &slow};
  const auto histogram = calc_log_histogram(runs);
  REQUIRE(histogram.has_value());
  CHECK(histogram->from_s <= 10e-6);
  CHECK(histogram->to_s > 5e-3);
  CHECK(histogram->counts.at(0).front() == 10);
  CHECK(histogram->counts.at(1).back() == 1);
  CHECK(histogram->counts.at(0).size() == histogram->counts.at(1).size());
}
