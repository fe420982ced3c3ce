#include "bench/report/page_shell.hpp"

#include <fmt/format.h>

#include <fstream>
#include <iterator>
#include <nlohmann/json.hpp>

#include "bench/report/escape.hpp"
#include "bench/report/page_assets.hpp"

namespace meltbench::report {
namespace {

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

std::string make_page_data(const Page& page) {
  using Json = nlohmann::ordered_json;
  constexpr auto kReplace = Json::error_handler_t::replace;
  const Json names = page.runs;
  Json marks = Json::array();
  for (const PlotMark& mark : page.marks) {
    marks.push_back(Json{{"t", mark.t_s}, {"run", mark.run}, {"kind", mark.kind}, {"text", mark.text}});
  }
  // Put together as text: the times and values are by far the largest part and need no tree.
  const std::string data = write_plots_json(page.plots);
  return escape_script_json("{\"runs\":" + names.dump(-1, ' ', false, kReplace) +
                            ",\"marks\":" + marks.dump(-1, ' ', false, kReplace) +
                            ",\"profiles\":" + page.profiles_json + "," + data.substr(1));
}

}  // namespace

std::string render_page(const Page& page) {
  std::string html = fmt::format(
      "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n"
      "<meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n<title>{}</title>\n<style>",
      escape_markup(page.title));
  html += read_asset("dist/dygraph.min.css");
  html += kPageStyle;
  html += "</style>\n</head>\n<body>\n";
  html += page.body;
  html += fmt::format("<footer>{}. Plots by dygraphs (MIT license).</footer>\n", escape_markup(page.footer));
  html += "<script type=\"application/json\" id=\"data\">";
  html += make_page_data(page);
  html += "</script>\n<script>";
  html += read_asset("dist/dygraph.min.js");
  html += "</script>\n<script>";
  html += read_asset("extras/synchronizer.js");
  html += "</script>\n<script>";
  html += kPageScript;
  for (const std::string_view script : page.scripts) html += script;
  html += "</script>\n</body>\n</html>\n";
  return html;
}

std::string render_plots_section(std::string_view run_buttons, bool has_profiles, std::string_view notes) {
  return fmt::format(
      "<h2 id=\"plots-title\">Signals</h2>\n<noscript><p>The plots need JavaScript.</p></noscript>\n"
      "<div class=\"bar\">{}<span class=\"clock\" id=\"clock\"></span><span class=\"near\" id=\"near\">drag to zoom, "
      "shift and drag to move, double click to show all</span>"
      "<button class=\"reset\" id=\"reset\">show all</button></div>\n{}<div class=\"plots\" id=\"plots\"></div>\n{}",
      run_buttons, has_profiles ? "<div class=\"profiles\" id=\"profiles\"></div>\n" : "", notes);
}

std::string at_button(double at_s) {
  return fmt::format("<button class=\"at\" data-t=\"{0:.9g}\">{0:.3f} s</button>", at_s);
}

}  // namespace meltbench::report
