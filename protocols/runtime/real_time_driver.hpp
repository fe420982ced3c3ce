#pragma once

#include <cstddef>
#include <vector>

#include "protocols/link/can_link.hpp"
#include "protocols/participant/participant.hpp"
#include "protocols/runtime/bench_client.hpp"
#include "protocols/runtime/lockstep_driver.hpp"
#include "protocols/runtime/real_time_clock.hpp"
#include "protocols/runtime/serial_ports.hpp"
#include "protocols/time/log_histogram.hpp"

namespace meltbench::runtime {

/// Signals that the real-time driver reports behind those of its participant: "<name>.deadline_misses" and so on.
/// A deadline is missed when the wake-up comes more than one record period late; queue_full counts the sends that a
/// full transmit queue refused, and that were tried again.
[[nodiscard]] std::vector<SignalInfo> real_time_signals(std::string_view participant_name);

/// Frames that wait for room in the transmit queue, oldest first. Holds a fixed number, and never allocates.
class FrameQueue {
 public:
  static constexpr std::size_t kCapacity = 1024;  ///< More is a bus that does not move.

  FrameQueue() : frames_(kCapacity), nodes_(kCapacity) {}
  [[nodiscard]] bool empty() const { return size_ == 0; }
  [[nodiscard]] bool full() const { return size_ == kCapacity; }
  [[nodiscard]] std::size_t size() const { return size_; }
  [[nodiscard]] const can::CanFrame& front() const { return frames_[first_]; }
  /// Which of the participant's nodes sends it.
  [[nodiscard]] std::uint8_t front_node() const { return nodes_[first_]; }
  /// @pre !full()
  void push(const can::CanFrame& frame, std::uint8_t node = 0) {
    const std::size_t place = (first_ + size_++) % kCapacity;
    frames_[place] = frame;
    nodes_[place] = node;
  }
  /// @pre !empty()
  void pop() {
    first_ = (first_ + 1) % kCapacity;
    --size_;
  }
  void clear() { size_ = 0; }

 private:
  std::vector<can::CanFrame> frames_;
  std::vector<std::uint8_t> nodes_;
  std::size_t first_ = 0;
  std::size_t size_ = 0;
};

/// Real-time driver: CLOCK_MONOTONIC, absolute deadlines, one thread.
///
/// Deadlines are instants, and each sleep is counted from now to the next of them, so lateness never adds up. It sleeps
/// in one poll on link, lines and bench, without timer slack, and counts how late each wake-up at a deadline was. In
/// the steady state the loop allocates nothing but for events.
///
/// The participant is woken at its deadline, or when a frame or bytes arrive. A frame that the full transmit queue
/// refuses waits here, in order, and is tried again every 200 us of wall-clock time; a link that is down is looked for
/// every 100 ms, what waited for it is dropped and counted, and the participant is told of both edges.
class RealTimeDriver {
 public:
  /// @param bench  where to report to and who says stop; null: none; events and at last the lateness go to the log, and
  /// the run ends by signal.
  /// @param serial  of all its lines().
  RealTimeDriver(Participant& participant, link::CanLink& can, BenchClient* bench, const link::Welcome& timing,
                 SerialPorts serial = {});

  /// @param until  ends then by itself; never: when it is told to.
  [[nodiscard]] DriverEnd run(Instant until = Instant::never());

  /// Of all wake-ups at a deadline but the first, in bench time.
  [[nodiscard]] const LogHistogram& lateness() const { return lateness_; }

 private:
  void wait_for_work();
  void note_lateness(Instant deadline);
  void collect_arrivals();
  void note_bench();
  [[nodiscard]] bool has_arrivals() { return !arrived_.empty() || !serial_.inbox().empty(); }
  void wake();
  void queue_frames();
  void send_waiting();
  void note_link(bool up);
  void report();
  void log_events();
  void log_lateness() const;
  [[nodiscard]] bool finished() const;

  Participant& participant_;
  link::CanLink& can_;
  BenchClient* bench_;
  SerialPorts serial_;
  RealTimeClock clock_;
  Nanos record_period_;
  Instant next_record_{};
  Instant next_timing_{1s};  ///< When the lateness is reported next.

  Instant until_ = Instant::never();
  Instant now_{};
  Outbox out_;
  bool link_up_ = true;
  Nanos next_link_check_{};  ///< On CLOCK_MONOTONIC, while the link is down.
  std::vector<can::StampedFrame> arrived_;
  FrameQueue waiting_;         ///< To be sent.
  std::vector<Event> events_;  ///< To be reported.
  std::vector<double> signals_;

  bool was_woken_ = false;
  std::uint64_t deadline_misses_ = 0;
  std::uint64_t frames_lost_ = 0;
  LogHistogram lateness_;
};

}  // namespace meltbench::runtime
