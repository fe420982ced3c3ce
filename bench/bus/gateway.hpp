#pragma once

#include <deque>
#include <vector>

#include "bench/bus/run_observer.hpp"
#include "protocols/link/can_link.hpp"

namespace meltbench::bus {

/// Makes one bus of the embedded one and of the one behind a link: an adapter that only one process can open (slcan),
/// or a kernel interface. Never waits: frames that the adapter does not take yet wait in order, up to kMaxWaiting;
/// further ones are lost, and so are those that meet an adapter that is unplugged. Both are counted, and its going and
/// coming leave an event each.
class Gateway {
 public:
  static constexpr std::size_t kMaxWaiting = 1024;

  /// @param link  outlives this object.
  explicit Gateway(link::CanLink& link) : link_{link} {}

  /// A frame of the embedded bus, for the adapter.
  void send(const can::CanFrame& frame);
  /// Goes on sending, and takes what has come. @param arrived  is appended, oldest first.
  void exchange(Instant now, std::vector<link::ReceivedFrame>& arrived, std::vector<Event>& events);
  /// For poll(2): readable when frames have come; -1 while the adapter is away.
  [[nodiscard]] int fd() const { return link_.fd(); }
  /// Frames wait: exchange() is worth a call within a millisecond.
  [[nodiscard]] bool has_waiting() const { return !waiting_.empty(); }
  [[nodiscard]] std::size_t waiting() const { return waiting_.size(); }
  /// So far, in either direction.
  [[nodiscard]] std::uint64_t lost_frames() const {
    return lost_ + link_.counters().dropped + link_.counters().refused;
  }

 private:
  void note_state(bool up, Instant now, std::vector<Event>& events);

  link::CanLink& link_;
  std::deque<can::CanFrame> waiting_;
  bool up_ = true;
  Instant next_look_{};  ///< While it is away.
  std::uint64_t lost_ = 0;
};

}  // namespace meltbench::bus
