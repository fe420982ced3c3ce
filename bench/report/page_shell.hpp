#pragma once
/// What all pages have in common: one file that needs no network, with plots that zoom together.

#include <string>
#include <string_view>
#include <vector>

#include "bench/report/plots.hpp"

namespace meltbench::report {

/// A point on the time axis of a page's plots.
struct PlotMark {
  double t_s = 0;
  std::size_t run = 0;
  std::string_view kind;  ///< "fault", "failed", "warning" or "info".
  std::string text;
};

struct Page {
  std::string title;
  std::string body;               ///< HTML, with what render_plots_section() gives somewhere in it.
  std::string footer;             ///< Text, e.g. the version.
  std::vector<std::string> runs;  ///< Names; one for a page about one thing.
  std::vector<PlotMark> marks;
  Plots plots;
  std::string profiles_json = "[]";       ///< write_profiles_json().
  std::vector<std::string_view> scripts;  ///< After the page's own.
};

/// The page as text: dygraphs is copied in from MELTBENCH_DYGRAPHS_DIR (set when building, Debian's
/// /usr/share/javascript/dygraphs by default).
/// @throws ReportError if dygraphs cannot be read.
[[nodiscard]] std::string render_page(const Page& page);

/// Heading, bar and place of the plots. @param run_buttons  HTML; empty for one run.
/// @param notes  HTML behind the plots.
[[nodiscard]] std::string render_plots_section(std::string_view run_buttons, bool has_profiles, std::string_view notes);

/// A time that zooms the plots when clicked.
[[nodiscard]] std::string at_button(double at_s);

}  // namespace meltbench::report
