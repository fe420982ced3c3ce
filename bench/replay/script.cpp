#include "bench/replay/script.hpp"

#include <algorithm>
#include <utility>

#include "bench/log/chosen_channel.hpp"
#include "bench/log/log_error.hpp"

namespace meltbench::replay {

Script read_script(log::LogReader& log, decode::BusView& view, std::string channel) {
  Script script;
  log::ChosenChannel chosen{std::move(channel)};
  log::LogEntry entry;
  Instant start{};
  Instant latest{};
  while (log.next(entry)) {
    if (!chosen.takes(log, entry) || entry.frame.kind == can::FrameKind::kError) {
      ++script.left_out;
      continue;
    }
    const bool from_controller = view.is_from_controller(entry.frame);
    view.take(entry.frame);
    if (script.frames.empty()) {
      if (!from_controller) {
        ++script.left_out;
        continue;
      }
      start = entry.at;
    }
    latest = std::max(latest, Instant{entry.at - start});  // Time that goes back is a warning; it stands still then.
    script.frames.push_back({latest, entry.frame, from_controller, log.line()});
  }
  chosen.check_found(log);
  if (script.frames.empty()) {
    throw log::LogError{"no frame of the controller in the log",
                        "is this the rig's bus? a replay begins with the controller's first frame"};
  }
  script.end = latest;
  return script;
}

}  // namespace meltbench::replay
