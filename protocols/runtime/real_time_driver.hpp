#pragma once

#include <deque>

#include "protocols/link/can_link.hpp"
#include "protocols/participant/participant.hpp"
#include "protocols/runtime/bench_client.hpp"
#include "protocols/runtime/lockstep_driver.hpp"
#include "protocols/runtime/real_time_clock.hpp"

namespace meltbench::runtime {

/// Signals that the real-time driver reports behind those of its participant: "<name>.deadline_misses" and so on.
/// A deadline is missed when the wake-up comes more than one record period late.
[[nodiscard]] std::vector<SignalInfo> real_time_signals(std::string_view participant_name);

/// Real-time driver: CLOCK_MONOTONIC, absolute deadlines, one thread.
///
/// The participant is woken at its deadline or when a frame arrives. A frame that the full transmit queue refuses waits
/// here, in order, and is tried again every 200 us of wall-clock time; a link that is down is looked for every 100 ms,
/// what waited for it is dropped and counted, and the participant is told of both edges.
class RealTimeDriver {
 public:
  /// @param bench  where to report to and who says stop; null: none; events go to the log, and
  /// the run ends by signal.
  RealTimeDriver(Participant& participant, link::CanLink& can, BenchClient* bench, const link::Welcome& timing);

  [[nodiscard]] DriverEnd run();

 private:
  void wait_for_work();
  void collect_frames();
  void wake();
  void send_waiting();
  void note_link(bool up);
  void report();
  void log_events();
  [[nodiscard]] bool finished() const;

  Participant& participant_;
  link::CanLink& can_;
  BenchClient* bench_;
  RealTimeClock clock_;
  Nanos record_period_;
  Instant next_record_{};

  Instant now_{};
  Outbox out_;
  bool link_up_ = true;
  Nanos next_link_check_{};  ///< On CLOCK_MONOTONIC, while the link is down.
  std::vector<can::StampedFrame> arrived_;
  std::deque<can::CanFrame> waiting_;  ///< To be sent.
  std::vector<Event> events_;          ///< To be reported.
  std::vector<double> signals_;

  std::uint64_t deadline_misses_ = 0;
  std::uint64_t frames_lost_ = 0;
  Nanos worst_lateness_{};
};

}  // namespace meltbench::runtime
