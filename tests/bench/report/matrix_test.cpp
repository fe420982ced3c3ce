#include "bench/report/matrix.hpp"

#include <catch2/catch.hpp>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <vector>

using namespace meltbench;
using Catch::Contains;

TEST_CASE("The matrix of a suite has a row per target, a column per kind, and links each run", "[report]") {
  const std::filesystem::path page = std::filesystem::temp_directory_path() / "meltbench_matrix_test.html";
  const std::vector<report::MatrixCell> cells{
      {"board.feeder", "off", "boards.feeder_off", "4 checks held", "boards/feeder_off/report.html", true},
      {"board.heater", "hang", "boards.<heater>", "lets go: never", "boards/heater_hang/report.html", false}};
  report::write_matrix(page, "faults", cells);
  std::ifstream file{page};
  const std::string html{std::istreambuf_iterator<char>{file}, {}};
  std::filesystem::remove(page);
  CHECK_THAT(html, Contains("1 of 2 runs held"));
  CHECK_THAT(html, Contains("<th>board.feeder</th>") && Contains("<th>hang</th>"));
  CHECK_THAT(html, Contains("href=\"boards/feeder_off/report.html\"") && Contains("FAILED"));
  CHECK_THAT(html, Contains("boards.&lt;heater&gt;"));
}
