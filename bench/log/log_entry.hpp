#pragma once
/// What every bus log holds, whatever its format: frames with their time, channel and direction.

#include <cstddef>
#include <cstdint>

#include "protocols/can/frame.hpp"

namespace meltbench::log {

/// Of a frame, seen from the program that wrote the log.
enum class Direction : std::uint8_t { kUnknown, kReceived, kSent };

struct LogEntry {
  Instant at;               ///< Since the log's own zero: the Unix epoch, or the start of the measurement.
  std::size_t channel = 0;  ///< Number in LogReader::channels().
  Direction direction = Direction::kUnknown;
  can::CanFrame frame;
};

}  // namespace meltbench::log
