#pragma once
/// A CAN bus in bit times: lengths, arbitration, acknowledgement, errors and their confinement (ISO 11898-1).

#include <cstdint>
#include <optional>
#include <vector>

#include "bench/bus/bus_node.hpp"

namespace meltbench::bus {

struct BitTimedSettings {
  Nanos bit_time{2'000};       ///< > 0.
  Nanos data_bit_time{2'000};  ///< > 0: of FD frames with bit rate switch.
  std::size_t tx_queue = 10;   ///< 1..65535 frames per node; Linux's txqueuelen of a CAN interface.
  TxOrder tx_order = TxOrder::kPriority;
  std::optional<Nanos> restart_after{};  ///< Bus-off to the start of recovery, Linux's restart-ms; nothing: on order.
};

/// What is wrong with the two wires.
enum class WireState : std::uint8_t {
  kGood,
  kShorted,        ///< To each other: always recessive.
  kStuckDominant,  ///< Held dominant.
};

/// Inverts one bit of frames: on the wire, or in the ear of one node only.
struct BitFlip {
  std::uint32_t id = 0;            ///< Frames whose identifier equals this one
  std::uint32_t mask = 0;          ///< in these bits; 0: any frame.
  std::size_t bit = 0;             ///< Counted on the wire from start of frame = 0, stuff bits counted.
  std::uint64_t frames = 1;        ///< So many of them, retransmissions counted.
  std::size_t listener = kNoNode;  ///< Only this node sees it inverted; kNoNode: all.
  double probability = 1.0;        ///< That a frame that matches is hit, drawn when it comes to the bit.
  std::uint64_t seed = 0;          ///< Of these draws.
  std::size_t number = 0;          ///< For end_flips().
};

/// The bus. Pure: time is told to it.
///
/// What all see is the wired AND of what all drive, bit after bit, each node its own state machine (BusNode). As long
/// as nothing disturbs (one sender with the smallest identifier, somebody to acknowledge, wires good, no noise in this
/// frame, every node in step), the result of a whole frame is known at its start: then it is one event instead of a
/// hundred bits, and gives the same times and counters; a test compares the two.
///
/// Simplifications, all of them below what a bench can see: no propagation delay and no sample point; a node that
/// queues while another one's start of frame is on the wire waits for the next round; after an error in the data phase
/// of an FD frame all nodes count at the nominal rate at once; a change of the wires during the three bits of
/// interframe space is felt at their end. Receivers are told of a frame when its end of frame is over (not one bit
/// earlier, when it becomes valid for them). Noise hits frames, not the idle bus. Remote nodes that do not know FD do
/// not exist.
///
/// Cost: README, "How fast, how exact". No allocation after the constructor.
class BitTimedBus {
 public:
  /// @param nodes  1..64.  @param listener  outlives the bus; hears everything from within advance() and the orders
  /// below.
  BitTimedBus(const BitTimedSettings& settings, std::size_t nodes, BusListener& listener);

  /// Queues a frame. @pre now not before any earlier call; frame valid, no error frame.
  /// @returns false if the queue is full (ENOBUFS) or the node is bus-off or switched off (ENETDOWN): it is dropped,
  /// and counted.
  bool send(Instant now, std::size_t node, const can::CanFrame& frame);

  /// When something can happen next if nobody sends; never() if nothing can. advance() is needed then.
  [[nodiscard]] Instant next_event() const;
  /// Lets everything happen that is due up to and including `to`. Who sends at `to` must have done so: an idle bus
  /// begins its next frame with this call.
  void advance(Instant to);

  /// Orders, at an instant to which the bus has been advanced. They hold until they are taken back.
  void set_wire(Instant now, WireState wire);
  /// Cut off: the node sees nothing but itself.
  void set_cut_off(Instant now, std::size_t node, bool cut_off);
  /// The node's clock runs `divider` times as slow as that of the others. 1 = right.
  void set_bit_rate_divider(Instant now, std::size_t node, unsigned divider);
  /// The node's clock is off by so much; stretches its frames. @param ppm  -5000..5000, positive = too fast.
  void set_clock_drift(Instant now, std::size_t node, double ppm);
  /// The node has this frame to send again as soon as it is through with it.
  void set_babble(Instant now, std::size_t node, const std::optional<can::CanFrame>& frame);
  void set_powered(Instant now, std::size_t node, bool on);
  /// Every bit of a frame on the wire is inverted with this probability, 0..1.
  void set_noise(Instant now, double bit_error_rate, std::uint64_t seed);
  void flip(Instant now, const BitFlip& flip);
  /// Ends all flips of this number.
  void end_flips(Instant now, std::size_t number);
  void force_bus_off(Instant now, std::size_t node);
  /// Ends bus-off by hand; the recovery of 128 x 11 recessive bits follows.
  void restart(Instant now, std::size_t node);

  [[nodiscard]] std::size_t node_count() const { return nodes_.size(); }
  /// A node with its counters brought up to date. Counting is put off, so that a frame costs the same for 8 and 64
  /// nodes.
  [[nodiscard]] const BusNode& node(std::size_t number);
  /// Time for which the wire was not idle (start of frame to interframe space, error frames), up to now.
  [[nodiscard]] Nanos busy() const { return busy_; }

 private:
  /// What the bus is doing.
  enum class Mode : std::uint8_t { kQuiet, kFrame, kBits };
  struct Flight {
    std::size_t sender = 0;
    const Pending* pending = nullptr;
    Instant start, end;
    std::uint64_t bits = 0;
  };
  /// What a node has still to count.
  struct Tally {
    std::uint64_t own_packets = 0, own_bytes = 0;  ///< Of those that have crossed: sent by itself.
    std::uint64_t waiting_from = 0;                ///< While it waits: number of the first round that it takes part in.
  };
  struct Tuning {
    unsigned divider = 1;
    std::uint64_t in_step_at = 0;  ///< Number of a bus bit with which one of its own began.
    bool cut_off = false;
    double drift_ppm = 0;
    [[nodiscard]] bool matters() const { return cut_off || divider != 1; }
  };

  void interrupt(Instant now);
  void leave_quiet(Instant now);
  void arbitrate(Instant at);
  [[nodiscard]] bool is_plain(const Flight& flight, bool collides) const;
  void finish_frame();
  void begin_bits(Instant at);
  void step();
  [[nodiscard]] bool resolve_wire() const;
  [[nodiscard]] bool hit_by_noise();
  [[nodiscard]] std::uint64_t apply_flips(std::size_t sender);
  void sample_nodes(bool recessive, std::uint64_t misheard);
  void tell_received();
  void begin_next_bit();
  void look_at_nodes();
  void note_head(std::size_t node);
  void count_up();
  [[nodiscard]] std::size_t find_sender() const;
  void draw_noise();
  [[nodiscard]] Nanos stretch(Nanos span, std::size_t sender) const;

  BitTimedSettings settings_;
  BusListener* listener_;
  std::vector<BusNode> nodes_;
  std::vector<Tuning> tuning_;
  std::vector<std::uint64_t> keys_;  // Of what each node offers; kNothing: nothing.

  Mode mode_ = Mode::kQuiet;
  Instant free_at_{};        // Quiet: no start of frame before this.
  Instant waiting_since_{};  // Quiet: when the first of those that wait came.
  Flight flight_;

  // Bit n: node n ...
  std::uint64_t waiting_ = 0;   // has something to send,
  std::uint64_t idle_ = 0;      // is in step, and idle when the bus is,
  std::uint64_t troubled_ = 0;  // is at the warning level or above,
  std::uint64_t dominant_ = 0;  // drives dominant.
  Instant next_restart_ = Instant::never();

  std::vector<Tally> tallies_;
  std::uint64_t rounds_ = 0;                               // Arbitrations that led to a frame,
  std::uint64_t crossed_packets_ = 0, crossed_bytes_ = 0;  // since the nodes have counted.

  Instant bit_start_{};  // Bits: of the bit that goes on.
  Instant bit_end_{};
  Instant anchor_{};  // Start of frame, from which its sender's clock is counted.
  Nanos since_anchor_{};
  bool anchored_ = false;  // A sender is connected, and its clock is counted.
  std::uint64_t bit_number_ = 0;
  bool recessive_before_ = true;

  WireState wire_ = WireState::kGood;
  std::vector<BitFlip> flips_;
  double bit_error_rate_ = 0;
  std::uint64_t noise_state_ = 0;
  std::uint64_t bits_to_noise_ = std::numeric_limits<std::uint64_t>::max();
  bool tuned_ = false;  // Some node is cut off or slow.
  Nanos busy_{};
};

}  // namespace meltbench::bus
