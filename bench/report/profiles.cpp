#include "bench/report/profiles.hpp"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdint>
#include <limits>
#include <nlohmann/json.hpp>
#include <string_view>
#include <utility>

#include "bench/report/base64.hpp"
#include "bench/report/plots.hpp"

namespace meltbench::report {
namespace {

using Json = nlohmann::ordered_json;
using record::Recording;

constexpr std::size_t kMinPoints = 5;
constexpr std::string_view kEstimator = "controller";  // Whoever else knows a profile is the plant.
constexpr double kNone = std::numeric_limits<double>::quiet_NaN();

bool is_digit(char c) {
  return c >= '0' && c <= '9';
}

/// A name of the form <prefix>_NN_<unit>, taken apart.
struct PointName {
  std::string_view prefix;
  std::size_t number = 0;
  std::string_view unit;
};

std::optional<PointName> parse_point(std::string_view name) {
  for (std::size_t at = name.find('_', 1); at != std::string_view::npos; at = name.find('_', at + 1)) {
    const std::string_view rest = name.substr(at);
    if (rest.size() < 5 || !is_digit(rest[1]) || !is_digit(rest[2]) || rest[3] != '_') continue;
    const int number = 10 * (rest[1] - '0') + (rest[2] - '0');
    return PointName{name.substr(0, at), static_cast<std::size_t>(number), rest.substr(4)};
  }
  return std::nullopt;
}

std::string_view source_of(std::string_view prefix) {
  const std::size_t dot = prefix.rfind('.');
  return dot == std::string_view::npos ? std::string_view{} : prefix.substr(0, dot);
}

std::string_view quantity_of(std::string_view prefix) {
  return prefix.substr(prefix.rfind('.') + 1);  // npos + 1 = 0: no source, all of it.
}

/// Columns of a profile in a recording; empty unless it has all of them.
std::vector<std::size_t> find_columns(const Recording& recording, const ProfileSignals& profile) {
  std::vector<std::size_t> columns;
  for (const std::string& name : profile.names) {
    const auto column = recording.find_signal(name);
    if (!column) return {};
    columns.push_back(*column);
  }
  return columns;
}

/// How far the profile moved from one row to the next; what has no value does not move.
double calc_change(const Recording& recording, std::span<const std::size_t> columns, std::size_t row) {
  double sum = 0;
  for (const std::size_t column : columns) {
    const double change = std::abs(recording.value(row, column) - recording.value(row - 1, column));
    if (std::isfinite(change)) sum += change;
  }
  return sum;
}

/// Rows to keep, see make_profiles().
std::vector<std::size_t> choose_rows(const Recording& recording, std::span<const std::size_t> columns,
                                     std::size_t max_rows) {
  const std::size_t count = recording.row_count();
  std::vector<std::size_t> rows;
  if (count <= max_rows) {
    for (std::size_t row = 0; row < count; ++row) rows.push_back(row);
    return rows;
  }
  std::vector<double> change(count, 0);
  for (std::size_t row = 1; row < count; ++row) change[row] = change[row - 1] + calc_change(recording, columns, row);
  const double start_s = to_s(recording.row_times.front());
  const double duration_s = std::max(to_s(recording.row_times.back()) - start_s, 1e-9);
  const double whole_change = change.back();

  rows.push_back(0);
  double level = 0;
  for (std::size_t row = 1; row + 1 < count; ++row) {
    const double passed = (to_s(recording.row_times[row]) - start_s) / duration_s;
    const double changed = whole_change > 0 ? change[row] / whole_change : passed;
    const double reached = std::floor((passed + changed) / 2 * static_cast<double>(max_rows - 2));
    if (reached <= level) continue;
    level = reached;
    rows.push_back(row);
  }
  rows.push_back(count - 1);
  return rows;
}

std::vector<double> take_rows(const Recording& recording, const std::string& signal,
                              std::span<const std::size_t> rows) {
  std::vector<double> values;
  if (const auto column = recording.find_signal(signal)) {
    for (const std::size_t row : rows) values.push_back(recording.value(row, *column));
  }
  return values;
}

/// The first value of the signal that is a length.
std::optional<double> find_length_m(const Recording& recording, const std::string& signal) {
  const auto column = recording.find_signal(signal);
  for (std::size_t row = 0; column && row < recording.row_count(); ++row) {
    const double value = recording.value(row, *column);
    if (std::isfinite(value) && value > 0) return value;
  }
  return std::nullopt;
}

ProfileLayer make_layer(const Recording& recording, const ProfileSignals& profile, std::span<const std::size_t> rows) {
  ProfileLayer layer;
  const std::vector<std::size_t> columns = find_columns(recording, profile);
  if (columns.empty()) return layer;
  for (const std::size_t row : rows) {
    for (const std::size_t column : columns) layer.values.push_back(recording.value(row, column));
  }
  layer.front_m = take_rows(recording, std::string{source_of(profile.prefix)} + ".front_m", rows);
  layer.melting = take_rows(recording, profile.prefix + "_melt_" + profile.unit, rows);
  return layer;
}

std::optional<ProfileRun> make_run(const Recording& recording, int run, std::span<const ProfileSignals> sources,
                                   std::size_t max_instants) {
  std::vector<std::size_t> columns;
  for (const ProfileSignals& profile : sources) {
    const std::vector<std::size_t> more = find_columns(recording, profile);
    columns.insert(columns.end(), more.begin(), more.end());
  }
  if (columns.empty() || recording.row_count() == 0) return std::nullopt;
  ProfileRun result;
  result.run = run;
  const std::vector<std::size_t> rows = choose_rows(recording, columns, max_instants);
  for (const std::size_t row : rows) result.times_s.push_back(to_s(recording.row_times[row]));
  for (const ProfileSignals& profile : sources) {
    result.layers.push_back(make_layer(recording, profile, rows));
    if (!result.length_m) {
      result.length_m = find_length_m(recording, std::string{source_of(profile.prefix)} + ".length_m");
    }
  }
  return result;
}

Json write_layer(const ProfileLayer& layer) {
  static_assert(std::endian::native == std::endian::little, "the page reads little-endian uint16");
  constexpr double kSteps = 65534;
  if (layer.values.empty()) return nullptr;
  double min = std::numeric_limits<double>::infinity();
  double max = -min;
  for (const double value : layer.values) {
    if (!std::isfinite(value)) continue;
    min = std::min(min, value);
    max = std::max(max, value);
  }
  const double from = min <= max ? min : 0;
  const double step = min < max ? (max - min) / kSteps : 1;
  std::vector<std::uint16_t> numbers;
  numbers.reserve(layer.values.size());
  for (const double value : layer.values) {
    numbers.push_back(std::isfinite(value) ? static_cast<std::uint16_t>(std::lround((value - from) / step)) : 0xFFFF);
  }
  const auto rounded = [](const std::vector<double>& values) {
    Json list = Json::array();
    for (const double value : values) list.push_back(std::round(value * 1e6) / 1e6);  // NaN becomes null.
    return list;
  };
  return Json{{"from", from},
              {"step", step},
              {"data", to_base64(std::as_bytes(std::span{numbers}))},
              {"front", rounded(layer.front_m)},
              {"melting", rounded(layer.melting)}};
}

Json write_run(const ProfileRun& run) {
  Json times = Json::array();
  for (const double t_s : run.times_s) times.push_back(std::round(t_s * 1e6) / 1e6);
  Json layers = Json::array();
  for (const ProfileLayer& layer : run.layers) layers.push_back(write_layer(layer));
  // NaN becomes null.
  return Json{{"run", run.run},
              {"t", std::move(times)},
              {"length_m", run.length_m.value_or(kNone)},
              {"layers", std::move(layers)}};
}

}  // namespace

std::vector<ProfileSignals> find_profile_signals(std::span<const std::string> names) {
  std::vector<ProfileSignals> found;
  for (const std::string& name : names) {
    const auto point = parse_point(name);
    if (!point || point->number != 0) continue;
    ProfileSignals profile{std::string{point->prefix}, std::string{point->unit}, {}};
    std::size_t members = 0;
    std::vector<std::string> by_number(100);
    for (const std::string& other : names) {
      const auto member = parse_point(other);
      if (!member || member->prefix != profile.prefix || member->unit != profile.unit) continue;
      by_number[member->number] = other;
      ++members;
    }
    for (std::size_t n = 0; n < by_number.size() && !by_number[n].empty(); ++n) profile.names.push_back(by_number[n]);
    if (profile.names.size() == members && members >= kMinPoints) found.push_back(std::move(profile));
  }
  return found;
}

std::vector<Profile> make_profiles(std::span<const Run> runs, std::size_t max_instants) {
  std::vector<ProfileSignals> all = find_profile_signals(all_signals(runs));
  std::stable_partition(all.begin(), all.end(),
                        [](const ProfileSignals& profile) { return source_of(profile.prefix) != kEstimator; });
  std::vector<Profile> result;
  while (!all.empty()) {
    const std::string quantity{quantity_of(all.front().prefix)};
    const std::string unit = all.front().unit;
    const std::size_t points = all.front().names.size();
    const auto rest = std::stable_partition(all.begin(), all.end(), [&](const ProfileSignals& other) {
      return quantity_of(other.prefix) == quantity && other.unit == unit && other.names.size() == points;
    });
    const std::span<const ProfileSignals> together{all.begin(), rest};
    Profile profile{quantity, unit, points, {}, {}};
    for (const ProfileSignals& signals : together) profile.sources.emplace_back(source_of(signals.prefix));
    for (std::size_t i = 0; i < runs.size(); ++i) {
      auto run = make_run(*runs[i].recording, static_cast<int>(i), together, max_instants);
      if (run) profile.runs.push_back(std::move(*run));
    }
    if (!profile.runs.empty()) result.push_back(std::move(profile));
    all.erase(all.begin(), rest);
  }
  return result;
}

std::string write_profiles_json(std::span<const Profile> profiles) {
  Json list = Json::array();
  for (const Profile& profile : profiles) {
    Json layers = Json::array();
    for (const std::string& source : profile.sources) {
      layers.push_back(Json{{"signal", source.empty() ? profile.quantity : source + "." + profile.quantity},
                            {"role", source == kEstimator ? "estimate" : "truth"}});
    }
    Json runs = Json::array();
    for (const ProfileRun& run : profile.runs) runs.push_back(write_run(run));
    list.push_back(Json{{"quantity", profile.quantity},
                        {"unit", profile.unit},
                        {"points", profile.points},
                        {"layers", std::move(layers)},
                        {"runs", std::move(runs)}});
  }
  return list.dump(-1, ' ', false, Json::error_handler_t::replace);
}

}  // namespace meltbench::report
