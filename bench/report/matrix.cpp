#include "bench/report/matrix.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cerrno>
#include <fstream>
#include <system_error>
#include <vector>

#include "bench/report/escape.hpp"
#include "bench/report/page_assets.hpp"

namespace meltbench::report {
namespace {

// There are more kinds of faults than words fit beside each other: their names stand upright, the targets stay in
// sight.
constexpr std::string_view kMatrixStyle = R"css(
.matrix { width: auto; }
.matrix tr:first-child th { writing-mode: vertical-rl; transform: rotate(180deg); padding: 0 0 .3rem; border: 0; }
.matrix th:first-child { position: sticky; left: 0; background: var(--page); }
.matrix td { padding: .25rem .45rem; border-left: 1px solid var(--grid); text-align: center; }
.matrix tr:hover > * { background: var(--panel); }
.matrix a { text-decoration: none; }
)css";

std::vector<std::string> collect(std::span<const MatrixCell> cells, std::string MatrixCell::*key) {
  std::vector<std::string> found;
  for (const MatrixCell& cell : cells) {
    if (std::find(found.begin(), found.end(), cell.*key) == found.end()) found.push_back(cell.*key);
  }
  return found;
}

std::string write_cell(const MatrixCell& cell) {
  return fmt::format(R"(<a class="verdict {}" href="{}" title="{}: {}">{}</a> )", cell.held ? "held" : "failed",
                     escape_markup(cell.report.generic_string()), escape_markup(cell.name), escape_markup(cell.note),
                     cell.held ? "✓" : "FAILED");
}

}  // namespace

void write_matrix(const std::filesystem::path& page, std::string_view title, std::span<const MatrixCell> cells) {
  const std::vector<std::string> columns = collect(cells, &MatrixCell::column);
  const auto held = std::count_if(cells.begin(), cells.end(), [](const MatrixCell& cell) { return cell.held; });
  std::string html = fmt::format(
      "<!DOCTYPE html>\n<html lang=\"en\"><head><meta charset=\"utf-8\">"
      "<meta name=\"viewport\" content=\"width=device-width, initial-scale=1\"><title>{0}</title><style>{1}{2}</style>"
      "</head><body><h1>{0}</h1><div class=\"banner {3}\"><b>{4} of {5} runs held</b></div>"
      "<p class=\"muted\">A row for each target, a column for each kind of fault; each run leads to its report.</p>"
      "<div class=\"scroll\"><table class=\"matrix\"><tr><th></th>",
      escape_markup(title), kPageStyle, kMatrixStyle,
      static_cast<std::size_t>(held) == cells.size() ? "held" : "failed", held, cells.size());
  for (const std::string& column : columns) html += fmt::format("<th>{}</th>", escape_markup(column));
  html += "</tr>\n";
  for (const std::string& row : collect(cells, &MatrixCell::row)) {
    html += fmt::format("<tr><th>{}</th>", escape_markup(row));
    for (const std::string& column : columns) {
      html += "<td>";
      for (const MatrixCell& cell : cells) {
        if (cell.row == row && cell.column == column) html += write_cell(cell);
      }
      html += "</td>";
    }
    html += "</tr>\n";
  }
  html += "</table></div></body></html>\n";
  std::ofstream file{page};
  file << html;
  file.close();
  if (!file) throw std::system_error{errno, std::generic_category(), "cannot write " + page.string()};
}

}  // namespace meltbench::report
