#pragma once
/// What every program on a wire is: an object without I/O and without a clock, woken by a driver.

#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "protocols/can/error_state.hpp"
#include "protocols/can/frame.hpp"
#include "protocols/time/instant.hpp"

namespace meltbench {

enum class LinkState : std::uint8_t { kUp, kDown };

/// Bytes that came over a serial line without a gap between them.
struct SerialArrival {
  Instant at;             ///< When the last of them was there.
  std::uint8_t line = 0;  ///< Number in Participant::lines().
  std::span<const std::uint8_t> bytes;
};

/// Why a participant is woken: its deadline has come, something has arrived, or a link has changed; often several at
/// once.
struct Wakeup {
  Instant now;                                ///< Never before the previous wake-up.
  std::span<const can::StampedFrame> frames;  ///< Arrived since the previous wake-up, oldest first, stamps <= now.
  LinkState link = LinkState::kUp;
  std::span<const SerialArrival> serial{};   ///< As frames.
  std::span<const LinkState> lines{};        ///< Of each serial line, in the order of lines(); empty: all are up.
  std::span<const can::ErrorState> nodes{};  ///< Of each CAN node, in the order of nodes(); empty: all error-active.
  std::span<const std::string> orders{};     ///< What the bench asks of it, one TOML text each.
};

/// kInfo is a fact of the run; kWarning was survived; kFault took something out of service.
/// A warning or a fault that the scenario does not expect fails the run (health gate).
enum class Severity : std::uint8_t { kInfo, kWarning, kFault };

/// Something a participant wants in the recording. `code` is stable and in kebab case ("heartbeat-lost"), `text` is for
/// people.
struct Event {
  Instant at;
  Severity severity = Severity::kInfo;
  std::string code;
  std::string text;
};

/// When to wake a participant again.
enum class WakeOn : std::uint8_t {
  kArrivalOrDeadline,  ///< As soon as something arrives, or at the deadline.
  kDeadlineOnly,       ///< At the deadline only; it then reads what has arrived by then.
};

/// From frame number `first` of an outbox on, the sender is this node.
struct SenderMark {
  std::size_t first = 0;
  std::uint8_t node = 0;  ///< Number in Participant::nodes().
};

/// A piece of an outbox's serial_bytes(), to be written to a line.
struct SerialPiece {
  std::uint8_t line = 0;  ///< Number in Participant::lines().
  std::size_t first = 0;
  std::size_t size = 0;
};

/// What a participant answers to one wake-up. Owned and reused by the driver, so that the loop does not allocate.
class Outbox {
 public:
  void send(const can::CanFrame& frame) { frames_.push_back(frame); }
  /// The queue itself, for protocol code that appends frames to a vector.
  [[nodiscard]] std::vector<can::CanFrame>& frame_queue() { return frames_; }
  /// Frames queued from here on come from this one of the participant's nodes(); from the first one before any call.
  void speak_as(std::uint8_t node) {
    const std::uint8_t before = senders_.empty() ? std::uint8_t{0} : senders_.back().node;
    if (node != before) senders_.push_back({frames_.size(), node});
  }
  /// Writes bytes to this one of the participant's lines(), after what was written to it before.
  void write(std::uint8_t line, std::span<const std::uint8_t> bytes) {
    pieces_.push_back({line, serial_bytes_.size(), bytes.size()});
    serial_bytes_.insert(serial_bytes_.end(), bytes.begin(), bytes.end());
  }
  void report(Severity severity, Instant at, std::string code, std::string text) {
    events_.push_back(Event{at, severity, std::move(code), std::move(text)});
  }
  /// The events themselves, for a driver whose clock is not the participant's.
  [[nodiscard]] std::vector<Event>& event_queue() { return events_; }
  /// @param deadline  not before now; Instant::never() = only when something arrives.
  void wake_at(Instant deadline, WakeOn on = WakeOn::kArrivalOrDeadline) {
    deadline_ = deadline;
    wake_on_ = on;
  }

  [[nodiscard]] std::span<const can::CanFrame> frames() const { return frames_; }
  /// Marks in the order of `first`; frames before the first mark come from node 0.
  [[nodiscard]] std::span<const SenderMark> senders() const { return senders_; }
  [[nodiscard]] std::span<const SerialPiece> serial() const { return pieces_; }
  [[nodiscard]] std::span<const std::uint8_t> serial_bytes(const SerialPiece& piece) const {
    return std::span{serial_bytes_}.subspan(piece.first, piece.size);
  }
  [[nodiscard]] std::span<const Event> events() const { return events_; }
  [[nodiscard]] Instant deadline() const { return deadline_; }
  [[nodiscard]] WakeOn wake_on() const { return wake_on_; }

  /// Forgets everything but keeps the memory. A driver calls it before each wake-up.
  void clear() {
    frames_.clear();
    senders_.clear();
    pieces_.clear();
    serial_bytes_.clear();
    events_.clear();
    deadline_ = Instant::never();
    wake_on_ = WakeOn::kArrivalOrDeadline;
  }

 private:
  std::vector<can::CanFrame> frames_;
  std::vector<SenderMark> senders_;
  std::vector<SerialPiece> pieces_;
  std::vector<std::uint8_t> serial_bytes_;
  std::vector<Event> events_;
  Instant deadline_ = Instant::never();
  WakeOn wake_on_ = WakeOn::kArrivalOrDeadline;
};

/// What a signal is for. An error counter that is not zero at the end of a run fails it (health gate).
enum class SignalKind : std::uint8_t { kValue, kErrorCounter };

/// A number that a participant lets the bench record: dotted name with its SI unit at the end ("plant.x_m").
struct SignalInfo {
  std::string name;
  SignalKind kind = SignalKind::kValue;
};

/// A program on the wire. Same object under every driver: in process, lockstep, real time.
///
/// The driver wakes it first at Instant{0} with nothing arrived, then at or after its own deadline, or when something
/// has arrived. It answers in the outbox: frames in the order of sending, events, and the next deadline. Between two
/// wake-ups it does nothing. Its answer depends on nothing but what it was told, so equal input gives equal output.
class Participant {
 public:
  virtual ~Participant() = default;

  /// Short name on the bench: "plant", "controller".
  [[nodiscard]] virtual std::string_view name() const = 0;

  /// Its nodes on the CAN bus by name, fixed for its lifetime. Empty: one, with the participant's own name.
  [[nodiscard]] virtual std::span<const std::string> nodes() const { return {}; }
  /// The serial lines that it speaks on by name, fixed for its lifetime.
  [[nodiscard]] virtual std::span<const std::string> lines() const { return {}; }

  /// Handles everything due up to in.now: arrived frames first, then its own timers. Never throws; no allocation in
  /// the steady state but for events.
  virtual void wake(const Wakeup& in, Outbox& out) = 0;

  /// The signals it offers, fixed for its lifetime.
  [[nodiscard]] virtual std::span<const SignalInfo> signals() const = 0;

  /// Values of signals() as of the last wake-up, same order. @pre values.size() == signals().size().
  virtual void read_signals(std::span<double> values) const = 0;
};

}  // namespace meltbench
