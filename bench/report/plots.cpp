#include "bench/report/plots.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstring>
#include <initializer_list>
#include <limits>
#include <nlohmann/json.hpp>
#include <optional>
#include <string_view>
#include <utility>

#include "bench/report/base64.hpp"
#include "bench/report/profiles.hpp"

namespace meltbench::report {
namespace {

using record::Recording;

constexpr float kNoSample = std::numeric_limits<float>::infinity();
constexpr std::size_t kMinPoints = 800;

struct KnownPlot {
  std::string_view title;
  std::initializer_list<std::string_view> signals;
};

/// The closed loop in the order in which one reads it. Signals of one line share a plot.
const KnownPlot kKnownPlots[] = {
    {"Filled length", {"plant.x_m", "controller.x_m", "controller.set_point_m", "controller.P_m"}},
    {"Melting front", {"melt.front_m", "controller.front_m", "controller.front_set_m", "melt_camera.front_m"}},
    {"Inlet temperature",
     {"melt.T_inlet_degC", "controller.T_inlet_degC", "controller.T_inlet_estimate_degC", "melt_camera.T_inlet_degC"}},
    {"Inlet heat flux", {"melt.q_f_W_per_m2", "controller.q_f_W_per_m2", "controller.q_f_star_W_per_m2"}},
    {"Barrel temperatures",
     {"barrel.T_zone1_degC", "barrel.T_zone2_degC", "barrel.T_zone3_degC", "barrel.T_zone4_degC",
      "barrel.T_nozzle_degC", "controller.zone1_set_degC"}},
    {"Heater power",
     {"barrel.power_zone1_W", "barrel.power_zone2_W", "barrel.power_zone3_W", "barrel.power_zone4_W",
      "barrel.power_nozzle_W"}},
    {"Margins of the melt model",
     {"melt.solid_margin_K", "melt.liquid_margin_K", "controller.solid_margin_K", "controller.liquid_margin_K"}},
    {"Margin between granules and filled zone", {"plant.melt_margin_m"}},
    {"Inlet filling ratio U", {"plant.U", "controller.U_command", "controller.U_applied"}},
    {"Delay", {"plant.delay_s", "controller.delay_s"}},
    {"Rate of the delay", {"plant.delay_rate"}},
    {"Mass flow", {"plant.flow_kg_per_s", "plant.feed_kg_per_s"}},
    {"Feeder",
     {"controller.flow_command_kg_per_h", "feeder.set_point_kg_per_h", "feeder.flow_kg_per_h",
      "feeder.measured_flow_kg_per_h"}},
    {"Melt pressure", {"plant.pressure_Pa", "melt_pressure.reading_Pa", "controller.pressure_Pa"}},
    {"Conveying speed", {"plant.speed_m_per_s", "controller.speed_m_per_s"}},
    {"Age of measurements", {"controller.measurement_age_s", "melt_pressure.sample_age_s"}},
};

/// A plot before its values: which signals.
struct Group {
  std::string title;
  std::string unit;
  std::vector<std::string> signals;
};

bool is_counter(std::span<const Run> runs, std::string_view name) {
  return std::any_of(runs.begin(), runs.end(), [&](const Run& run) {
    const auto column = run.recording->find_signal(name);
    return column && run.recording->signals[*column].kind == SignalKind::kErrorCounter;
  });
}

/// The value that the signal has in every row of every run; nothing if it moves (or has no value somewhere).
std::optional<double> find_still_value(std::span<const Run> runs, std::string_view name) {
  std::optional<double> still;
  for (const Run& run : runs) {
    const auto column = run.recording->find_signal(name);
    for (std::size_t row = 0; column && row < run.recording->row_count(); ++row) {
      const double value = run.recording->value(row, *column);
      if (std::isnan(value) || (still && *still != value)) return std::nullopt;
      still = value;
    }
  }
  return still;
}

/// Known plots first, then the rest each alone (their sizes differ too much to share an axis), error counters last.
/// Still signals are left out unless they belong to a known plot of which another one moves. The points of profiles are
/// no lines of ours: see profiles.hpp.
std::vector<Group> make_groups(std::span<const Run> runs, std::vector<std::string>& still) {
  std::vector<std::string> rest = all_signals(runs);
  for (const ProfileSignals& profile : find_profile_signals(rest)) {
    std::erase_if(rest, [&](const std::string& name) {
      return std::find(profile.names.begin(), profile.names.end(), name) != profile.names.end();
    });
  }
  const auto take = [&](std::string_view name) {
    const auto found = std::find(rest.begin(), rest.end(), name);
    if (found == rest.end()) return false;
    rest.erase(found);
    return true;
  };
  const auto note_still = [&](const std::string& name, double value) {
    const std::string unit = record::unit_of_signal(name);
    still.push_back(fmt::format("{} = {:.6g}{}{}", name, value, unit.empty() ? "" : " ", unit));
  };

  std::vector<Group> groups;
  for (const KnownPlot& known : kKnownPlots) {
    Group group{std::string{known.title}, record::unit_of_signal(*known.signals.begin()), {}};
    for (const std::string_view name : known.signals) {
      if (take(name)) group.signals.emplace_back(name);
    }
    if (group.signals.empty()) continue;
    const bool moves = std::any_of(group.signals.begin(), group.signals.end(),
                                   [&](const std::string& name) { return !find_still_value(runs, name); });
    if (moves) {
      groups.push_back(std::move(group));
    } else {
      for (const std::string& name : group.signals) note_still(name, *find_still_value(runs, name));
    }
  }

  std::vector<Group> others;
  Group counters{"Error counters", "", {}};
  for (const std::string& name : rest) {
    if (const auto value = find_still_value(runs, name)) {
      note_still(name, *value);
    } else if (is_counter(runs, name)) {
      counters.signals.push_back(name);
    } else {
      others.push_back({name, record::unit_of_signal(name), {name}});
    }
  }
  groups.insert(groups.end(), others.begin(), others.end());
  if (!counters.signals.empty()) groups.push_back(std::move(counters));
  return groups;
}

float to_plot_value(double value) {
  return std::isfinite(value) ? static_cast<float>(value) : std::numeric_limits<float>::quiet_NaN();
}

/// The common time axis.
struct Axis {
  std::vector<double> times_s;
  std::size_t buckets = 0;  ///< 0: the times are the rows of every run.
  double bucket_s = 0;
};

Axis make_axis(std::span<const Run> runs, std::size_t max_points) {
  const std::vector<Instant>& rows = runs[0].recording->row_times;
  const bool same_rows =
      std::all_of(runs.begin(), runs.end(), [&](const Run& run) { return run.recording->row_times == rows; });
  Axis axis;
  if (same_rows && rows.size() <= max_points) {
    for (const Instant at : rows) axis.times_s.push_back(to_s(at));
    return axis;
  }
  double end_s = 0;
  std::size_t most_rows = 0;
  for (const Run& run : runs) {
    if (run.recording->row_times.empty()) continue;
    end_s = std::max(end_s, to_s(run.recording->row_times.back()));
    most_rows = std::max(most_rows, run.recording->row_count());
  }
  axis.buckets = std::clamp<std::size_t>(most_rows, 1, std::max<std::size_t>(max_points / 2, 1));
  axis.bucket_s = end_s / static_cast<double>(axis.buckets);
  for (std::size_t i = 0; i < axis.buckets; ++i) {
    axis.times_s.push_back((static_cast<double>(i) + 0.25) * axis.bucket_s);
    axis.times_s.push_back((static_cast<double>(i) + 0.75) * axis.bucket_s);
  }
  return axis;
}

/// The rows of one bucket as two values: smallest and largest, in the order in which they came.
std::pair<float, float> thin(const Recording& recording, std::size_t column, std::size_t begin, std::size_t end) {
  if (begin == end) return {kNoSample, kNoSample};
  std::size_t min = begin;
  std::size_t max = begin;
  for (std::size_t row = begin; row < end; ++row) {
    const double value = recording.value(row, column);
    if (std::isnan(value)) return {to_plot_value(value), to_plot_value(value)};
    if (value < recording.value(min, column)) min = row;
    if (value > recording.value(max, column)) max = row;
  }
  if (begin + 1 == end) return {to_plot_value(recording.value(begin, column)), kNoSample};
  return {to_plot_value(recording.value(std::min(min, max), column)),
          to_plot_value(recording.value(std::max(min, max), column))};
}

std::vector<float> sample(const Recording& recording, std::size_t column, const Axis& axis) {
  std::vector<float> values;
  values.reserve(axis.times_s.size());
  if (axis.buckets == 0) {
    for (std::size_t row = 0; row < recording.row_count(); ++row) {
      values.push_back(to_plot_value(recording.value(row, column)));
    }
    return values;
  }
  std::size_t row = 0;
  for (std::size_t bucket = 0; bucket < axis.buckets; ++bucket) {
    const double end_s = static_cast<double>(bucket + 1) * axis.bucket_s;
    const bool is_last = bucket + 1 == axis.buckets;
    const std::size_t begin = row;
    while (row < recording.row_count() && (is_last || to_s(recording.row_times[row]) < end_s)) ++row;
    const auto [first, second] = thin(recording, column, begin, row);
    values.push_back(first);
    values.push_back(second);
  }
  return values;
}

bool same_values(const std::vector<float>& a, const std::vector<float>& b) {
  return a.size() == b.size() && std::memcmp(a.data(), b.data(), a.size() * sizeof(float)) == 0;
}

/// The lines of one signal, one per run; one for all if they are the same.
void add_series(Plot& plot, std::span<const Run> runs, const std::string& signal, const Axis& axis) {
  const std::size_t first = plot.series.size();
  for (std::size_t run = 0; run < runs.size(); ++run) {
    const auto column = runs[run].recording->find_signal(signal);
    if (!column) continue;
    plot.series.push_back({signal, static_cast<int>(run), sample(*runs[run].recording, *column, axis)});
  }
  if (runs.size() < 2 || plot.series.size() - first != runs.size()) return;
  for (std::size_t i = first + 1; i < plot.series.size(); ++i) {
    if (!same_values(plot.series[i].values, plot.series[first].values)) return;
  }
  plot.series.resize(first + 1);
  plot.series[first].run = -1;
}

}  // namespace

std::vector<std::string> all_signals(std::span<const Run> runs) {
  std::vector<std::string> names;
  for (const Run& run : runs) {
    for (const SignalInfo& signal : run.recording->signals) {
      if (std::find(names.begin(), names.end(), signal.name) == names.end()) names.push_back(signal.name);
    }
  }
  return names;
}

Plots make_plots(std::span<const Run> runs, std::size_t max_values) {
  Plots result;
  const std::vector<Group> groups = make_groups(runs, result.still);
  std::size_t series_count = 0;
  for (const Group& group : groups) series_count += group.signals.size() * runs.size();
  const std::size_t max_points = std::max(kMinPoints, max_values / std::max<std::size_t>(series_count, 1));

  Axis axis = make_axis(runs, max_points);
  for (const Group& group : groups) {
    Plot plot{group.title, group.unit, {}, false};
    for (const std::string& signal : group.signals) add_series(plot, runs, signal, axis);
    result.plots.push_back(std::move(plot));
  }
  result.thinned = axis.buckets != 0;
  result.times_s = std::move(axis.times_s);
  return result;
}

std::string write_plots_json(const Plots& plots) {
  static_assert(std::endian::native == std::endian::little, "the page reads little-endian float32");
  using Json = nlohmann::ordered_json;
  std::string times;
  // Six digits after the point: a microsecond is far below a pixel.
  for (const double t_s : plots.times_s) {
    if (!times.empty()) times += ',';
    const std::string text = fmt::format("{:.6f}", t_s);
    const std::size_t last = text.find_last_not_of('0');
    times += text.substr(0, text[last] == '.' ? last : last + 1);
  }
  Json list = Json::array();
  for (const Plot& plot : plots.plots) {
    Json series = Json::array();
    for (const PlotSeries& s : plot.series) {
      series.push_back(
          Json{{"signal", s.signal}, {"run", s.run}, {"data", to_base64(std::as_bytes(std::span{s.values}))}});
    }
    list.push_back(
        Json{{"title", plot.title}, {"unit", plot.unit}, {"stepped", plot.stepped}, {"series", std::move(series)}});
  }
  return "{\"t\":[" + times + "],\"plots\":" + list.dump(-1, ' ', false, Json::error_handler_t::replace) + "}";
}

}  // namespace meltbench::report
