#include "bench/report/sections.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <optional>
#include <string_view>
#include <utility>

#include "bench/report/escape.hpp"
#include "bench/report/histogram.hpp"
#include "bench/report/page_shell.hpp"

namespace meltbench::report {
namespace {

constexpr std::size_t kMaxEventsShown = 200;

/// The name of a run, and what its title says beside what the page is called.
std::string heading(std::size_t run, const std::string& name, const std::string& title, const std::string& page_title) {
  const std::string more = title.starts_with(page_title + ": ") ? title.substr(page_title.size() + 2) : std::string{};
  const bool says_more = !more.empty() && more != name;
  return fmt::format("<h3><span class=\"swatch run{}\"></span>{}{}</h3>\n", run % 8, escape_markup(name),
                     says_more ? fmt::format(" <small>{}</small>", escape_markup(more)) : "");
}

/// What each scenario says of itself, once.
std::string render_texts(std::span<const Run> runs) {
  std::string html;
  std::string_view previous;
  for (const Run& run : runs) {
    const std::string& text = run.recording->info.text;
    if (!text.empty() && text != previous) html += fmt::format("<p>{}</p>\n", escape_markup(text));
    previous = text;
  }
  return html;
}

std::string render_check(const check::CheckResult& check) {
  const char* verdict = !check.skipped.empty() ? "skipped" : check.held ? "held" : "failed";
  const char* sign = !check.skipped.empty() ? "–" : check.held ? "✓" : "✗";
  const bool measured = std::isfinite(check.margin) && check.skipped.empty() && check.kind != "health";
  return fmt::format(
      "<tr class=\"{0}\"><td class=\"verdict\">{1} {0}</td><td>{2}</td><td class=\"number\"{3}>{4}</td>"
      "<td class=\"number\"{5}>{6}</td><td class=\"text\">{7}</td></tr>\n",
      verdict, sign, escape_markup(check.name), measured ? " data-label=\"margin\"" : "",
      measured ? escape_markup(format_quantity(check.margin, check.unit)) : "", check.at_s ? " data-label=\"at\"" : "",
      check.at_s ? at_button(*check.at_s) : "", escape_markup(check.text));
}

/// One row of facts: a name and one value per run.
std::string fact(const char* name, const std::vector<std::string>& values) {
  if (std::all_of(values.begin(), values.end(), [](const std::string& value) { return value.empty(); })) return {};
  std::string row = fmt::format("<tr><th>{}</th>", name);
  // What is the same for all runs is said once.
  const bool same = std::all_of(values.begin(), values.end(), [&](const std::string& v) { return v == values[0]; });
  if (same) return row + fmt::format("<td colspan=\"{}\">{}</td></tr>\n", values.size(), escape_markup(values[0]));
  for (const std::string& value : values) row += fmt::format("<td>{}</td>", escape_markup(value));
  return row + "</tr>\n";
}

template <typename ValueOf>
std::string fact_of(const char* name, std::span<const Run> runs, ValueOf value_of) {
  std::vector<std::string> values;
  for (const Run& run : runs) values.push_back(value_of(*run.recording));
  return fact(name, values);
}

std::string describe_speed(const record::Recording& recording) {
  if (recording.ending.real_time_factor) return fmt::format("{:.4g} x real time", *recording.ending.real_time_factor);
  return recording.info.in_virtual_time() ? "virtual time" : "";
}

bool has_event(const record::Recording& recording, std::string_view code) {
  return std::ranges::any_of(recording.events, [&](const record::RecordedEvent& e) { return e.event.code == code; });
}

/// The scenario does not know of faults that were given while the run went on; repro.toml does.
bool has_live_faults(const record::Recording& recording) {
  return has_event(recording, "fault-given") || has_event(recording, "fault-cleared");
}

std::string describe_repeatability(const record::Recording& recording) {
  if (!recording.info.in_virtual_time()) return "not to the byte: at wall-clock pace";
  if (has_event(recording, "frames-from-outside")) return "not to the byte: a program outside the run has sent frames";
  return has_live_faults(recording) ? "to the byte, with the repro.toml of its folder: faults came while it went on"
                                    : "to the byte";
}

std::string describe_end(const record::Recording& recording) {
  const record::Ending& ending = recording.ending;
  std::string text = fmt::format("{} at {:.6g} s of {:.6g} s", record::to_text(ending.reason), to_s(ending.at),
                                 to_s(recording.info.duration));
  if (!ending.text.empty()) text += ": " + ending.text;
  return text;
}

struct Seen {
  double last = 0;
  double range = 0;
};

/// Last value of a signal, and the range of all; what has no value in a row is skipped.
std::optional<Seen> see_signal(const record::Recording& recording, std::string_view name) {
  const auto column = recording.find_signal(name);
  std::optional<Seen> seen;
  double min = 0;
  double max = 0;
  for (std::size_t row = 0; column && row < recording.row_count(); ++row) {
    const double value = recording.value(row, *column);
    if (!std::isfinite(value)) continue;
    min = seen ? std::min(min, value) : value;
    max = seen ? std::max(max, value) : value;
    seen = Seen{value, max - min};
  }
  return seen;
}

/// What the plant's accounts of mass and energy are off by at the end.
std::string describe_balances(const record::Recording& recording) {
  std::vector<std::string> parts;
  if (const auto mass = see_signal(recording, "plant.mass_residual_m")) {
    parts.push_back("mass residual " + format_quantity(mass->last, "m"));
  }
  const auto energy = see_signal(recording, "melt.energy_residual_m");
  const auto stored = see_signal(recording, "melt.energy_stored_m");
  if (energy && stored && stored->range > 0) {
    parts.push_back(fmt::format("energy residual {:.3g} % of the range of the stored energy",
                                100 * std::abs(energy->last) / stored->range));
  }
  const auto barrel = see_signal(recording, "barrel.energy_residual_J");
  const auto heated = see_signal(recording, "barrel.heated_J");
  if (barrel && heated && heated->last > 0) {
    parts.push_back(fmt::format("barrel {:.3g} % of the heat put in", 100 * std::abs(barrel->last) / heated->last));
  }
  return fmt::format("{}", fmt::join(parts, "; "));
}

std::string describe_participants(const record::Recording& recording) {
  return fmt::format("{}", fmt::join(recording.info.participants, ", "));
}

const char* to_text(Severity severity) {
  return severity == Severity::kFault ? "fault" : severity == Severity::kWarning ? "warning" : "info";
}

std::string format_id(const record::IdStatistics& id) {
  return fmt::format("{:0{}X}", id.id, id.extended ? 8 : 3);
}

std::string percent(std::optional<double> share) {
  return share ? fmt::format("{:.3f} %", 100 * *share) : "–";
}

std::string render_responses(const record::BusTiming& timing, std::span<const record::NodeName> nodes) {
  std::string html =
      "<h3>Response on the bus, from queued to the end of the frame</h3>\n<p class=\"muted\">Bound: worst case by "
      "analysis of the rig, in operation and without errors (Davis, Burns, Bril, Lukkien 2007).</p>\n"
      "<div class=\"scroll\"><table><thead><tr><th>COB-ID</th><th>what</th><th>node</th><th "
      "class=\"number\">frames</th>"
      "<th class=\"number\">mean wait [ms]</th><th class=\"number\">worst wait [ms]</th>"
      "<th class=\"number\">worst response [ms]</th><th class=\"number\">bound [ms]</th></tr></thead><tbody>\n";
  for (const record::ResponseTiming& r : timing.responses) {
    html += fmt::format(
        "<tr><td><code>{:0{}X}</code></td><td>{}</td><td>{}</td><td class=\"number\">{}</td><td class=\"number\">{:.3f}"
        "</td><td class=\"number\">{:.3f}</td><td class=\"number\">{:.3f}</td><td class=\"number\">{}</td></tr>\n",
        r.id, r.extended ? 8 : 3, r.extended ? std::string{} : escape_markup(record::name_cob_id(r.id, nodes)),
        escape_markup(r.node), r.frames, 1e3 * r.mean_delay_s, 1e3 * r.worst_delay_s, 1e3 * r.worst_response_s,
        r.bound_s ? fmt::format("{:.3f}", 1e3 * *r.bound_s) : "–");
  }
  return html + "</tbody></table></div>\n";
}

std::string render_nodes(const record::BusTiming& timing) {
  std::string html =
      "<h3>Nodes</h3>\n<div class=\"scroll\"><table><thead><tr><th>node</th><th>at the end</th>"
      "<th class=\"number\">TEC</th><th class=\"number\">REC</th><th class=\"number\">sent</th>"
      "<th class=\"number\">received</th><th class=\"number\">dropped</th><th class=\"number\">arbit-lost</th>"
      "<th class=\"number\">bus-errors</th><th class=\"number\">error-warn</th><th class=\"number\">error-pass</th>"
      "<th class=\"number\">bus-off</th><th class=\"number\">re-started</th></tr></thead><tbody>\n";
  for (const record::NodeTiming& n : timing.nodes) {
    html += fmt::format("<tr><td>{}</td><td>{}</td>", escape_markup(n.name), n.state);
    for (const std::uint64_t count : {n.tec, n.rec, n.tx_packets, n.rx_packets, n.tx_dropped, n.arbit_lost,
                                      n.bus_errors, n.error_warn, n.error_pass, n.bus_off, n.re_started}) {
      html += fmt::format("<td class=\"number\">{}</td>", count);
    }
    html += "</tr>\n";
  }
  return html + "</tbody></table></div>\n";
}

std::string render_timing_of_bus(const record::Recording& recording) {
  if (!recording.bus_timing) return {};
  return fmt::format("<p>The wire was busy for {} of the run.</p>\n", percent(recording.bus_timing->load)) +
         render_responses(*recording.bus_timing, recording.info.nodes) + render_nodes(*recording.bus_timing);
}

/// Identifiers that are sent again and again by themselves: not the questions and answers of SDO.
std::vector<record::IdStatistics> find_periodic_ids(std::span<const Run> runs) {
  constexpr std::uint64_t kEnough = 20;
  std::vector<record::IdStatistics> ids;
  for (const Run& run : runs) {
    for (record::IdStatistics& id : record::calc_bus_statistics(*run.recording).ids) {
      const bool known = std::any_of(ids.begin(), ids.end(), [&](const record::IdStatistics& other) {
        return other.id == id.id && other.extended == id.extended;
      });
      if (known || id.frames < kEnough || id.name.starts_with("SDO")) continue;
      ids.push_back(std::move(id));
    }
  }
  std::sort(ids.begin(), ids.end(), [](const auto& a, const auto& b) {
    return std::pair{a.extended, a.id} < std::pair{b.extended, b.id};
  });
  return ids;
}

std::string render_timing(const record::IdStatistics& id, std::span<const Run> runs) {
  std::vector<std::vector<double>> periods_s;
  std::size_t count = 0;
  double sum_s = 0;
  for (const Run& run : runs) {
    periods_s.push_back(record::calc_periods_s(run.recording->frames, id.id, id.extended));
    count += periods_s.back().size();
    for (const double period_s : periods_s.back()) sum_s += period_s;
  }
  const Histogram histogram = calc_histogram(periods_s);
  return fmt::format(
      "<figure><figcaption><b>{}</b><small><code>{}</code> {} periods, mean {:.3f} ms</small></figcaption>{}"
      "<div class=\"ends\"><span>{:.3f} ms</span><span>{:.3f} ms</span></div></figure>\n",
      escape_markup(id.name.empty() ? "COB-ID " + format_id(id) : id.name), format_id(id), count,
      1e3 * sum_s / static_cast<double>(count), render_histogram(histogram), 1e3 * histogram.from_s,
      1e3 * histogram.to_s);
}

std::string count_of(std::size_t n, const char* noun) {
  return fmt::format("{} {}{}", n, noun, n == 1 ? "" : "s");
}

}  // namespace

std::vector<std::string> name_runs(std::span<const Run> runs) {
  const std::string& scenario = runs[0].recording->info.scenario;
  const bool one_scenario = std::all_of(runs.begin(), runs.end(), [&](const Run& run) {
    return run.recording->info.scenario == scenario && !run.recording->info.variant.empty();
  });
  std::vector<std::string> names;
  for (const Run& run : runs) {
    names.push_back(one_scenario && runs.size() > 1 ? run.recording->info.variant : run.recording->info.label());
  }
  return names;
}

std::string make_title(std::span<const Run> runs) {
  const auto title_of = [](const Run& run) {
    const record::RunInfo& info = run.recording->info;
    return info.title.empty() ? info.label() : info.title;
  };
  std::string title = title_of(runs[0]);
  bool shortened = false;
  for (const Run& run : runs) {
    const std::string other = title_of(run);
    if (other == title) continue;
    const auto [end, unused] = std::mismatch(title.begin(), title.end(), other.begin(), other.end());
    title.erase(end, title.end());
    shortened = true;
  }
  if (!shortened) return title;
  // Only a whole part of a title is one: "Step: f" of "Step: fast" and "Step: free" is "Step".
  const std::size_t colon = title.rfind(": ");
  return colon == std::string::npos || colon == 0 ? count_of(runs.size(), "run") : title.substr(0, colon);
}

std::string format_quantity(double value, const std::string& unit) {
  constexpr std::array kPrefixed{"m", "s", "Pa", "V", "A", "W", "J", "N", "Hz"};
  const bool takes_prefix = std::find(kPrefixed.begin(), kPrefixed.end(), unit) != kPrefixed.end();
  if (!takes_prefix || value == 0) return fmt::format("{:.4g}{}{}", value, unit.empty() ? "" : " ", unit);
  const double size = std::abs(value);
  const std::pair<double, const char*> steps[] = {{1e6, "M"}, {1e3, "k"}, {1, ""}, {1e-3, "m"}, {1e-6, "µ"}};
  for (const auto& [factor, prefix] : steps) {
    // Nobody says kilosecond, and kilometre will not be needed.
    if (factor > 1 && unit != "Pa" && unit != "W" && unit != "Hz" && unit != "J" && unit != "N") continue;
    if (size >= factor * 0.99995) return fmt::format("{:.4g} {}{}", value / factor, prefix, unit);
  }
  return fmt::format("{:.4g} {}", value, unit);
}

std::string render_title(std::span<const Run> runs) {
  std::size_t failed = 0;
  std::size_t total = 0;
  std::size_t skipped = 0;
  for (const Run& run : runs) {
    failed += run.results->failed_count();
    total += run.results->checks.size();
    for (const check::CheckResult& check : run.results->checks) skipped += check.skipped.empty() ? 0 : 1;
  }
  total -= skipped;
  std::string verdict = failed == 0 ? (total == 1 ? "The check held" : fmt::format("All {} checks held", total))
                                    : fmt::format("{} of {} failed", failed, count_of(total, "check"));
  std::string detail = count_of(runs.size(), "run");
  if (skipped > 0) detail += fmt::format(", {} skipped", count_of(skipped, "check"));
  return fmt::format("<h1>{}</h1>\n<div class=\"banner {}\"><b>{}</b> <span>in {}</span></div>\n{}",
                     escape_markup(make_title(runs)), failed == 0 ? "held" : "failed", verdict, detail,
                     render_texts(runs));
}

std::string render_checks(std::span<const Run> runs) {
  const std::vector<std::string> names = name_runs(runs);
  const std::string page_title = make_title(runs);
  std::string html =
      "<h2>Verdict</h2>\n<p class=\"muted\">The margin is how far a check was from failing, and the time is "
      "when it was nearest to it. Click a time to look at it in the plots.</p>\n";
  for (std::size_t i = 0; i < runs.size(); ++i) {
    if (runs.size() > 1) html += heading(i, names[i], runs[i].recording->info.title, page_title);
    html +=
        "<table class=\"checks\"><thead><tr><th>verdict</th><th>check</th><th class=\"number\">margin</th>"
        "<th class=\"number\">at</th><th>seen</th></tr></thead><tbody>\n";
    for (const check::CheckResult& check : runs[i].results->checks) html += render_check(check);
    html += "</tbody></table>\n";
    const std::vector<std::string>& findings = runs[i].results->health.findings;
    if (findings.size() > 3) {
      html += fmt::format("<details><summary>all {} health findings</summary><ul>\n", findings.size());
      for (const std::string& finding : findings) html += fmt::format("<li>{}</li>\n", escape_markup(finding));
      html += "</ul></details>\n";
    }
  }
  return html;
}

std::string render_what_was_run(std::span<const Run> runs) {
  using record::Recording;
  std::string html = "<h2>What was run</h2>\n<div class=\"scroll\"><table class=\"facts\">\n";
  if (runs.size() > 1) {
    html += "<thead><tr><th></th>";
    const std::vector<std::string> names = name_runs(runs);
    for (std::size_t i = 0; i < runs.size(); ++i) {
      html += fmt::format("<th><span class=\"swatch run{}\"></span>{}</th>", i % 8, escape_markup(names[i]));
    }
    html += "</tr></thead>\n";
  }
  html += "<tbody>\n";
  html += fact_of("scenario", runs, [](const Recording& r) { return r.info.label(); });
  html += fact_of("title", runs, [](const Recording& r) { return r.info.title; });
  html += fact_of("seed", runs, [](const Recording& r) { return fmt::format("{}", r.info.seed); });
  html += fact_of("end", runs, describe_end);
  html += fact_of("pace", runs, [](const Recording& r) { return r.info.pace; });
  html += fact_of("speed", runs, describe_speed);
  html += fact_of("repeatable", runs, describe_repeatability);
  html += fact_of("balances", runs, describe_balances);
  html += fact_of("participants", runs, describe_participants);
  html += fact_of("version", runs, [](const Recording& r) { return r.info.version; });
  html += "</tbody></table></div>\n";
  std::vector<std::string> commands;
  for (const Run& run : runs) {
    const std::string command =
        has_live_faults(*run.recording) ? "meltbench run repro.toml" : run.recording->info.repeat_command;
    if (!command.empty() && std::find(commands.begin(), commands.end(), command) == commands.end()) {
      commands.push_back(command);
    }
    for (const std::string& note : run.recording->notes) html += fmt::format("<p>Note: {}</p>\n", escape_markup(note));
  }
  if (!commands.empty()) {
    html += fmt::format("<p class=\"muted\">To run it again:</p><pre>{}</pre>\n",
                        escape_markup(fmt::format("{}", fmt::join(commands, "\n"))));
  }
  return html;
}

std::string render_events(std::span<const Run> runs) {
  const std::vector<std::string> names = name_runs(runs);
  std::string html = "<h2>Events</h2>\n";
  for (std::size_t i = 0; i < runs.size(); ++i) {
    std::vector<record::RecordedEvent> events = runs[i].recording->events;
    std::stable_sort(events.begin(), events.end(),
                     [](const auto& a, const auto& b) { return a.event.at < b.event.at; });
    html +=
        fmt::format("<details{}><summary><span class=\"swatch run{}\"></span>{}: {}</summary>\n",
                    runs.size() == 1 ? " open" : "", i % 8, escape_markup(names[i]), count_of(events.size(), "event"));
    html +=
        "<div class=\"scroll\"><table><thead><tr><th class=\"number\">at</th><th>source</th><th>severity</th><th>code"
        "</th><th>text</th></tr></thead><tbody>\n";
    const std::size_t shown = std::min(events.size(), kMaxEventsShown);
    for (std::size_t e = 0; e < shown; ++e) {
      const Event& event = events[e].event;
      html += fmt::format(
          "<tr><td class=\"number\">{}</td><td>{}</td><td class=\"severity-{}\">{}</td><td><code>{}</code></td>"
          "<td class=\"text\">{}</td></tr>\n",
          at_button(to_s(event.at)), escape_markup(events[e].source), to_text(event.severity), to_text(event.severity),
          escape_markup(event.code), escape_markup(event.text));
    }
    html += "</tbody></table></div>\n";
    if (shown < events.size()) {
      html += fmt::format("<p class=\"muted\">and {} more in events.jsonl</p>\n", events.size() - shown);
    }
    html += "</details>\n";
  }
  return html;
}

std::string render_frame_timing(std::span<const Run> runs) {
  const std::vector<record::IdStatistics> ids = find_periodic_ids(runs);
  if (ids.empty()) return {};
  std::string html =
      "<h2>Frame timing</h2>\n<p class=\"muted\">Time between consecutive frames of one identifier. Heights are "
      "logarithmic, so that a single late frame can be seen.</p>\n<div class=\"histograms\">\n";
  for (const record::IdStatistics& id : ids) html += render_timing(id, runs);
  return html + "</div>\n";
}

std::string render_bus_table(const record::BusStatistics& bus) {
  std::string html =
      "<div class=\"scroll\"><table><thead><tr><th>COB-ID</th><th>what</th><th class=\"number\">frames</th>"
      "<th class=\"number\">bytes</th><th class=\"number\">mean [ms]</th><th class=\"number\">min [ms]</th>"
      "<th class=\"number\">max [ms]</th><th class=\"number\">load</th></tr></thead><tbody>\n";
  for (const record::IdStatistics& id : bus.ids) {
    const auto period = [&](double period_s) { return id.frames > 1 ? fmt::format("{:.3f}", 1e3 * period_s) : "–"; };
    html += fmt::format(
        "<tr><td><code>{}</code></td><td>{}</td><td class=\"number\">{}</td><td class=\"number\">{}</td>"
        "<td class=\"number\">{}</td><td class=\"number\">{}</td><td class=\"number\">{}</td><td "
        "class=\"number\">{}</td></tr>\n",
        format_id(id), escape_markup(id.name), id.frames, id.data_bytes, period(id.mean_period_s),
        period(id.min_period_s), period(id.max_period_s), percent(id.load));
  }
  return html + "</tbody></table></div>\n";
}

std::string render_bus(std::span<const Run> runs) {
  const std::vector<std::string> names = name_runs(runs);
  std::string html = "<h2>Bus</h2>\n";
  for (std::size_t i = 0; i < runs.size(); ++i) {
    const record::BusStatistics bus = record::calc_bus_statistics(*runs[i].recording);
    html += fmt::format(
        "<details{}><summary><span class=\"swatch run{}\"></span>{}: {} frames, load {} without stuff bits, {}, {}"
        "</summary>\n{}</details>\n",
        i == 0 ? " open" : "", i % 8, escape_markup(names[i]), bus.frames, percent(bus.load),
        count_of(bus.error_frames, "error frame"), count_of(bus.lost_frames, "lost frame"),
        render_bus_table(bus) + render_timing_of_bus(*runs[i].recording));
  }
  return html;
}

}  // namespace meltbench::report
