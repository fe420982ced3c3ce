#pragma once
/// Writes down what goes over a bus, as long as it is asked to.

#include <cstdint>
#include <functional>
#include <string>

#include "bench/record/log_files.hpp"
#include "protocols/link/can_link.hpp"

namespace meltbench::record {

struct BusRecorderRequest {
  std::string device;  ///< Name in the lines, e.g. "can0".
  Nanos
      epoch_offset{};  ///< CLOCK_REALTIME minus CLOCK_MONOTONIC when the recording began: one time base for all of it.
};

struct BusRecorderResult {
  std::uint64_t frames = 0;
  std::uint64_t dropped = 0;  ///< By the kernel, because they were read too late.
  std::uint64_t downs = 0;    ///< Times that the bus went away.
};

/// Gives the link's socket the largest receive buffer that this user may have. @returns its bytes.
std::size_t enlarge_receive_buffer(int socket);

/// Lines are in the file at the latest so long after they were received, and a frame or two.
inline constexpr Nanos kFlushEvery = 50ms;

/// Records until `stop` says so, and then takes what still waits. Frames that the
/// kernel dropped become a DROPCOUNT line as candump writes it, a bus that goes away and comes back a comment.
/// @throws std::system_error if a file cannot be written.
[[nodiscard]] BusRecorderResult record_bus(link::CanLink& link, LogFiles& files, const BusRecorderRequest& request,
                                           const std::function<bool()>& stop);

}  // namespace meltbench::record
