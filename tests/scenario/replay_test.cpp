#include <catch2/catch.hpp>

#include "tests/scenario/bench_process.hpp"

using namespace meltbench::test;
using Catch::Contains;

TEST_CASE("Replay to the boards: the page shows what the text tells, with the fit of each signal", "[scenario]") {
  const TemporaryFolder folder;
  const std::string recordings = std::string{MELTBENCH_SOURCE_DIR} + "/fixtures/recordings/";
  const std::string page = (folder / "fit.html").string();
  // The recorded heater boots on its own, which ours has no reason to do.
  const BenchResult result = run_bench({"replay", recordings + "board_reboot.log.gz", "--scenario",
                                        recordings + "production.toml", "--to", "boards", "--html", page});
  INFO(result.output);
  CHECK(result.status == 1);
  CHECK_THAT(result.output, Contains("fit of each signal\n") && Contains("largest at") && Contains(page));
  const std::string html = read_file(page);
  for (const char* words : {"answers differ</b>", "<h2>First difference</h2>", "<h2>Fit of each signal</h2>",
                            "\"runs\":[\"recorded\",\"replayed\"]", "first difference, "}) {
    CAPTURE(words);
    CHECK(html.find(words) != std::string::npos);
  }
}
