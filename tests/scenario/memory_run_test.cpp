#include "bench/cli/memory_run.hpp"

#include <catch2/catch.hpp>
#include <fstream>

#include "tests/tools/temporary_folder.hpp"

using namespace meltbench;

namespace {

class ErrorCounter final : public bus::RunObserver {
 public:
  void on_frame(const can::StampedFrame& frame, std::size_t /*sender*/) override {
    if (frame.frame.kind == can::FrameKind::kError) ++errors;
  }
  void on_row(Instant /*at*/, std::span<const double> /*values*/) override {}
  void on_event(std::size_t /*participant*/, const Event& /*event*/) override {}
  std::uint64_t errors = 0;
};

}  // namespace

TEST_CASE("Run in memory: the bus is the one that the rig says, faults of its wires included", "[cli]") {
  const test::TemporaryFolder folder;
  std::ofstream{folder / "s.toml"} << "[scenario]\nname = \"s\"\nrig = \"" MELTBENCH_SOURCE_DIR
                                      "/fixtures/rigs/bizone.toml\"\nduration_s = 3\n"
                                      "[bus]\nfidelity = \"bit-timed\"\n"
                                      "[[fault]]\ntarget = \"bus\"\nkind = \"short_circuit\"\nat_s = 1\nfor_s = 0.1\n";
  cli::MemoryRun run{scenario::load(folder / "s.toml").front()};
  ErrorCounter observer;
  CHECK(run.play(observer).kind == bus::RunOutcome::Kind::kCompleted);
  CHECK(observer.errors > 0);
}
