#pragma once
/// The loop that writes down what goes over some wires, on one axis of time.

#include <poll.h>

#include <functional>
#include <span>
#include <vector>

#include "protocols/time/instant.hpp"

namespace meltbench::record {

/// Lines are in the file at the latest so long after they were received, and a frame or two.
inline constexpr Nanos kFlushEvery = 50ms;

/// Listens to a wire and writes down what it hears. All calls in one thread; none waits for the wire.
class WireRecorder {
 public:
  virtual ~WireRecorder() = default;

  /// Appends what to wait for until take() is worth a call.
  virtual void watch(std::vector<pollfd>& watched) const = 0;
  /// Takes some of what waits, and looks whether the wire is still there.
  /// @throws std::system_error if a file cannot be written.
  virtual void take() = 0;
  /// All that was taken is the kernel's. @throws as take()
  virtual void flush() = 0;
  /// Takes the rest of what had come by this CLOCK_MONOTONIC reading, and flushes. Last of all. @throws as take()
  virtual void finish(Nanos stopped_at) = 0;
};

/// Records until `stop` says so, which is asked every 20 ms at the least. @throws std::system_error
void record_until(std::span<WireRecorder* const> recorders, const std::function<bool()>& stop);

}  // namespace meltbench::record
