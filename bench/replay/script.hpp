#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "bench/decode/bus_view.hpp"
#include "bench/log/log_reader.hpp"

namespace meltbench::replay {

/// One recorded frame, and whose it was.
struct ScriptFrame {
  Instant at;  ///< Since the first frame of the controller, which is what a run begins with.
  can::CanFrame frame;
  bool from_controller = false;
  std::uint64_t line = 0;  ///< In the log.
};

/// A recording as two parties that talk to each other.
struct Script {
  std::vector<ScriptFrame> frames;
  std::uint64_t left_out = 0;  ///< Frames before the controller's first, error frames, frames of other channels.
  Instant end;                 ///< Of the last frame.
};

/// @param channel  the channel to read; empty: that of the first frame.
/// @throws log::LogError; also if there is no frame of the rig's controller in it.
[[nodiscard]] Script read_script(log::LogReader& log, decode::BusView& view, std::string channel = {});

}  // namespace meltbench::replay
