#include "bench/report/log_page.hpp"

#include <algorithm>
#include <catch2/catch.hpp>
#include <cmath>

#include "bench/report/thinned_signals.hpp"

using namespace meltbench;
using namespace meltbench::report;
using Catch::Contains;

namespace {

std::size_t count(const std::string& text, const std::string& word) {
  std::size_t n = 0;
  for (std::size_t at = text.find(word); at != std::string::npos; at = text.find(word, at + 1)) ++n;
  return n;
}

}  // namespace

TEST_CASE("Thinned signals: a short stream keeps every value at its time", "[report]") {
  ThinnedSignals signals;
  const std::size_t one = *signals.add("one");
  for (int i = 0; i < 10; ++i) signals.take(one, Instant{i * 10ms}, i);
  const auto times = signals.times_s();
  const auto values = signals.values(one);
  REQUIRE(times.size() == values.size());
  int seen = 0;
  for (std::size_t i = 0; i < times.size(); ++i) {
    if (std::isinf(values[i])) continue;
    // A bucket is 1 ms wide as long as 4,096 of them are enough.
    CHECK(times[i] == Approx(0.01 * seen).margin(0.001));
    CHECK(values[i] == static_cast<float>(seen++));
  }
  CHECK(seen == 10);
}

TEST_CASE("Thinned signals: a long stream keeps every peak, in bounded memory, in the right order", "[report]") {
  ThinnedSignals signals;
  const std::size_t one = *signals.add("one");
  const std::size_t still = *signals.add("still");
  for (int i = 0; i < 1'000'000; ++i) {
    signals.take(one, Instant{i * 10ms}, i == 543'210 ? 7 : i == 543'211 ? -7 : 0.1);
    signals.take(still, Instant{i * 10ms}, 3);
  }
  signals.fold_to(2000);
  const auto times = signals.times_s();
  const auto values = signals.values(one);
  CHECK(times.size() <= 1000);
  CHECK(times.size() >= 500);
  CHECK(times.back() <= 10'000 + 20);  // In the last bucket.
  const auto high = std::max_element(values.begin(), values.end(), [](float a, float b) {
    return (std::isfinite(a) ? a : -100) < (std::isfinite(b) ? b : -100);
  });
  REQUIRE(*high == 7);
  const auto low = std::min_element(values.begin(), values.end());
  REQUIRE(*low == -7);
  CHECK(high < low);
  // Half a bucket, of which there are at least 250 in 10,000 s.
  CHECK(times[static_cast<std::size_t>(high - values.begin())] == Approx(5432.1).margin(20));
  CHECK(signals.still_value(still) == 3);
  CHECK_FALSE(signals.still_value(one));
}

TEST_CASE("Thinned signals: where nothing was heard the line has a gap, elsewhere it goes on", "[report]") {
  ThinnedSignals signals;
  const std::size_t one = *signals.add("one");
  for (const auto at : {0ms, 10ms, 30ms}) signals.take(one, Instant{at}, 1);
  signals.break_line(one, Instant{10ms}, Instant{30ms});
  const auto values = signals.values(one);
  REQUIRE(values.size() == 62);  // Two for each of the milliseconds 0 to 30.
  CHECK(std::isinf(values[2 * 5]));
  CHECK(values[2 * 10] == 1);
  CHECK(std::isnan(values[2 * 20]));
  CHECK(values[2 * 30] == 1);
}

TEST_CASE("Thinned signals: there is room for so many", "[report]") {
  ThinnedSignals signals;
  for (std::size_t i = 0; i < ThinnedSignals::kMaxSignals; ++i) REQUIRE(signals.add("x"));
  CHECK_FALSE(signals.add("x"));
}

TEST_CASE("Log page: what stands out first, then every line with its time to click", "[report]") {
  LogPage page;
  page.title = "night <1>";
  page.lines = {{1.5, Weight::kInfo, "SDO", "feeder", "SDO dialogue", {"read 1000h:0", "value </pre>"}},
                {2.0, Weight::kFault, "heartbeat lost", "heater", "heater <lost>", {}},
                {3.0, Weight::kFault, "heartbeat lost", "", "lost", {}}};
  const std::string html = render_log_page(page);
  CHECK_THAT(html, Contains("<h1>night &lt;1&gt;</h1>") && Contains("2 × heartbeat lost") &&
                       Contains("heater &lt;lost&gt;") && Contains("data-t=\"2\">2.000 s</button>"));
  CHECK_THAT(html, Contains("<summary>SDO dialogue</summary><pre>read 1000h:0\nvalue &lt;/pre&gt;\n</pre>"));
  CHECK(html.find("2 × heartbeat lost") < html.find("id=\"story\""));
  // A button for each of them: who, what, weight.
  CHECK(count(html, "data-value=") == 3 + 2 + 2);
  CHECK(count(html, "<tr data-kind=\"heartbeat lost\" data-node=\"heater\" data-weight=\"fault\">") == 1);
  CHECK(count(html, " src=") == 0);
}

TEST_CASE("Log page: of a long story the heaviest lines stay, and what is left out is said", "[report]") {
  LogPage page;
  for (std::size_t i = 0; i < 2 * kMaxStoryLines; ++i) {
    const bool heavy = i % 10 == 9;
    page.lines.push_back(
        {static_cast<double>(i), heavy ? Weight::kFault : Weight::kInfo, "x", "n", heavy ? "heavy" : "light", {}});
  }
  page.left_out = 5;
  const std::string html = render_log_page(page);
  CHECK(count(html, "<tr data-kind") == kMaxStoryLines);
  CHECK(count(html, ">heavy</td>") == 2 * kMaxStoryLines / 10);
  CHECK_THAT(html, Contains(std::to_string(kMaxStoryLines + 5) + " more"));
  CHECK(html.size() < 2'000'000);
}

TEST_CASE("Log page: an empty log can be shown", "[report]") {
  CHECK_THAT(render_log_page({}), Contains("Nothing stands out"));
}
