#include "bench/report/report.hpp"

#include <algorithm>
#include <catch2/catch.hpp>
#include <cmath>
#include <nlohmann/json.hpp>

#include "bench/report/escape.hpp"
#include "bench/report/histogram.hpp"
#include "bench/report/plots.hpp"
#include "bench/report/sections.hpp"
#include "tests/bench/report/sample_runs.hpp"

namespace meltbench::report {
namespace {

std::size_t count(const std::string& text, const std::string& word) {
  std::size_t n = 0;
  for (std::size_t at = text.find(word); at != std::string::npos; at = text.find(word, at + 1)) ++n;
  return n;
}

std::vector<Run> borrow(const std::vector<SampleRun>& samples) {
  std::vector<Run> runs;
  for (const SampleRun& sample : samples) runs.push_back({&sample.recording, &sample.results});
  return runs;
}

std::vector<SampleRun> make_three(double duration_s) {
  return {make_sample_run(0, duration_s), make_sample_run(1, duration_s), make_sample_run(2, duration_s)};
}

const Plot& find_plot(const Plots& plots, const std::string& title) {
  const auto plot =
      std::find_if(plots.plots.begin(), plots.plots.end(), [&](const Plot& p) { return p.title == title; });
  REQUIRE(plot != plots.plots.end());
  return *plot;
}

}  // namespace

TEST_CASE("Report: one page without anything from outside, below 3 MB for a minute of three runs", "[report]") {
  const std::vector<SampleRun> samples = make_three(60);
  const std::string page = render_report(borrow(samples));
  CHECK(page.size() < 3'000'000);
  CHECK(page.starts_with("<!DOCTYPE html>"));
  CHECK(count(page, "<link") == 0);
  CHECK(count(page, " src=") == 0);
  CHECK(count(page, "url(") == 0);
  CHECK(count(page, "@import") == 0);
  CHECK(count(page, "sourceMappingURL") == 0);
}

TEST_CASE("Report: what the scenario says of itself stands there once, and each variant has its title", "[report]") {
  std::vector<SampleRun> samples = make_three(2);
  const char* const titles[] = {"open loop", "delay ignored", "uncompensated <b>"};
  for (std::size_t i = 0; i < samples.size(); ++i) {
    samples[i].recording.info.title = std::string{"Three laws: "} + titles[i];
    samples[i].recording.info.text = "Feed takes seconds <i>to arrive</i>.";
  }
  const std::string page = render_report(borrow(samples));
  CHECK(count(page, "<p>Feed takes seconds &lt;i&gt;to arrive&lt;/i&gt;.</p>") == 1);
  CHECK(count(page, "open_loop <small>open loop</small></h3>") == 1);
  CHECK(count(page, "<small>uncompensated &lt;b&gt;</small></h3>") == 1);
}

TEST_CASE("Report: hostile text stays text", "[report]") {
  const std::vector<SampleRun> samples{make_sample_run(1, 2)};
  const std::string page = render_report(borrow(samples));
  // Data, dygraphs, synchronizer and ours; none from the event whose text is "...</script>".
  CHECK(count(page, "</script>") == 4);
  CHECK(count(page, "after the last \\u003c/script>") == 1);
  CHECK(page.find("extruder &lt;case A&gt;</h1>") != std::string::npos);
  CHECK(page.find("extruder <case A>") == std::string::npos);
}

TEST_CASE("Report: verdict first, with every margin and the command that repeats the run", "[report]") {
  const std::vector<SampleRun> samples = make_three(1);
  const std::string page = render_report(borrow(samples));
  CHECK(page.find("2 of 11 checks failed") != std::string::npos);
  CHECK(page.find("2 of 11 checks failed") < page.find("id=\"plots\""));
  CHECK(page.find("-100 µm") != std::string::npos);
  CHECK(page.find("meltbench run fixtures/scenarios/delay_compensation.toml --seed 7") != std::string::npos);
  const std::vector<SampleRun> good{make_sample_run(2, 1)};
  // One of its five could not be judged: that is not held.
  CHECK_THAT(render_report(borrow(good)), Catch::Contains("All 4 checks held") && Catch::Contains("1 check skipped"));
}

TEST_CASE("Report: runs with titles of their own are called by what they share", "[report]") {
  std::vector<SampleRun> samples = make_three(1);
  samples[0].recording.info.title = "Step: fast";
  samples[1].recording.info.title = "Step: fair";
  samples[2].recording.info.title = "Step: slow";
  CHECK(make_title(borrow(samples)) == "Step");
  samples[2].recording.info.title = "Something else";
  CHECK(make_title(borrow(samples)) == "3 runs");
  samples.resize(1);
  CHECK(make_title(borrow(samples)) == "Step: fast");
}

TEST_CASE("Report: a run that left nothing can still be shown", "[report]") {
  const record::Recording recording;
  const check::CheckResults results;
  const std::vector<Run> runs{{&recording, &results}};
  CHECK_NOTHROW(render_report(runs));
}

TEST_CASE("Report: an hour is thinned and stays below 3 MB", "[report]") {
  const std::vector<SampleRun> samples{make_sample_run(2, 3600)};
  CHECK(render_report(borrow(samples)).size() < 3'000'000);
}

TEST_CASE("Plots: the closed loop comes first, what does not move is only named", "[report]") {
  const std::vector<SampleRun> samples = make_three(30);
  const Plots plots = make_plots(borrow(samples));
  REQUIRE(plots.plots.size() > 5);
  CHECK(plots.plots[0].title == "Filled length");
  CHECK(plots.plots[0].unit == "m");
  CHECK(plots.plots[1].title == "Inlet filling ratio U");
  CHECK(plots.still == std::vector<std::string>{"plant.spill_m = 0 m", "plant.rejected_feed_kg = 0 kg"});
  const Plot& alone = find_plot(plots, "feeder.net_weight_kg");
  CHECK(alone.unit == "kg");
}

TEST_CASE("Plots: a signal that is the same in all runs is drawn once", "[report]") {
  const std::vector<SampleRun> samples = make_three(10);
  const Plot plot = make_plots(borrow(samples)).plots[0];
  const auto lines_of = [&](const std::string& signal) {
    return std::count_if(plot.series.begin(), plot.series.end(),
                         [&](const PlotSeries& series) { return series.signal == signal; });
  };
  CHECK(lines_of("plant.x_m") == 3);
  CHECK(lines_of("controller.set_point_m") == 1);
  const auto set_point = std::find_if(plot.series.begin(), plot.series.end(),
                                      [](const PlotSeries& s) { return s.signal == "controller.set_point_m"; });
  CHECK(set_point->run == -1);
}

TEST_CASE("Plots: short runs keep every row, thinned ones keep every peak", "[report]") {
  record::Recording recording;
  recording.signals = {{"plant.x_m"}};
  for (int i = 0; i < 100'000; ++i) {
    recording.row_times.push_back(Instant{i * 10ms});
    recording.values.push_back(std::sin(1e-4 * i) + (i == 54'321 ? 7 : 0) - (i == 77'777 ? 7 : 0));
  }
  const check::CheckResults results;
  const std::vector<Run> runs{{&recording, &results}};
  const Plots whole = make_plots(runs, 200'000);
  CHECK_FALSE(whole.thinned);
  CHECK(whole.times_s.size() == 100'000);

  const Plots thinned = make_plots(runs, 4'000);
  CHECK(thinned.thinned);
  CHECK(thinned.times_s.size() == 4'000);
  const std::vector<float>& values = thinned.plots[0].series[0].values;
  REQUIRE(values.size() == 4'000);
  const auto highest = std::max_element(values.begin(), values.end());
  const auto lowest = std::min_element(values.begin(), values.end());
  CHECK(*highest == static_cast<float>(std::sin(5.4321) + 7));
  CHECK(*lowest == static_cast<float>(std::sin(7.7777) - 7));
  // A bucket is 0.5 s wide; the peak is drawn inside its own.
  const double at_s = thinned.times_s[static_cast<std::size_t>(highest - values.begin())];
  CHECK(std::abs(at_s - 543.21) < 0.5);
}

TEST_CASE("Plots: runs of different length and pace share one axis", "[report]") {
  record::Recording fast;
  record::Recording slow;
  fast.signals = slow.signals = {{"plant.x_m"}};
  for (int i = 0; i <= 100; ++i) fast.row_times.push_back(Instant{i * 10ms}), fast.values.push_back(i);
  for (int i = 0; i <= 20; ++i) slow.row_times.push_back(Instant{i * 100ms}), slow.values.push_back(-i);
  const check::CheckResults results;
  const std::vector<Run> runs{{&fast, &results}, {&slow, &results}};
  const Plots plots = make_plots(runs);
  REQUIRE(plots.plots[0].series.size() == 2);
  CHECK(plots.plots[0].series[0].values.size() == plots.times_s.size());
  CHECK(plots.plots[0].series[1].values.size() == plots.times_s.size());
  const auto samples_of = [&](std::size_t series) {
    const auto& values = plots.plots[0].series[series].values;
    return std::count_if(values.begin(), values.end(), [](float value) { return std::isfinite(value); });
  };
  CHECK(samples_of(0) == 101);
  CHECK(samples_of(1) == 21);
}

TEST_CASE("Plots: values cross to the page as float32 in base64", "[report]") {
  Plots plots;
  plots.times_s = {0, 0.01, 1};
  plots.plots = {{"x", "m", {{"plant.x_m", 0, {1.0F, -2.5F, std::nanf("")}}}}};
  const nlohmann::json json = nlohmann::json::parse(write_plots_json(plots));
  CHECK(json.at("t") == nlohmann::json{0, 0.01, 1});
  // 1.0 = 0000803F, -2.5 = 000020C0, quiet NaN = 0000C07F.
  CHECK(json.at("plots")[0].at("series")[0].at("data") == "AACAPwAAIMAAAMB/");
}

TEST_CASE("Histogram: equal periods fall into the middle, a late one to the end", "[report]") {
  const std::vector<std::vector<double>> same{std::vector<double>(100, 0.01)};
  const Histogram narrow = calc_histogram(same, 41);
  CHECK(narrow.counts[0][20] == 100);
  const std::vector<std::vector<double>> late{{0.01, 0.01, 0.02}, {0.01}};
  const Histogram wide = calc_histogram(late, 41);
  CHECK(wide.from_s == Approx(0.01));
  CHECK(wide.to_s == Approx(0.02));
  CHECK(wide.counts[0].front() == 2);
  CHECK(wide.counts[0].back() == 1);
  CHECK(wide.counts[1].front() == 1);
  CHECK(render_histogram(wide).find("class=\"run1\"") != std::string::npos);
}

TEST_CASE("Quantities: a prefix where the unit takes one", "[report]") {
  CHECK(format_quantity(0.00028, "m") == "280 µm");
  CHECK(format_quantity(0.0042, "m") == "4.2 mm");
  CHECK(format_quantity(0.576, "s") == "576 ms");
  CHECK(format_quantity(-43e3, "Pa") == "-43 kPa");
  CHECK(format_quantity(1200, "s") == "1200 s");
  CHECK(format_quantity(0.0012, "kg/s") == "0.0012 kg/s");
  CHECK(format_quantity(3, "") == "3");
  CHECK(format_quantity(0, "m") == "0 m");
}

TEST_CASE("Escaping: markup, control bytes and broken UTF-8", "[report]") {
  CHECK(escape_markup("<a href=\"x\">'&") == "&lt;a href=&quot;x&quot;&gt;&#39;&amp;");
  CHECK(escape_markup("±0.1 µm – ✓") == "±0.1 µm – ✓");
  CHECK(escape_markup(std::string_view{"a\0b", 3}) ==
        "a\xEF\xBF\xBD"
        "b");
  CHECK(escape_markup("\xC3") == "\xEF\xBF\xBD");
  CHECK(escape_markup("\xED\xA0\x80") == "\xEF\xBF\xBD\xEF\xBF\xBD\xEF\xBF\xBD");
  CHECK(escape_script_json("\"</script><!--\"") == "\"\\u003c/script>\\u003c!--\"");
  CHECK(escape_script_json("\"\xE2\x80\xA8\"") == "\"\\u2028\"");
}

}  // namespace meltbench::report
