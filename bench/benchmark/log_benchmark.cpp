/// How fast logs of a bus are read.

#include <benchmark/benchmark.h>

#include "bench/log/log_reader.hpp"
#include "protocols/can/candump.hpp"

namespace {

using namespace meltbench;

/// A second of a bus with heartbeats, PDOs and SYNC, as text.
std::string make_log(int frames) {
  std::string text;
  for (int i = 0; i < frames; ++i) {
    const auto byte = static_cast<std::uint8_t>(i);
    can::CanFrame frame = can::make_frame(0x180U + static_cast<unsigned>(i) % 64U, {byte, 1, 2, 3, 4, 5, 6, 7});
    frame.length = static_cast<std::uint8_t>(i % 9);
    can::append_log_line(text, Instant{Nanos{1'772'368'496'000'000'000} + i * 100us}, "can0", frame);
  }
  return text;
}

void read_candump_text(benchmark::State& state) {
  const std::string text = make_log(100'000);
  std::uint64_t frames = 0;
  for (auto _ : state) {
    const auto reader = log::open_log(std::make_unique<log::MemorySource>(std::span{text.data(), text.size()}));
    log::LogEntry entry;
    while (reader->next(entry)) benchmark::DoNotOptimize(entry.frame.id);
    frames += reader->frames();
  }
  state.counters["frames_per_s"] = benchmark::Counter(static_cast<double>(frames), benchmark::Counter::kIsRate);
}
BENCHMARK(read_candump_text)->Unit(benchmark::kMillisecond);

}  // namespace
