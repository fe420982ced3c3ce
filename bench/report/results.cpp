#include "bench/report/results.hpp"

#include <fmt/format.h>

#include <cmath>
#include <fstream>
#include <iterator>
#include <limits>
#include <nlohmann/json.hpp>
#include <utility>

#include "bench/record/bus_statistics.hpp"
#include "bench/record/load_recording.hpp"
#include "bench/report/escape.hpp"
#include "bench/report/response.hpp"
#include "bench/report/whole_file.hpp"

namespace meltbench::report {
namespace {

using Json = nlohmann::ordered_json;

/// JSON has no infinity and no NaN: those are null.
Json number(double value) {
  return std::isfinite(value) ? Json(value) : Json(nullptr);
}
Json number(std::optional<double> value) {
  return value ? number(*value) : Json(nullptr);
}

Json describe(const check::CheckResult& check) {
  Json object{
      {"name", check.name}, {"kind", check.kind},         {"held", check.held}, {"margin", number(check.margin)},
      {"unit", check.unit}, {"at_s", number(check.at_s)}, {"text", check.text}};
  if (!check.skipped.empty()) object["skipped"] = check.skipped;
  return object;
}

Json describe(const record::BusStatistics& bus) {
  Json ids = Json::array();
  for (const record::IdStatistics& id : bus.ids) {
    ids.push_back(Json{{"cob_id", fmt::format("{:0{}X}", id.id, id.extended ? 8 : 3)},
                       {"name", id.name},
                       {"frames", id.frames},
                       {"data_bytes", id.data_bytes},
                       {"mean_period_s", number(id.mean_period_s)},
                       {"min_period_s", number(id.min_period_s)},
                       {"max_period_s", number(id.max_period_s)},
                       {"load", number(id.load)}});
  }
  return Json{
      {"frames", bus.frames},           {"data_bytes", bus.data_bytes},         {"error_frames", bus.error_frames},
      {"lost_frames", bus.lost_frames}, {"outside_frames", bus.outside_frames}, {"load", number(bus.load)},
      {"ids", std::move(ids)}};
}

Json describe(const check::Health& health) {
  return Json{
      {"held", health.held}, {"findings", health.findings}, {"expected", health.expected}, {"absent", health.absent}};
}

/// Smallest, largest and last value of every signal; null where it never had one.
Json describe_signals(const record::Recording& recording) {
  Json signals = Json::object();
  for (std::size_t column = 0; column < recording.signals.size(); ++column) {
    double min = std::numeric_limits<double>::infinity();
    double max = -min;
    for (std::size_t row = 0; row < recording.row_count(); ++row) {
      const double value = recording.value(row, column);
      if (value < min) min = value;
      if (value > max) max = value;
    }
    const std::size_t rows = recording.row_count();
    const Json last = rows == 0 ? Json(nullptr) : number(recording.value(rows - 1, column));
    signals[recording.signals[column].name] = Json{{"min", number(min)}, {"max", number(max)}, {"last", last}};
  }
  return signals;
}

/// Reaction times, and the lateness of wake-ups at wall-clock pace; quantiles at most 1/32 too large.
Json describe_responses(const record::Recording& recording) {
  Json responses = Json::object();
  for (const Response& response : collect_responses(recording)) {
    const LogHistogram& times = response.times;
    Json& object = responses[response.name];
    object = Json{{"count", times.count()},
                  {"p50_s", to_s(times.quantile(0.5))},
                  {"p99_s", to_s(times.quantile(0.99))},
                  {"p99.9_s", to_s(times.quantile(0.999))},
                  {"max_s", to_s(times.max())},
                  {"max_at_s", to_s(times.max_at())}};
    if (response.overruns) object["deadline_misses"] = *response.overruns;
  }
  return responses;
}

std::string dump(const Json& object) {
  return object.dump(2, ' ', false, Json::error_handler_t::replace) + "\n";
}

/// One <testcase>, with its margin where every build server shows it.
std::string describe_test_case(const std::string& class_name, const check::CheckResult& check) {
  const std::string verdict = fmt::format("{}\nmargin {:.6g} {}{}", check.text, check.margin, check.unit,
                                          check.at_s ? fmt::format(", at {:.6g} s", *check.at_s) : std::string{});
  std::string out = fmt::format("    <testcase classname=\"{}\" name=\"{}\" time=\"0\">\n", escape_markup(class_name),
                                escape_markup(check.name));
  if (!check.skipped.empty()) {
    out += fmt::format("      <skipped message=\"{}\"/>\n", escape_markup(check.skipped));
  } else if (!check.held) {
    out += fmt::format("      <failure type=\"{}\" message=\"{}\">{}</failure>\n", escape_markup(check.kind),
                       escape_markup(check.text), escape_markup(verdict));
  } else {
    out += fmt::format("      <system-out>{}</system-out>\n", escape_markup(verdict));
  }
  return out + "    </testcase>\n";
}

double read_number(const nlohmann::json& value, double if_null) {
  return value.is_null() ? if_null : value.get<double>();
}

check::CheckResult read_check(const nlohmann::json& object) {
  check::CheckResult check;
  object.at("name").get_to(check.name);
  object.at("kind").get_to(check.kind);
  object.at("held").get_to(check.held);
  check.margin = read_number(object.at("margin"), -std::numeric_limits<double>::infinity());
  object.at("unit").get_to(check.unit);
  if (!object.at("at_s").is_null()) check.at_s = object.at("at_s").get<double>();
  object.at("text").get_to(check.text);
  check.skipped = object.value("skipped", "");
  return check;
}

}  // namespace

std::string write_result_json(const record::Recording& recording, const check::CheckResults& results) {
  const record::RunInfo& info = recording.info;
  const record::Ending& ending = recording.ending;
  Json checks = Json::array();
  for (const check::CheckResult& check : results.checks) checks.push_back(describe(check));

  const record::BusStatistics bus = record::calc_bus_statistics(recording);

  Json result{{"scenario", info.scenario}};
  if (!info.variant.empty()) result["variant"] = info.variant;
  result["title"] = info.title;
  result["seed"] = info.seed;
  result["held"] = results.held();
  result["pace"] = info.pace;
  result["reproducible"] = info.in_virtual_time() && bus.outside_frames == 0;
  result["real_time_factor"] = info.in_virtual_time() ? Json(nullptr) : number(ending.real_time_factor);
  result["end"] = Json{{"reason", record::to_text(ending.reason)}, {"at_s", to_s(ending.at)}, {"text", ending.text}};
  result["checks"] = std::move(checks);
  result["health"] = describe(results.health);
  result["bus"] = describe(bus);
  result["responses"] = describe_responses(recording);
  result["bus_timing"] = recording.bus_timing ? Json(*recording.bus_timing) : Json(nullptr);
  result["signals"] = describe_signals(recording);
  return dump(result);
}

std::string write_junit_xml(const record::Recording& recording, const check::CheckResults& results) {
  std::size_t skipped = 0;
  for (const check::CheckResult& check : results.checks) skipped += check.skipped.empty() ? 0 : 1;
  const std::string label = recording.info.label();
  const std::string counts =
      fmt::format("tests=\"{}\" failures=\"{}\" errors=\"0\" skipped=\"{}\" time=\"{}\"", results.checks.size(),
                  results.failed_count(), skipped, to_s(recording.ending.at));
  std::string out = fmt::format(
      "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<testsuites name=\"meltbench\" {0}>\n  <testsuite name=\"{1}\" "
      "{0}>\n"
      "    <properties>\n      <property name=\"seed\" value=\"{2}\"/>\n      <property name=\"pace\" value=\"{3}\"/>\n"
      "    </properties>\n",
      counts, escape_markup(label), recording.info.seed, escape_markup(recording.info.pace));
  for (const check::CheckResult& check : results.checks) out += describe_test_case("meltbench." + label, check);
  return out + "  </testsuite>\n</testsuites>\n";
}

void write_run_results(const std::filesystem::path& folder, const record::Recording& recording,
                       const check::CheckResults& results) {
  write_whole_file(folder / "result.json", write_result_json(recording, results));
  write_whole_file(folder / "junit.xml", write_junit_xml(recording, results));
}

check::CheckResults load_run_results(const std::filesystem::path& folder) {
  const std::filesystem::path path = folder / "result.json";
  std::ifstream file{path, std::ios::binary};
  if (!file) {
    throw record::LoadError(path.string() + ": cannot be read",
                            "a run that was cut short has no verdict; judge it with \"meltbench check\"");
  }
  const std::string text{std::istreambuf_iterator<char>{file}, {}};
  try {
    const nlohmann::json object = nlohmann::json::parse(text);
    check::CheckResults results;
    for (const nlohmann::json& check : object.at("checks")) results.checks.push_back(read_check(check));
    const nlohmann::json& health = object.at("health");
    health.at("held").get_to(results.health.held);
    health.at("findings").get_to(results.health.findings);
    health.at("expected").get_to(results.health.expected);
    health.at("absent").get_to(results.health.absent);
    return results;
  } catch (const nlohmann::json::exception& error) {
    throw record::LoadError(path.string() + ": " + error.what(),
                            "this file was changed or is not a result of meltbench");
  }
}

}  // namespace meltbench::report
