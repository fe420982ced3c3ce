#include "bench/report/replay_page.hpp"

#include <catch2/catch.hpp>

using namespace meltbench::report;
using Catch::Contains;

TEST_CASE("Replay page: the verdict, the first difference in words, the fits, and both lines of a plot", "[report]") {
  ReplayPage page;
  page.title = "night <1>";
  page.count = 2;
  page.differences = {{1.5, "changed", "feeder: 3 instead of <2>", "line 7"}, {2.5, "missing", "later", "line 9"}};
  page.fits = {{"feeder", "0x2000:0", "Set point", "kg/h", 300, 1, 0.25, 0.0125, 1.75, 8}};
  page.plots.times_s = {0, 1};
  page.plots.plots = {{"feeder: Set point", "kg/h", {{"0x2000:0", 0, {1, 2}}, {"0x2000:0", 1, {1, 3}}}, true}};
  page.signals_left_out = 4;
  const std::string html = render_replay_page(page);
  CHECK_THAT(html, Contains("<h1>night &lt;1&gt;</h1>") && Contains("2 answers differ") &&
                       Contains("3 instead of &lt;2&gt;") && Contains("data-t=\"1.5\">1.500 s</button>"));
  CHECK_THAT(html, Contains("first difference, changed: feeder"));  // The mark in the plots.
  CHECK_THAT(html, Contains("kg/h") && Contains(">300</td>") && Contains(">0.0125</td>") && Contains("line 8"));
  CHECK_THAT(html, Contains(R"("runs":["recorded","replayed"])") && Contains("4 further signals"));
}

TEST_CASE("Replay page: without a difference it says so, and that there is nothing to plot", "[report]") {
  const std::string html = render_replay_page({});
  CHECK_THAT(html, Contains("Answered as recorded") && Contains("No signal differs"));
  CHECK(html.find("First difference") == std::string::npos);
}
