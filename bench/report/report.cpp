#include "bench/report/report.hpp"

#include <fmt/format.h>

#include <fstream>
#include <iterator>
#include <nlohmann/json.hpp>
#include <string_view>

#include "bench/report/escape.hpp"
#include "bench/report/page_assets.hpp"
#include "bench/report/plots.hpp"
#include "bench/report/profiles.hpp"
#include "bench/report/response.hpp"
#include "bench/report/sections.hpp"
#include "bench/report/whole_file.hpp"

namespace meltbench::report {
namespace {

constexpr std::size_t kMaxMarks = 500;  ///< Per run; more would be a wall of colour.

/// A file of dygraphs, ready to stand inside the page.
std::string read_asset(std::string_view name) {
  const std::filesystem::path path = std::filesystem::path{MELTBENCH_DYGRAPHS_DIR} / name;
  std::ifstream file{path, std::ios::binary};
  std::string text{std::istreambuf_iterator<char>{file}, {}};
  if (!file || text.empty()) {
    throw ReportError(path.string() + ": cannot be read, and the report's plots need it",
                      "install Debian's libjs-dygraphs: apt-get install libjs-dygraphs");
  }
  // A source map is of no use without its file, and can be larger than the program. "//#" or "/*#" in front of it.
  if (const std::size_t map = text.rfind("# sourceMappingURL="); map != std::string::npos) text.resize(map - 2);
  // It would end the element that it stands in.
  for (std::size_t end = text.find("</script"); end != std::string::npos; end = text.find("</script", end + 3)) {
    text.replace(end, 2, "<\\/");
  }
  return text;
}

/// Events and failed checks on the time axis.
nlohmann::ordered_json collect_marks(std::span<const Run> runs) {
  using Json = nlohmann::ordered_json;
  Json marks = Json::array();
  for (std::size_t run = 0; run < runs.size(); ++run) {
    std::size_t count = 0;
    for (const record::RecordedEvent& e : runs[run].recording->events) {
      if (++count > kMaxMarks) break;
      const char* kind = e.event.severity == Severity::kFault     ? "fault"
                         : e.event.severity == Severity::kWarning ? "warning"
                                                                  : "info";
      marks.push_back(Json{{"t", to_s(e.event.at)},
                           {"run", run},
                           {"kind", kind},
                           {"text", fmt::format("{} {}: {}", e.source, e.event.code, e.event.text)}});
    }
    for (const check::CheckResult& check : runs[run].results->checks) {
      if (check.held || !check.at_s) continue;
      marks.push_back(
          Json{{"t", *check.at_s}, {"run", run}, {"kind", "failed"}, {"text", "check \"" + check.name + "\" failed"}});
    }
  }
  return marks;
}

std::string make_page_data(std::span<const Run> runs, const Plots& plots, std::span<const Profile> profiles) {
  using Json = nlohmann::ordered_json;
  constexpr auto kReplace = Json::error_handler_t::replace;
  const Json names = name_runs(runs);
  // Put together as text: the times and values are by far the largest part and need no tree.
  const std::string data = write_plots_json(plots);
  return escape_script_json("{\"runs\":" + names.dump(-1, ' ', false, kReplace) +
                            ",\"marks\":" + collect_marks(runs).dump(-1, ' ', false, kReplace) +
                            ",\"profiles\":" + write_profiles_json(profiles) + "," + data.substr(1));
}

std::string render_plots(std::span<const Run> runs, const Plots& plots, bool has_profiles) {
  std::string html =
      "<h2 id=\"plots-title\">Signals</h2>\n<noscript><p>The plots need JavaScript; signals.csv has the numbers.</p>"
      "</noscript>\n<div class=\"bar\">";
  const std::vector<std::string> names = name_runs(runs);
  for (std::size_t i = 0; runs.size() > 1 && i < names.size(); ++i) {
    html += fmt::format(
        "<button class=\"toggle\" data-run=\"{}\" aria-pressed=\"true\" title=\"show or hide this run\"><span "
        "class=\"swatch run{}\"></span>{}</button>",
        i, i % 8, escape_markup(names[i]));
  }
  html +=
      "<span class=\"clock\" id=\"clock\"></span><span class=\"near\" id=\"near\">drag to zoom, shift and drag to "
      "move, "
      "double click to show all</span>"
      "<button class=\"reset\" id=\"reset\">show all</button></div>\n";
  if (has_profiles) html += "<div class=\"profiles\" id=\"profiles\"></div>\n";
  html += "<div class=\"plots\" id=\"plots\"></div>\n<p class=\"muted\">Time in seconds since the start of the run.";
  if (plots.thinned) {
    html += " Long runs are thinned to the smallest and largest value per stretch of time; signals.csv has every row.";
  }
  html += "</p>\n";
  if (!plots.still.empty()) {
    html += fmt::format("<p class=\"muted\">Did not move in any run: {}.</p>\n",
                        escape_markup(fmt::format("{}", fmt::join(plots.still, ", "))));
  }
  return html;
}

}  // namespace

std::string render_report(std::span<const Run> runs) {
  const Plots plots = make_plots(runs);
  const std::vector<Profile> profiles = make_profiles(runs);
  const record::RunInfo& info = runs[0].recording->info;
  std::string page = fmt::format(
      "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n"
      "<meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n<title>{}</title>\n<style>",
      escape_markup(make_title(runs)));
  page += read_asset("dist/dygraph.min.css");
  page += kPageStyle;
  page += "</style>\n</head>\n<body>\n";
  page += render_title(runs);
  page += render_checks(runs);
  page += render_plots(runs, plots, !profiles.empty());
  page += render_what_was_run(runs);
  page += render_events(runs);
  page += render_responses(runs);
  page += render_frame_timing(runs);
  page += render_bus(runs);
  page += fmt::format("<footer>{}. Plots by dygraphs (MIT license).</footer>\n",
                      escape_markup(info.version.empty() ? "meltbench" : info.version));
  page += "<script type=\"application/json\" id=\"data\">";
  page += make_page_data(runs, plots, profiles);
  page += "</script>\n<script>";
  page += read_asset("dist/dygraph.min.js");
  page += "</script>\n<script>";
  page += read_asset("extras/synchronizer.js");
  page += "</script>\n<script>";
  page += kPageScript;
  if (!profiles.empty()) page += kProfileScript;
  page += "</script>\n</body>\n</html>\n";
  return page;
}

void write_report(const std::filesystem::path& path, std::span<const Run> runs) {
  write_whole_file(path, render_report(runs));
}

}  // namespace meltbench::report
