#pragma once

#include <deque>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "bench/bus/broker.hpp"
#include "bench/bus/gateway.hpp"
#include "bench/bus/run_media.hpp"
#include "bench/bus/run_observer.hpp"
#include "bench/bus/serial_lines.hpp"
#include "protocols/link/can_link.hpp"
#include "protocols/runtime/real_time_clock.hpp"

namespace meltbench::bus {

/// Runs participants at wall-clock pace: hands the frames of each to all others, or listens on the kernel bus that they
/// use, and writes down what they report. A participant that is slow to take its frames loses them, and is counted; it
/// never holds up the others. Programs that the bench did not start may join the embedded bus at any time.
class WallClockRelay final : private RunControl, private MediumListener {
 public:
  /// @param joined  in the order of their numbers.  @param broker  where others join.
  /// @param kernel_bus  the bus to listen on; null: carry the frames.
  /// @param media  serial lines are carried at the pace of their baud rate, as in virtual time. Frames from outside
  /// wait until every participant has room for them, so that they push nothing out. An intervention acts when the relay
  /// next looks, at most a few milliseconds late, and its instants are those at which it did.
  /// @throws std::invalid_argument naming a line of a participant that is not in media.lines.
  WallClockRelay(std::span<Joined> joined, Broker& broker, link::CanLink* kernel_bus, Nanos record_period,
                 const RunMedia& media = {});

  /// Welcomes everybody, runs for `duration` of bench time at `speed` bench seconds per second.
  [[nodiscard]] RunOutcome run(Nanos duration, double speed, RunObserver& observer);

  /// The bit-timed bus, for its counters; null on the ideal bus and on a kernel's.
  [[nodiscard]] BitTimedMedium* medium() override { return medium_.get(); }

  /// How late the wake-ups of each participant were, by name; complete once the programs have ended.
  [[nodiscard]] std::vector<std::pair<std::string, LogHistogram>> collect_lateness();

  /// Signals of all participants, with those of their real-time drivers, in the order of on_row's values.
  [[nodiscard]] static std::vector<SignalInfo> signals_of(std::span<const Joined> joined);

 private:
  struct Report {
    Instant at;
    std::vector<double> values;
  };
  /// A frame that was sent, to be put on the bit-timed bus.
  struct Sent {
    std::size_t sender = 0;
    runtime::CarriedFrame carried;
  };
  struct Party {
    Joined* joined = nullptr;
    std::size_t first_signal = 0;
    std::size_t signal_count = 0;
    std::deque<Report> reports;      ///< Newer than the last row.
    LogHistogram lateness;           ///< As last reported.
    std::deque<std::string> orders;  ///< Not yet told,
    bool lines_changed = false;      ///< nor is this.
    Nanos heard_of{};                ///< CLOCK_MONOTONIC.
    bool gone = false;
    bool is_outsider = false;  ///< Not started by the bench: joined later, and may leave.
  };

  Party& add_party(Joined& joined);
  void take_newcomer();
  void wait(Nanos until);
  void read_messages(std::size_t number);
  /// @returns whether it was such a message.
  [[nodiscard]] static bool take_lateness(Party& party, std::span<const std::uint8_t> message);
  void deliver_serial();
  void read_kernel_bus();
  void exchange_with_adapter();
  void exchange_with_outside();
  [[nodiscard]] bool all_have_room() const;
  void carry(std::size_t sender, const runtime::CarriedFrame& carried);
  void distribute(std::size_t sender, const runtime::CarriedFrame& carried);
  void intervene();
  [[nodiscard]] bool passes(const can::StampedFrame& frame, std::size_t sender);
  void deliver(const can::CanFrame& frame, std::size_t sender) override;
  void post_order(std::size_t participant, std::string order) override;
  void plug_line(std::size_t participant, std::uint8_t own_line, bool in) override;
  [[nodiscard]] SerialLine* find_line(std::string_view name) override { return lines_.find(name); }
  void tell(std::size_t number);
  void send_queued();
  void show(const can::StampedFrame& frame, std::size_t sender);
  void give(const can::StampedFrame& frame, std::uint64_t heard_by);
  void tell_nodes(std::size_t number);
  [[nodiscard]] Nanos find_next_event(Nanos until) const;
  void on_crossed(const can::StampedFrame& frame, std::size_t sender, std::uint64_t heard_by) override;
  void on_error_frame(const can::StampedFrame& error, std::size_t participant) override;
  void on_node_state(std::size_t participant, const Event& event) override;
  void write_rows_until(Instant at);
  [[nodiscard]] std::string find_lost() const;

  std::vector<Party> parties_;
  std::deque<Joined> outsiders_;
  Broker& broker_;
  link::CanLink* kernel_bus_;
  Outside* outside_;
  Intervention* intervention_;
  Instant intervened_at_{};  ///< The instant that it was told last.
  SerialLines lines_;
  std::optional<Gateway> gateway_;
  std::vector<link::ReceivedFrame> from_adapter_;
  std::unique_ptr<BitTimedMedium> medium_;  ///< Null: frames cross at once.
  Instant bus_time_{};                      ///< To which it has been advanced.
  std::vector<Sent> sent_;                  ///< Since then.
  std::vector<can::CanFrame> from_outside_;
  bool outside_has_sent_ = false;
  bool outside_has_more_ = false;  ///< As many came at once as may.
  std::vector<pollfd> watched_;
  Nanos record_period_;
  RunObserver* observer_ = nullptr;  ///< Of the run that goes on.
  link::Welcome welcome_;
  runtime::RealTimeClock clock_{Nanos{}, 1.0};
  std::vector<double> values_;
  std::vector<Event> events_;
  link::MessageWriter writer_;
  Instant last_frame_at_{};
  Instant next_row_{};
  std::uint64_t lost_frames_ = 0;
};

}  // namespace meltbench::bus
