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
                     cell.held ? "held" : "FAILED");
}

}  // namespace

void write_matrix(const std::filesystem::path& page, std::string_view title, std::span<const MatrixCell> cells) {
  const std::vector<std::string> columns = collect(cells, &MatrixCell::column);
  const auto held = std::count_if(cells.begin(), cells.end(), [](const MatrixCell& cell) { return cell.held; });
  std::string html = fmt::format(
      "<!DOCTYPE html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"><title>{0}</title><style>{1}\n"
      "td a {{ text-decoration: none; }}</style></head><body><h1>{0}</h1>"
      "<p class=\"banner {2}\"><b>{3} of {4} runs held</b></p><div class=\"scroll\"><table><tr><th></th>",
      escape_markup(title), kPageStyle, static_cast<std::size_t>(held) == cells.size() ? "held" : "failed", held,
      cells.size());
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
