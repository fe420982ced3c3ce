#include "bench/report/log_page.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <functional>
#include <map>

#include "bench/report/escape.hpp"
#include "bench/report/page_assets.hpp"
#include "bench/report/page_shell.hpp"
#include "bench/report/sections.hpp"

namespace meltbench::report {
namespace {

constexpr std::size_t kMaxMarks = 500;  ///< More would be a wall of colour.
constexpr std::size_t kMaxIdentifiers = 200;
constexpr std::size_t kMaxChoices = 60;  ///< Of a filter; what it does not have is shown.

const char* name_of(Weight weight) {
  return weight == Weight::kFault ? "fault" : weight == Weight::kWarning ? "warning" : "info";
}

/// Leaves the `most` heaviest, the first of equal weight, in their order. @returns how many went.
std::size_t keep_heaviest(std::vector<StoryLine>& lines, std::size_t most) {
  if (lines.size() <= most) return 0;
  const std::size_t gone = lines.size() - most;
  std::size_t room = most;
  std::array<std::size_t, 3> wanted{};
  for (const StoryLine& line : lines) ++wanted[static_cast<std::size_t>(line.weight)];
  for (const Weight weight : {Weight::kFault, Weight::kWarning, Weight::kInfo}) {
    std::size_t& count = wanted[static_cast<std::size_t>(weight)];
    count = std::min(count, room);
    room -= count;
  }
  std::erase_if(lines, [&](const StoryLine& line) {
    std::size_t& left = wanted[static_cast<std::size_t>(line.weight)];
    if (left == 0) return true;
    --left;
    return false;
  });
  return gone;
}

std::string render_facts(const LogPage& page) {
  std::string html = "<div class=\"scroll\"><table class=\"facts\"><tbody>\n";
  for (const auto& [name, value] : page.facts) {
    html += fmt::format("<tr><th>{}</th><td>{}</td></tr>\n", escape_markup(name), escape_markup(value));
  }
  return html + "</tbody></table></div>\n";
}

/// What stands out, before everything else.
std::string render_banner(const LogPage& page) {
  std::map<std::string, std::size_t> counts;
  for (const StoryLine& line : page.lines) {
    if (line.weight != Weight::kInfo) ++counts[line.kind];
  }
  if (counts.empty()) return "<div class=\"banner held\"><b>Nothing stands out</b></div>\n";
  std::vector<std::string> parts;
  for (const auto& [kind, count] : counts) parts.push_back(fmt::format("{} × {}", count, kind));
  const bool has_fault = std::ranges::find(page.lines, Weight::kFault, &StoryLine::weight) != page.lines.end();
  return fmt::format("<div class=\"banner {}\"><b>{}</b></div>\n", has_fault ? "failed" : "odd",
                     escape_markup(fmt::format("{}", fmt::join(parts, ", "))));
}

/// A button for each value that some line has, with how many have it.
std::string render_filter(const LogPage& page, const char* title, const char* key,
                          const std::function<std::string(const StoryLine&)>& value_of) {
  std::map<std::string, std::size_t> counts;
  for (const StoryLine& line : page.lines) ++counts[value_of(line)];
  if (counts.size() < 2) return {};  // Nothing to choose.
  std::string html = fmt::format("<div class=\"filter\" data-of=\"{}\"><b>{}</b>", key, title);
  std::size_t choices = 0;
  for (const auto& [value, count] : counts) {
    if (++choices > kMaxChoices) break;
    html +=
        fmt::format("<button class=\"toggle\" data-value=\"{0}\" aria-pressed=\"true\">{1} <small>{2}</small></button>",
                    escape_markup(value), value.empty() ? "bus" : escape_markup(value), count);
  }
  return html + "<button class=\"reset\">all</button></div>\n";
}

std::string render_line(const StoryLine& line) {
  std::string text = escape_markup(line.text);
  if (!line.details.empty()) {
    std::string details;
    for (const std::string& detail : line.details) details += escape_markup(detail) + "\n";
    text = fmt::format("<details><summary>{}</summary><pre>{}</pre></details>", text, details);
  }
  return fmt::format(
      "<tr data-kind=\"{0}\" data-node=\"{1}\" data-weight=\"{3}\"><td class=\"number\">{2}</td><td>{1}</td><td "
      "class=\"severity-{3}\">{0}"
      "</td><td class=\"text\">{4}</td></tr>\n",
      escape_markup(line.kind), escape_markup(line.node), at_button(line.at_s), name_of(line.weight), text);
}

std::string render_story(const LogPage& page) {
  std::string html = "<h2>Story</h2>\n";
  if (page.lines.empty()) return html + "<p class=\"muted\">Nothing that there would be words for.</p>\n";
  html += render_filter(page, "Who", "node", &StoryLine::node) + render_filter(page, "What", "kind", &StoryLine::kind) +
          render_filter(page, "Weight", "weight", [](const StoryLine& line) { return name_of(line.weight); });
  html +=
      "<p class=\"search\"><input id=\"story-search\" type=\"search\" placeholder=\"words\" aria-label=\"words that a "
      "line must have\"> <small id=\"story-count\"></small> <small>Click a time to see it in the plots.</small></p>\n"
      "<div class=\"story\"><table id=\"story\"><thead><tr><th class=\"number\">at</th><th>who</th><th>what</th>"
      "<th>in words</th></tr></thead><tbody>\n";
  for (const StoryLine& line : page.lines) html += render_line(line);
  html += "</tbody></table></div>\n";
  if (page.left_out > 0) {
    html += fmt::format("<p class=\"muted\">And {} more, of less weight or later.</p>\n", page.left_out);
  }
  return html;
}

std::string render_notes(const LogPage& page) {
  std::string html =
      "<p class=\"muted\">Time in seconds since the beginning of the log. Numbers as they are on the wire, in the unit "
      "and with the decimals that the board's EDS file says; the smallest and the largest per stretch of time.</p>\n";
  if (!page.plots.still.empty()) {
    html += fmt::format("<p class=\"muted\">Did not move: {}.</p>\n",
                        escape_markup(fmt::format("{}", fmt::join(page.plots.still, ", "))));
  }
  if (page.signals_left_out > 0) {
    html += fmt::format("<p class=\"muted\">{} further objects have no plot.</p>\n", page.signals_left_out);
  }
  return html;
}

std::string render_identifiers(record::BusStatistics& bus) {
  std::string html = fmt::format("<h2>Bus</h2>\n<details open><summary>{} identifiers, {} frames</summary>\n",
                                 bus.ids.size(), bus.frames);
  const std::size_t all = bus.ids.size();
  if (all > kMaxIdentifiers) bus.ids.resize(kMaxIdentifiers);
  html += render_bus_table(bus);
  if (all > kMaxIdentifiers) html += fmt::format("<p class=\"muted\">and {} more</p>\n", all - kMaxIdentifiers);
  return html + "</details>\n";
}

std::vector<PlotMark> collect_marks(std::vector<StoryLine> lines) {
  keep_heaviest(lines, kMaxMarks);
  std::vector<PlotMark> marks;
  for (const StoryLine& line : lines) marks.push_back({line.at_s, 0, name_of(line.weight), line.text});
  return marks;
}

}  // namespace

std::string render_log_page(LogPage log) {
  const std::string banner = render_banner(log);
  log.left_out += keep_heaviest(log.lines, kMaxStoryLines);
  Page page;
  page.title = log.title;
  page.footer = log.version;
  page.runs = {"log"};
  page.marks = collect_marks(log.lines);
  page.body = fmt::format("<h1>{}</h1>\n", escape_markup(log.title)) + banner + render_facts(log) + render_story(log) +
              render_plots_section({}, false, render_notes(log)) + render_identifiers(log.bus);
  page.plots = std::move(log.plots);
  if (!log.lines.empty()) page.scripts.push_back(kStoryScript);
  return render_page(page);
}

}  // namespace meltbench::report
