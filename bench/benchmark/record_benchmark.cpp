/// What recording costs the loop: one row of 25 signals, one frame, with and without files.

#include <benchmark/benchmark.h>
#include <unistd.h>

#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <string>
#include <vector>

#include "bench/record/run_recorder.hpp"

namespace {

using namespace meltbench;

constexpr std::size_t kSignals = 25;

/// As in a run of the delay extruder: 15 of 25 signals move in every row.
void fill(std::vector<double>& values, std::int64_t step) {
  for (std::size_t i = 0; i < 15; ++i)
    values[i] = 0.16 + 1e-3 * std::sin(1e-3 * static_cast<double>(step) + static_cast<double>(i));
}

/// Records `count` things in a recorder of its own, outside the measured time if it is being made or ended.
template <typename Step>
void run(benchmark::State& state, Step step) {
  const bool to_files = state.range(0) != 0;
  std::string folder;
  if (to_files) {
    folder = (std::filesystem::temp_directory_path() / "meltbench_benchmark_XXXXXX").string();
    if (::mkdtemp(folder.data()) == nullptr) return state.SkipWithError("no temporary folder");
  }
  std::vector<SignalInfo> signals;
  for (std::size_t i = 0; i < kSignals; ++i) signals.push_back({"signal_" + std::to_string(i) + "_m"});
  record::RunRecorder recorder{{}, signals, folder};
  std::int64_t count = 0;
  for (auto _ : state) step(recorder, count++);
  state.SetLabel(to_files ? "files" : "memory");
  if (to_files) std::filesystem::remove_all(folder);
}

void record_row(benchmark::State& state) {
  std::vector<double> values(kSignals, 0.25);
  run(state, [&](record::RunRecorder& recorder, std::int64_t step) {
    fill(values, step);
    recorder.row(Instant{Nanos{step * 10'000'000}}, values);
  });
}
BENCHMARK(record_row)->Arg(0)->Arg(1)->Iterations(60'000);

void record_frame(benchmark::State& state) {
  can::CanFrame frame = can::make_frame(0x185, {1, 2, 3, 4, 5, 6, 7, 8});
  run(state, [&](record::RunRecorder& recorder, std::int64_t step) {
    frame.bytes[0] = static_cast<std::uint8_t>(step);
    recorder.frame({Instant{Nanos{step * 1'428'571}}, frame}, 0);
  });
}
BENCHMARK(record_frame)->Arg(0)->Arg(1)->Iterations(420'000);

}  // namespace
