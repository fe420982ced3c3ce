#pragma once

#include <poll.h>

#include <memory>
#include <span>
#include <string>
#include <vector>

#include "protocols/link/serial_link.hpp"
#include "protocols/participant/serial_inbox.hpp"
#include "protocols/runtime/real_time_clock.hpp"

namespace meltbench::runtime {

/// A participant's serial lines at wall-clock pace, for the real-time driver.
///
/// A line that is down is looked for every 100 ms of wall-clock time. Bytes that a line does not take at once (it is
/// down, or its queue is full) are lost, and counted: on a serial line a late answer is worse than none.
class SerialPorts {
 public:
  /// None.
  SerialPorts() = default;
  /// @param names  as Participant::lines().  @param links  of these lines; they outlive this object.
  SerialPorts(std::span<const std::string> names, std::span<link::SerialLink* const> links);

  /// Takes what has arrived and notes which lines have gone or come back; those leave an event each.
  /// @returns true if the state of a line has changed: the participant is to be told at once.
  [[nodiscard]] bool collect(const RealTimeClock& clock, Instant now, std::vector<Event>& events);
  /// The bench has pulled the plugs of those lines that are down, and put in the others. That leaves no event: it is
  /// the fault itself that is told. @param states  in the order of lines(); further lines are plugged in.
  void plug(std::span<const LinkState> states);
  /// What was collected and is yet to be told, until forget().
  [[nodiscard]] SerialInbox& inbox() { return inbox_; }

  /// Sends what the participant has answered.
  void write(const Outbox& out);
  /// Of each line, in the order of lines().
  [[nodiscard]] std::span<const LinkState> states() const { return states_; }
  /// Appends what to wait for until collect() is worth a call. @returns how many.
  std::size_t watch(std::span<pollfd> watched) const;
  /// When a line that is down is to be looked for, on CLOCK_MONOTONIC; Nanos::max(): all are up.
  [[nodiscard]] Nanos next_look() const;

 private:
  struct Line {
    std::string name;
    link::SerialLink* link = nullptr;
    bool unplugged = false;
    Nanos next_look{};  ///< While it is down.
    Instant down_since{};
    std::uint64_t downs = 0;
    std::uint64_t lost_bytes = 0;
    std::uint64_t told_lost_bytes = 0;
  };
  void note_down(std::size_t number, Instant now, std::vector<Event>& events);
  void note_up(std::size_t number, Instant now, std::vector<Event>& events);
  static void note_losses(Line& line, Instant now, std::vector<Event>& events);

  std::vector<Line> lines_;
  std::vector<LinkState> states_;
  SerialInbox inbox_;
};

}  // namespace meltbench::runtime
