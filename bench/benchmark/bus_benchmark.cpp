/// How fast the bit-timed bus is: frames per second of processor time at 100 % load, 1 Mbit/s.

#include <benchmark/benchmark.h>

#include "bench/bus/bit_timed_bus.hpp"

namespace {

using namespace meltbench;

class Refill final : public bus::BusListener {
 public:
  void on_delivery(const bus::Delivery& delivery) override { last = delivery; }
  void on_error(Instant, std::size_t, const can::CanFrame&) override {}
  void on_state(Instant, std::size_t, can::ErrorState) override {}
  bus::Delivery last;
};

/// Every node always has a frame waiting: who has sent queues the next one at once.
void bit_timed_bus(benchmark::State& state) {
  const auto nodes = static_cast<std::size_t>(state.range(0));
  Refill listener;
  bus::BitTimedSettings settings;
  settings.bit_time = settings.data_bit_time = 1us;
  bus::BitTimedBus wire{settings, nodes, listener};
  const bool by_bits = state.range(1) != 0;
  if (by_bits) wire.flip(Instant{}, {.id = 0, .mask = 0, .bit = 9999, .frames = 1});  // Never met: only slows down.
  can::CanFrame frame = can::make_frame(0x100, {1, 2, 3, 4, 5, 6, 7, 8});
  for (std::size_t i = 0; i < nodes; ++i) {
    frame.id = static_cast<std::uint32_t>(0x100 + i);
    wire.send(Instant{}, i, frame);
  }
  std::uint32_t count = 0;
  for (auto _ : state) {
    static_cast<void>(_);
    listener.last.sender = bus::kNoNode;
    while (listener.last.sender == bus::kNoNode) wire.advance(wire.next_event());
    ++count;
    frame.id = 0x100 + (count % 16) * 64 + static_cast<std::uint32_t>(listener.last.sender);  // Nobody else has it.
    frame.bytes[0] = static_cast<std::uint8_t>(count);
    frame.bytes[3] = static_cast<std::uint8_t>(count >> 3U);
    wire.send(listener.last.at, listener.last.sender, frame);
  }
  state.counters["frames"] = benchmark::Counter(static_cast<double>(state.iterations()), benchmark::Counter::kIsRate);
}
BENCHMARK(bit_timed_bus)->ArgNames({"nodes", "by_bits"})->Args({8, 0})->Args({64, 0})->Args({8, 1})->Args({64, 1});

}  // namespace
