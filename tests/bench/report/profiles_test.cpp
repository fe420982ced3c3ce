#include "bench/report/profiles.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <catch2/catch.hpp>
#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>

#include "bench/report/plots.hpp"
#include "bench/report/sections.hpp"

namespace meltbench::report {
namespace {

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

std::vector<std::string> number_names(const std::string& prefix, int count, const std::string& unit) {
  std::vector<std::string> names;
  for (int i = 0; i < count; ++i) names.push_back(fmt::format("{}_{:02}_{}", prefix, i, unit));
  return names;
}

void add_signals(record::Recording& recording, const std::vector<std::string>& names) {
  for (const std::string& name : names) recording.signals.push_back({name});
}

double sample_front_m(double t_s) {
  return 0.05 - 0.03 * std::exp(-t_s);
}

/// Truth and estimate at 41 points, a front that is fast at first, and the account of energy: 10 s in rows of 10 ms
/// times `stretch`. The estimate has no value for the first ten rows.
record::Recording make_melt_run(int rows = 1001, double stretch = 1) {
  record::Recording recording;
  recording.info.scenario = "melt";
  add_signals(recording, {"melt.front_m", "controller.front_m", "melt.energy_stored_m", "melt.energy_residual_m",
                          "plant.mass_residual_m", "melt.length_m", "melt.T_melt_degC"});
  // The estimate first: the truth must come first by its role, not by its place.
  add_signals(recording, number_names("controller.T", 41, "degC"));
  add_signals(recording, number_names("melt.T", 41, "degC"));
  for (int row = 0; row < rows; ++row) {
    const double t_s = 0.01 * stretch * row;
    const double front_m = sample_front_m(t_s);
    recording.row_times.push_back(Instant{nanos_from_s(t_s)});
    for (const double value : {front_m, row < 10 ? kNaN : front_m, front_m - 0.02, 1.5e-4, -2e-10, 0.1, 135.0}) {
      recording.values.push_back(value);
    }
    for (const double error_K : {row < 10 ? kNaN : 0.25, 0.0}) {
      for (int i = 0; i <= 40; ++i) recording.values.push_back(135 + 400 * (0.0025 * i - front_m) - error_K);
    }
  }
  return recording;
}

}  // namespace

TEST_CASE("Profiles: numbered points without a gap are one, from every source", "[report]") {
  std::vector<std::string> names = number_names("melt.T", 41, "degC");
  names.push_back("melt.T_inlet_degC");
  for (const std::string& name : number_names("zone.flux", 5, "W_per_m2")) names.push_back(name);
  const std::vector<ProfileSignals> found = find_profile_signals(names);
  REQUIRE(found.size() == 2);
  CHECK(found[0].prefix == "melt.T");
  CHECK(found[0].unit == "degC");
  CHECK(found[0].names.size() == 41);
  CHECK(found[0].names.back() == "melt.T_40_degC");
  CHECK(found[1].prefix == "zone.flux");
  CHECK(found[1].unit == "W_per_m2");
}

TEST_CASE("Profiles: points in any order are put in theirs", "[report]") {
  std::vector<std::string> names = number_names("melt.T", 6, "degC");
  std::reverse(names.begin(), names.end());
  const std::vector<ProfileSignals> found = find_profile_signals(names);
  REQUIRE(found.size() == 1);
  CHECK(found[0].names == number_names("melt.T", 6, "degC"));
}

TEST_CASE("Profiles: a gap, a late start, too few points or three digits make none", "[report]") {
  std::vector<std::string> gap = number_names("melt.T", 8, "degC");
  gap.erase(gap.begin() + 6);
  CHECK(find_profile_signals(gap).empty());
  std::vector<std::string> late = number_names("melt.T", 8, "degC");
  late.erase(late.begin());
  CHECK(find_profile_signals(late).empty());
  CHECK(find_profile_signals(number_names("melt.T", 4, "degC")).empty());
  CHECK(find_profile_signals(number_names("melt.T_0", 8, "degC")).size() == 1);  // "T_0_00": a prefix like any other.
  const std::vector<std::string> odd{"a_000_K", "a_001_K", "a_002_K", "a_003_K", "a_004_K", "_00_", "a_00", "00_K"};
  CHECK(find_profile_signals(odd).empty());
}

TEST_CASE("Profiles: points are neither plotted as lines nor named as standing still", "[report]") {
  record::Recording recording = make_melt_run(50);
  const std::size_t width = recording.signals.size();
  const std::size_t first = *recording.find_signal("melt.T_00_degC");
  for (std::size_t row = 0; row < recording.row_count(); ++row) recording.values[row * width + first] = 20;
  const check::CheckResults results;
  const std::vector<Run> runs{{&recording, &results}};
  const Plots plots = make_plots(runs);
  CHECK(plots.plots.size() == 2);  // The fronts in one, and the stored energy; all else stands still.
  for (const Plot& plot : plots.plots) {
    for (const PlotSeries& series : plot.series) CHECK(series.signal.find(".T_") == std::string::npos);
  }
  for (const std::string& still : plots.still) CHECK(still.find("T_00") == std::string::npos);
}

TEST_CASE("Profiles: truth first, estimate last, with front, melting point and length", "[report]") {
  const record::Recording recording = make_melt_run();
  const check::CheckResults results;
  const std::vector<Run> runs{{&recording, &results}};
  const std::vector<Profile> profiles = make_profiles(runs);
  REQUIRE(profiles.size() == 1);
  CHECK(profiles[0].sources == std::vector<std::string>{"melt", "controller"});
  CHECK(profiles[0].points == 41);
  REQUIRE(profiles[0].runs.size() == 1);
  const ProfileRun& run = profiles[0].runs[0];
  REQUIRE(run.length_m);
  CHECK(*run.length_m == 0.1);
  CHECK(run.layers[0].front_m.back() == sample_front_m(10));
  CHECK(run.layers[0].melting.front() == 135);
  CHECK(run.layers[1].melting.empty());
  const std::size_t last = 41 * (run.times_s.size() - 1);
  CHECK(run.layers[0].values[last + 20] - run.layers[1].values[last + 20] == Approx(0.25));
}

TEST_CASE("Profiles: a run without an estimate, and one without any, are told apart", "[report]") {
  record::Recording whole = make_melt_run(20);
  record::Recording truth_only;
  add_signals(truth_only, number_names("melt.T", 41, "degC"));
  truth_only.row_times.push_back(Instant{});
  truth_only.values.assign(41, 20.0);
  record::Recording other;
  add_signals(other, {"plant.x_m"});
  const check::CheckResults results;
  const std::vector<Run> runs{{&other, &results}, {&truth_only, &results}, {&whole, &results}};
  const std::vector<Profile> profiles = make_profiles(runs);
  REQUIRE(profiles.size() == 1);
  REQUIRE(profiles[0].runs.size() == 2);
  CHECK(profiles[0].runs[0].run == 1);
  CHECK_FALSE(profiles[0].runs[0].length_m);
  CHECK(profiles[0].runs[0].layers[1].values.empty());
  CHECK(profiles[0].runs[1].run == 2);
  const nlohmann::json json = nlohmann::json::parse(write_profiles_json(profiles));
  CHECK(json[0]["runs"][0]["layers"][1].is_null());
  CHECK(json[0]["runs"][0]["length_m"].is_null());
}

TEST_CASE("Profiles: thinned to the first, the last and at most so many rows", "[report]") {
  const record::Recording recording = make_melt_run(5001);
  const check::CheckResults results;
  const std::vector<Run> runs{{&recording, &results}};
  const ProfileRun thinned = make_profiles(runs, 100).front().runs.front();
  CHECK(thinned.times_s.size() <= 100);
  CHECK(thinned.times_s.size() > 90);
  CHECK(thinned.times_s.front() == 0);
  CHECK(thinned.times_s.back() == Approx(50));
  CHECK(std::is_sorted(thinned.times_s.begin(), thinned.times_s.end()));
  CHECK(thinned.layers[0].values.size() == 41 * thinned.times_s.size());
  // The front goes 95 % of its way in the first 3 s of 50: 6 % of the time, but nearly half of the instants.
  const auto early = std::count_if(thinned.times_s.begin(), thinned.times_s.end(), [](double t_s) { return t_s < 3; });
  CHECK(early > 40);

  const record::Recording brief = make_melt_run(60);
  const std::vector<Run> short_runs{{&brief, &results}};
  CHECK(make_profiles(short_runs, 60).front().runs.front().times_s.size() == 60);
}

TEST_CASE("Profiles: one that never moves is thinned evenly", "[report]") {
  record::Recording recording;
  add_signals(recording, number_names("melt.T", 5, "degC"));
  for (int row = 0; row <= 1000; ++row) recording.row_times.push_back(Instant{row * 10ms});
  recording.values.assign(5 * recording.row_count(), kNaN);
  const check::CheckResults results;
  const std::vector<Run> runs{{&recording, &results}};
  const ProfileRun run = make_profiles(runs, 102).front().runs.front();
  REQUIRE(run.times_s.size() > 100);
  for (std::size_t i = 1; i < run.times_s.size(); ++i) CHECK(run.times_s[i] - run.times_s[i - 1] < 0.115);
  CHECK_NOTHROW(write_profiles_json(make_profiles(runs)));
}

TEST_CASE("Profiles: values cross to the page as steps of a 65534th of their range", "[report]") {
  Profile profile{"T", "degC", 3, {"melt"}, {}};
  profile.runs.push_back({0, {0.0}, 0.1, {{{100, 165.534, kNaN}, {0.02}, {}}}});
  const std::vector<Profile> profiles{profile};
  const nlohmann::json layer = nlohmann::json::parse(write_profiles_json(profiles))[0]["runs"][0]["layers"][0];
  CHECK(layer["from"] == 100);
  CHECK(layer["step"].get<double>() == Approx(0.001));
  CHECK(layer["data"] == "AAD+////");  // 0000, FFFE and FFFF for none, low byte first.
  CHECK(layer["front"] == nlohmann::json{0.02});
}

TEST_CASE("Profiles: three runs of two minutes with truth and estimate add less than 400 kB", "[report]") {
  const record::Recording recording = make_melt_run(12'001);
  const check::CheckResults results;
  const std::vector<Run> runs(3, Run{&recording, &results});
  CHECK(write_profiles_json(make_profiles(runs)).size() < 400'000);
  CHECK(render_report(runs).size() < 3'000'000);
}

TEST_CASE("Profiles: hostile names stay text, and a page without profiles has no part of theirs", "[report]") {
  record::Recording recording;
  add_signals(recording, number_names("</script><b>.T", 5, "degC"));
  recording.row_times.push_back(Instant{});
  recording.values.assign(5, 20.0);
  const check::CheckResults results;
  const std::vector<Run> runs{{&recording, &results}};
  const std::string page = render_report(runs);
  CHECK(page.find("</script><b>") == std::string::npos);
  CHECK(page.find("\\u003c/script>\\u003cb>.T") != std::string::npos);
  CHECK(page.find("id=\"profiles\"") != std::string::npos);

  const record::Recording plain;
  const std::vector<Run> plain_runs{{&plain, &results}};
  const std::string plain_page = render_report(plain_runs);
  CHECK(plain_page.find("id=\"profiles\"") == std::string::npos);
  CHECK(plain_page.find("space-time maps") == std::string::npos);
}

TEST_CASE("Balances: mass as a length, energy as a share of what was stored, of the last row that has them",
          "[report]") {
  record::Recording recording = make_melt_run();
  const std::size_t width = recording.signals.size();
  recording.values[width * (recording.row_count() - 1) + *recording.find_signal("melt.energy_residual_m")] = kNaN;
  const check::CheckResults results;
  const std::vector<Run> runs{{&recording, &results}};
  const std::string html = render_what_was_run(runs);
  // 0.15 mm of 30 mm (1 - exp(-10)).
  CHECK(
      html.find("<th>balances</th><td colspan=\"1\">mass residual -2e-10 m; energy residual 0.5 % of the range of the "
                "stored energy</td>") != std::string::npos);

  const record::Recording plain;
  const std::vector<Run> plain_runs{{&plain, &results}};
  CHECK(render_what_was_run(plain_runs).find("balances") == std::string::npos);
}

}  // namespace meltbench::report
