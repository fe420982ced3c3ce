#include "bench/report/report.hpp"

#include <fmt/format.h>

#include <string_view>

#include "bench/report/escape.hpp"
#include "bench/report/page_assets.hpp"
#include "bench/report/page_shell.hpp"
#include "bench/report/profiles.hpp"
#include "bench/report/response.hpp"
#include "bench/report/sections.hpp"
#include "bench/report/whole_file.hpp"

namespace meltbench::report {
namespace {

constexpr std::size_t kMaxMarks = 500;  ///< Per run; more would be a wall of colour.

/// Events and failed checks on the time axis.
std::vector<PlotMark> collect_marks(std::span<const Run> runs) {
  std::vector<PlotMark> marks;
  for (std::size_t run = 0; run < runs.size(); ++run) {
    std::size_t count = 0;
    for (const record::RecordedEvent& e : runs[run].recording->events) {
      if (++count > kMaxMarks) break;
      const char* kind = e.event.severity == Severity::kFault     ? "fault"
                         : e.event.severity == Severity::kWarning ? "warning"
                                                                  : "info";
      marks.push_back({to_s(e.event.at), run, kind, fmt::format("{} {}: {}", e.source, e.event.code, e.event.text)});
    }
    for (const check::CheckResult& check : runs[run].results->checks) {
      if (!check.held && check.at_s)
        marks.push_back({*check.at_s, run, "failed", "check \"" + check.name + "\" failed"});
    }
  }
  return marks;
}

std::string render_plots(std::span<const Run> runs, const Plots& plots, bool has_profiles) {
  std::string buttons;
  const std::vector<std::string> names = name_runs(runs);
  for (std::size_t i = 0; runs.size() > 1 && i < names.size(); ++i) {
    buttons += fmt::format(
        "<button class=\"toggle\" data-run=\"{}\" aria-pressed=\"true\" title=\"show or hide this run\"><span "
        "class=\"swatch run{}\"></span>{}</button>",
        i, i % 8, escape_markup(names[i]));
  }
  std::string notes = "<p class=\"muted\">Time in seconds since the start of the run.";
  if (plots.thinned) {
    notes += " Long runs are thinned to the smallest and largest value per stretch of time; signals.csv has every row.";
  }
  notes += "</p>\n";
  if (!plots.still.empty()) {
    notes += fmt::format("<p class=\"muted\">Did not move in any run: {}.</p>\n",
                         escape_markup(fmt::format("{}", fmt::join(plots.still, ", "))));
  }
  return render_plots_section(buttons, has_profiles, notes);
}

}  // namespace

std::string render_report(std::span<const Run> runs) {
  Page page;
  page.plots = make_plots(runs);
  const std::vector<Profile> profiles = make_profiles(runs);
  const record::RunInfo& info = runs[0].recording->info;
  page.title = make_title(runs);
  page.footer = info.version.empty() ? "meltbench" : info.version;
  page.runs = name_runs(runs);
  page.marks = collect_marks(runs);
  page.profiles_json = write_profiles_json(profiles);
  if (!profiles.empty()) page.scripts.push_back(kProfileScript);
  page.body = render_title(runs) + render_checks(runs) + render_plots(runs, page.plots, !profiles.empty()) +
              render_what_was_run(runs) + render_events(runs) + render_responses(runs) + render_frame_timing(runs) +
              render_bus(runs);
  return render_page(page);
}

void write_report(const std::filesystem::path& path, std::span<const Run> runs) {
  write_whole_file(path, render_report(runs));
}

}  // namespace meltbench::report
