#include "bench/report/replay_page.hpp"

#include <fmt/format.h>

#include <utility>

#include "bench/report/escape.hpp"
#include "bench/report/page_shell.hpp"

namespace meltbench::report {
namespace {

std::string render_banner(const ReplayPage& page) {
  const std::string verdict = page.count == 0   ? "Answered as recorded"
                              : page.count == 1 ? "1 answer differs"
                                                : fmt::format("{} answers differ", page.count);
  return fmt::format("<div class=\"banner {}\"><b>{}</b> <span>{}</span></div>\n", page.count == 0 ? "held" : "failed",
                     verdict, escape_markup(page.summary));
}

std::string render_differences(const ReplayPage& page) {
  if (page.differences.empty()) return {};
  const ReplayDifference& first = page.differences.front();
  std::string html =
      fmt::format("<h2>First difference</h2>\n<p>{} <b>{}</b>: {} <small>({})</small></p>\n", at_button(first.at_s),
                  escape_markup(first.kind), escape_markup(first.text), escape_markup(first.place));
  if (page.differences.size() == 1) return html;
  html += fmt::format(
      "<details><summary>The first {} of {}</summary><div class=\"scroll\"><table><thead><tr><th "
      "class=\"number\">at</th><th>what</th><th>in words</th><th>log</th></tr></thead><tbody>\n",
      page.differences.size(), page.count);
  for (const ReplayDifference& one : page.differences) {
    html +=
        fmt::format("<tr><td class=\"number\">{}</td><td>{}</td><td class=\"text\">{}</td><td>{}</td></tr>\n",
                    at_button(one.at_s), escape_markup(one.kind), escape_markup(one.text), escape_markup(one.place));
  }
  return html + "</tbody></table></div></details>\n";
}

std::string render_fit(const ReplayFit& fit) {
  const std::string where =
      fit.differing == 0 ? "" : fmt::format("{} <small>line {}</small>", at_button(fit.at_s), fit.line);
  return fmt::format(
      "<tr><td>{}</td><td>{}</td><td class=\"text\">{}</td><td>{}</td><td class=\"number\">{}</td><td "
      "class=\"number\">{}</td><td class=\"number\">{:.4g}</td><td class=\"number\">{:.4g}</td><td "
      "class=\"number\">{}</td></tr>\n",
      escape_markup(fit.board), escape_markup(fit.object), escape_markup(fit.name), escape_markup(fit.unit),
      fit.compared, fit.differing, fit.largest, fit.rms, where);
}

std::string render_fits(const ReplayPage& page) {
  std::string html =
      "<h2>Fit of each signal</h2>\n<p class=\"muted\">Replayed against recorded values in PDOs, in the unit and with "
      "the decimals that the board's EDS file says; differing by whatever little, within a tolerance or not.</p>\n";
  if (page.fits.empty()) return html + "<p class=\"muted\">No value was compared.</p>\n";
  html +=
      "<div class=\"scroll\"><table><thead><tr><th>board</th><th>object</th><th>signal</th><th>unit</th><th "
      "class=\"number\">compared</th><th class=\"number\">differ</th><th class=\"number\">largest</th><th "
      "class=\"number\">rms</th><th class=\"number\">largest at</th></tr></thead><tbody>\n";
  for (const ReplayFit& fit : page.fits) html += render_fit(fit);
  return html + "</tbody></table></div>\n";
}

std::string render_plots(const ReplayPage& page) {
  std::string buttons;
  for (const auto& [run, name] : {std::pair{0, "recorded"}, std::pair{1, "replayed"}}) {
    buttons += fmt::format(
        "<button class=\"toggle\" data-run=\"{0}\" aria-pressed=\"true\" title=\"show or hide\"><span class=\"swatch "
        "run{0}\"></span>{1}</button>",
        run, name);
  }
  std::string notes =
      "<p class=\"muted\">Signals that differ. Time in seconds since the controller's first frame; the smallest and "
      "the "
      "largest value per stretch of time.</p>\n";
  if (page.plots.plots.empty()) notes = "<p class=\"muted\">No signal differs: there is nothing to plot.</p>\n";
  if (page.signals_left_out > 0) {
    notes += fmt::format("<p class=\"muted\">{} further signals have no plot.</p>\n", page.signals_left_out);
  }
  return render_plots_section(buttons, false, notes);
}

}  // namespace

std::string render_replay_page(ReplayPage replay) {
  Page page;
  page.title = replay.title;
  page.footer = replay.version;
  page.runs = {"recorded", "replayed"};
  if (!replay.differences.empty()) {
    const ReplayDifference& first = replay.differences.front();
    page.marks.push_back({first.at_s, 0, "fault", fmt::format("first difference, {}: {}", first.kind, first.text)});
  }
  page.body = fmt::format("<h1>{}</h1>\n", escape_markup(replay.title)) + render_banner(replay) +
              render_differences(replay) + render_fits(replay) + render_plots(replay);
  page.plots = std::move(replay.plots);
  return render_page(page);
}

}  // namespace meltbench::report
