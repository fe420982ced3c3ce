#pragma once

#include <cstdint>
#include <limits>
#include <optional>
#include <string_view>

#include "bench/bus/frame_reader.hpp"
#include "bench/bus/transmit_queue.hpp"
#include "protocols/can/error_state.hpp"
#include "protocols/can/frame_bits.hpp"

namespace meltbench::bus {

inline constexpr std::size_t kNoNode = std::numeric_limits<std::size_t>::max();

/// A frame that has crossed the bus.
struct Delivery {
  Instant at;                   ///< End of the last bit of end of frame.
  std::size_t sender = 0;       ///< Number of the node, or kNoNode.
  std::uint64_t receivers = 0;  ///< Bit n: node n has received it.
  can::CanFrame frame;
  Instant queued_at;   ///< When the sender queued it,
  Instant started_at;  ///< and the start of frame that came through, the last one if there were several.
};

/// Hears what happens on a bit-timed bus, in the order of time.
class BusListener {
 public:
  virtual ~BusListener() = default;
  virtual void on_delivery(const Delivery& delivery) = 0;
  /// A node's CAN controller reports an error or a change of its state.
  /// @param error  as linux/can/error.h has it, with counters (CAN_ERR_CNT).
  virtual void on_error(Instant at, std::size_t node, const can::CanFrame& error) = 0;
  virtual void on_state(Instant at, std::size_t node, can::ErrorState state) = 0;
};

/// Counters of a node, named as `ip -details -statistics link show` names them.
struct NodeCounters {
  std::uint64_t tx_packets = 0, tx_bytes = 0, tx_dropped = 0;  ///< Dropped: queue full, bus-off, switched off.
  std::uint64_t rx_packets = 0, rx_bytes = 0;
  std::uint64_t bus_errors = 0, arbit_lost = 0, error_warn = 0, error_pass = 0, bus_off = 0, re_started = 0;
};

/// What a CAN controller has found wrong.
enum class BusError : std::uint8_t { kBit0, kBit1, kStuff, kForm, kCrc, kAck };

/// One CAN controller: transmit queue, fault confinement, and the protocol bit by bit (ISO 11898-1).
///
/// The bus calls drive() for each bit, and then sample() with what was on the wire. While the bus is undisturbed it
/// does not go bit by bit, and uses finish_sent() and count_received() instead, which do the same in one step.
class BusNode {
 public:
  /// @param number  0..63.  @param restart_after  from bus-off to the start of recovery; nothing: on order only.
  BusNode(std::size_t number, std::size_t tx_queue, TxOrder order, std::optional<Nanos> restart_after,
          BusListener& listener);

  [[nodiscard]] bool send(Instant now, const can::CanFrame& frame);
  /// What it offers to the bus from `at` on; null: nothing.
  [[nodiscard]] const Pending* head(Instant at) const;
  /// A frame that it always has to send, whatever is queued. Nothing: stops that.
  void babble(const std::optional<can::CanFrame>& frame);

  /// Takes part in one bit that begins at `at`. @returns true if it drives the wire dominant.
  [[nodiscard]] bool drive(Instant at);
  /// Sees the level of the bit that it has driven, which ends at `at`.
  void sample(Instant at, bool recessive);
  /// The frame that was complete with the last sample: received, or sent.
  [[nodiscard]] bool has_received() const { return has_received_; }
  [[nodiscard]] const std::optional<Pending>& has_sent() const { return has_sent_; }
  [[nodiscard]] const can::CanFrame& received() const { return reader_.frame(); }
  [[nodiscard]] Instant started_at() const { return started_at_; }
  void forget_news() {
    has_received_ = false;
    has_sent_.reset();
  }

  /// Its frame has crossed without any disturbance. Then comes the interframe space.
  void finish_sent(Instant at, const Pending& pending);
  /// So many frames of others have. @pre below the warning level, so that no change of state is due.
  void count_received(std::uint64_t packets, std::uint64_t bytes);
  void count_arbitrations_lost(std::uint64_t times) { counters_.arbit_lost += times; }

  /// Bus-off by order, as if its transmit error counter had run over.
  void force_bus_off(Instant at);
  /// Leaves bus-off at this instant; no effect in any other state.
  void restart_at(Instant at);
  /// Begins to wait for 128 x 11 recessive bits if it is time to.
  void restart_if_due(Instant now);
  /// Off: silent and deaf, forgets its queue. On again: counters 0, waits for 11 recessive bits.
  void set_powered(bool on);

