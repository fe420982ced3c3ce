#pragma once

#include <poll.h>

#include <cstddef>
#include <vector>

#include "bench/bus/run_observer.hpp"

namespace meltbench::bus {

/// Other people's programs on the embedded bus of a run: they see its frames and may send some.
///
/// Whoever carries the bus calls this often, in one thread. No call waits for an outsider, so none delays the run.
class Outside {
 public:
  virtual ~Outside() = default;

  /// Hands the outsiders what they have not read yet, and takes what they have sent.
  /// @param room    how many frames may be taken now; further ones stay with their senders.
  /// @param frames  what was taken is appended, oldest first.
  virtual void exchange(std::size_t room, std::vector<can::CanFrame>& frames) = 0;

  /// A frame was on the bus, theirs included. @param sender  as RunObserver::on_frame has it.
  virtual void show(const can::StampedFrame& frame, std::size_t sender) = 0;

  /// Appends what to wait for until exchange() is worth a call.
  virtual void watch(std::vector<pollfd>& watched) const = 0;
};

/// The event that the first frame from outside leaves in the recording.
[[nodiscard]] inline Event make_outside_event(Instant at) {
  return {at, Severity::kInfo, "frames-from-outside",
          "a program outside the run sends from here on: the run cannot be repeated to the byte"};
}

}  // namespace meltbench::bus
