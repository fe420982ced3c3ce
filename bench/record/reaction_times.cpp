#include "bench/record/reaction_times.hpp"

#include <optional>

namespace meltbench::record {
namespace {

constexpr std::uint32_t kSync = 0x080;

/// RPDO 1 to 4: function codes 4, 6, 8, 10.
bool is_command(std::uint32_t id) {
  const std::uint32_t function_code = id >> 7U;
  return function_code >= 4 && function_code <= 10 && function_code % 2 == 0;
}

}  // namespace

LogHistogram calc_reaction_times(const FrameLog& frames) {
  LogHistogram times;
  std::optional<Instant> sync;
  for (std::size_t i = 0; i < frames.size(); ++i) {
    const std::uint32_t id = frames.id(i);
    if (!frames.is_standard_data(i, id)) continue;
    if (id == kSync) sync = frames.at(i);
    if (!sync || !is_command(id)) continue;
    times.add(frames.at(i) - *sync, frames.at(i));
    sync.reset();
  }
  return times;
}

}  // namespace meltbench::record