  [[nodiscard]] std::size_t number() const { return number_; }
  /// How many more frames its transmit queue takes.
  [[nodiscard]] std::size_t room() const { return queue_.room(); }
  [[nodiscard]] can::ErrorState state() const { return state_; }
  [[nodiscard]] unsigned tec() const { return tec_; }
  [[nodiscard]] unsigned rec() const { return rec_; }
  [[nodiscard]] const NodeCounters& counters() const { return counters_; }
  [[nodiscard]] bool is_idle() const { return phase_ == Phase::kIdle; }
  /// In a frame, an error frame or the interframe space.
  [[nodiscard]] bool is_busy() const { return phase_ >= Phase::kTransmit; }
  /// At the warning level or above it.
  [[nodiscard]] bool is_troubled() const { return level_ != 0; }
  [[nodiscard]] bool is_off() const { return phase_ == Phase::kOff || phase_ == Phase::kBusOff; }
  /// When it leaves bus-off by itself; never() if it does not.
  [[nodiscard]] Instant restart_at() const { return restart_at_; }
  /// The bit that it is sending; null: none.
  [[nodiscard]] const can::WireBit* sending() const;
  [[nodiscard]] std::size_t position() const { return position_; }
  [[nodiscard]] const Pending* sending_frame() const { return sending_; }
  [[nodiscard]] bool is_signalling() const { return phase_ == Phase::kFlag || phase_ == Phase::kAfterFlag; }

 private:
  enum class Phase : std::uint8_t {
    kOff,
    kBusOff,
    kRecovering,
    kIntegrating,
    kIdle,
    kSuspend,
    kTransmit,
    kReceive,
    kFlag,
    kAfterFlag,
    kDelimiter,
    kIntermission,
  };

  void enter(Phase phase) {
    phase_ = phase;
    count_ = 0;
  }
  void begin_transmit(Instant at);
  void begin_receive();
  void sample_transmit(Instant at, bool recessive);
  void sample_receive(Instant at, bool recessive);
  void sample_flag(Instant at, bool recessive);
  void sample_after_flag(Instant at, bool recessive);
  void sample_delimiter(Instant at, bool recessive);
  void sample_intermission(Instant at, bool recessive);
  void sample_recovery(Instant at, bool recessive);
  void handle_verdict(Instant at, FrameReader::Verdict verdict, bool recessive);

  void signal_error(Instant at, BusError error, can::Field field, bool counts = true);
  void begin_flag(bool overload, bool passive);
  void raise(Instant at, unsigned by);
  void raise_tec(Instant at, unsigned by);
  void raise_rec(Instant at, unsigned by);
  void lower_tec(Instant at);
  void lower_rec(Instant at);
  void update_state(Instant at);
  [[nodiscard]] std::uint8_t describe_level() const;
  void enter_bus_off(Instant at);
  void report_error(Instant at, BusError error, can::Field field, bool as_sender);
  void report(Instant at, std::uint32_t error_class, std::uint8_t controller_status);

  std::size_t number_;
  std::optional<Nanos> restart_after_;
  BusListener* listener_;
  TransmitQueue queue_;
  Pending babble_;
  bool babbling_ = false;

  Phase phase_ = Phase::kIdle;
  unsigned count_ = 0;  // Bits in this phase.
  unsigned run_ = 0;    // Equal bits in a row: passive flag, recovery.
  bool run_level_ = false;
  bool transmitter_ = false;   // Of this frame, or of the one whose error is being signalled.
  bool overload_ = false;      // The flag is an overload flag,
  bool passive_flag_ = false;  // or a passive error flag,
  bool unheard_ = false;       // of a passive sender that nobody has acknowledged.
  bool acknowledging_ = false;

  const Pending* sending_ = nullptr;
  can::FrameBits wire_;
  std::size_t position_ = 0;
  Instant started_at_{};
  FrameReader reader_;
  bool has_received_ = false;
  std::optional<Pending> has_sent_;

  can::ErrorState state_ = can::ErrorState::kActive;
  unsigned level_ = 0;  // 0 below the warning level, 1 from it on, 2 passive: what Linux reports changes of.
  unsigned tec_ = 0;
  unsigned rec_ = 0;
  Instant restart_at_ = Instant::never();
  NodeCounters counters_;
};

}  // namespace meltbench::bus
