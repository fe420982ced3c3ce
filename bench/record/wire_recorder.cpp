#include "bench/record/wire_recorder.hpp"

#include "protocols/link/clock.hpp"

namespace meltbench::record {

void record_until(std::span<WireRecorder* const> recorders, const std::function<bool()>& stop) {
  constexpr int kPoll_ms = 20;
  std::vector<pollfd> watched;
  Nanos flushed_at = link::read_monotonic();
  while (!stop()) {
    watched.clear();
    for (const WireRecorder* recorder : recorders) recorder->watch(watched);
    (void)::poll(watched.data(), watched.size(), kPoll_ms);
    for (WireRecorder* recorder : recorders) recorder->take();
    const Nanos now = link::read_monotonic();
    if (now - flushed_at < kFlushEvery) continue;
    for (WireRecorder* recorder : recorders) recorder->flush();
    flushed_at = now;
  }
  const Nanos stopped_at = link::read_monotonic();
  for (WireRecorder* recorder : recorders) recorder->finish(stopped_at);
}

}  // namespace meltbench::record
