#pragma once

#include <memory>
#include <span>
#include <string>
#include <vector>

#include "bench/bus/bit_timed_medium.hpp"
#include "bench/bus/run_media.hpp"
#include "bench/bus/run_observer.hpp"
#include "bench/bus/serial_lines.hpp"
#include "protocols/participant/serial_inbox.hpp"
#include "protocols/runtime/participant_port.hpp"

namespace meltbench::bus {

/// Runs participants in virtual time: computing takes none. On the ideal bus frames cross at once, too; on the
/// bit-timed bus as BitTimedMedium has it.
///
/// Exactly one participant runs at a time: the one whose next instant is the earliest, and of several the one with the
/// lowest number; the bit-timed bus goes on when nobody has anything left to do at an instant. On the ideal bus a frame
/// reaches everybody but its sender at the instant of its sending. So equal participants with
/// equal seeds give equal runs, to the last bit, whether they are objects of this process or processes of their own.
///
/// Every participant is woken at least at each multiple of the record period, so that a row holds what is true then
/// (unless it asked for kDeadlineOnly).
///
/// Bytes on a serial line take their time: see SerialLine.
class VirtualTime final : private RunControl, private MediumListener {
 public:
  /// @param ports  participants in the order of their numbers; they and the observer outlive this object.
  /// @pre record_period > 0.
  /// @throws std::invalid_argument naming a line that is not in media.lines.
  VirtualTime(std::span<runtime::ParticipantPort* const> ports, Nanos record_period, RunObserver& observer,
              const RunMedia& media = {});

  /// Runs from Instant{0} up to and including Instant{duration}. Returns early, with the reason, when a participant is
  /// lost, when the user interrupts, or when participants keep answering each other without time passing.
  /// Cost beside the participants' own: about 0.1 us per wake-up, no allocation in the steady state.
  [[nodiscard]] RunOutcome run(Nanos duration);

  /// Asks something of a participant, for the observer to call during run(): it is woken for it at once.
  /// @param order  a TOML text that the participant understands.
  void post_order(std::size_t participant, std::string order) override;

  /// Pulls a participant's plug out of one of its serial lines, or puts it in again, and wakes it for that at once. For
  /// the observer to call during run().
  void plug_line(std::size_t participant, std::uint8_t own_line, bool in) override;
  /// A serial line of the run, to give it a fault; null if there is none of that name.
  [[nodiscard]] SerialLine* find_line(std::string_view name) override { return lines_.find(name); }
  /// The bit-timed bus, for its counters and to give it faults during run(); null on the ideal bus.
  [[nodiscard]] BitTimedMedium* medium() override { return medium_.get(); }

 private:
  struct Party {
    runtime::ParticipantPort* port = nullptr;
    std::vector<can::StampedFrame> inbox;
    SerialInbox serial;
    std::vector<std::string> orders;
    bool line_changed = false;
    bool node_changed = false;
    Instant deadline{};
    WakeOn wake_on = WakeOn::kArrivalOrDeadline;
    Instant next_record{};
    std::size_t first_signal = 0;
    std::size_t signal_count = 0;
  };

  [[nodiscard]] static Instant next_wake(const Party& party);
  [[nodiscard]] std::size_t choose_next() const;
  [[nodiscard]] runtime::PortStatus wake(std::size_t number);
  void carry(std::size_t sender);
  void put_on_bus(const can::CanFrame& frame, std::size_t sender);
  void queue(std::size_t sender);
  void on_crossed(const can::StampedFrame& frame, std::size_t sender, std::uint64_t heard_by) override;
  void on_error_frame(const can::StampedFrame& error, std::size_t participant) override;
  void on_node_state(std::size_t participant, const Event& event) override;
  void give(const can::CanFrame& frame, std::size_t sender, std::uint64_t heard_by);
  [[nodiscard]] Instant next_on_bus() const;
  void deliver(const can::CanFrame& frame, std::size_t sender) override;
  [[nodiscard]] Instant next_intervention() const;
  [[nodiscard]] bool admit_outside();
  void deliver_serial();
  void advance_to(Instant at);
  void write_rows_before(Instant now);
  [[nodiscard]] RunOutcome end(RunOutcome::Kind kind, std::string text) const;

  std::vector<Party> parties_;
  Nanos record_period_;
  RunObserver& observer_;
  Outside* outside_;
  Intervention* intervention_;
  std::vector<can::CanFrame> from_outside_;
  bool outside_has_sent_ = false;
  SerialLines lines_;
  std::unique_ptr<BitTimedMedium> medium_;  // Null: the ideal bus.
  Instant now_{};
  Instant next_row_{};
  std::vector<double> values_;
  std::vector<can::StampedFrame> taken_;   ///< The inbox of who is being woken,
  std::vector<std::string> taken_orders_;  ///< and what is asked of it.
  int wakeups_now_ = 0;                    ///< At this instant.
  Outbox out_;
};

}  // namespace meltbench::bus
