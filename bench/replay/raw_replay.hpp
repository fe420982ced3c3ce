#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "bench/log/log_reader.hpp"
#include "protocols/link/can_link.hpp"
#include "protocols/time/log_histogram.hpp"

namespace meltbench::replay {

/// What of a log goes out, and how.
struct RawReplayRequest {
  double speed = 1.0;       ///< > 0; log seconds per second.
  std::uint64_t loops = 1;  ///< 0: until stopped.
  std::string channel{};    ///< Of the log; empty: that of the first frame.
  struct IdRange {
    std::uint32_t id = 0;
    std::uint32_t mask = 0xFFFF'FFFF;
  };
  std::vector<IdRange> only{};  ///< Empty: all identifiers.
  struct Rename {
    std::uint32_t from = 0;
    std::uint32_t to = 0;
  };
  std::vector<Rename> renames{};
};

struct RawReplayResult {
  std::uint64_t sent = 0;
  std::uint64_t left_out = 0;     ///< Filtered, error frames, other channels.
  std::uint64_t unsupported = 0;  ///< The bus cannot carry them: FD on a classic interface.
  std::uint64_t waits = 0;        ///< Times that the transmit queue was full.
  std::uint64_t refused = 0;      ///< Sent, but an adapter refused them then.
  LogHistogram lateness;          ///< When each frame went out, after when it should have.
};

/// Sends a log's frames at their recorded times on CLOCK_MONOTONIC, by an absolute schedule: a late frame delays none
/// after it. A full transmit queue is waited for. A time stamp that goes back counts as the one before it.
/// @param open  the log from its beginning; asked for once per loop.
/// @param stop  asked before each frame.
/// @throws log::LogError; link::LinkError if the bus goes down.
[[nodiscard]] RawReplayResult replay_raw(const std::function<std::unique_ptr<log::LogReader>()>& open,
                                         link::CanLink& bus, const RawReplayRequest& request,
                                         const std::function<bool()>& stop);

}  // namespace meltbench::replay
