#pragma once

#include <deque>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "bench/bus/bit_timed_bus.hpp"
#include "protocols/config/rig.hpp"
#include "protocols/participant/participant.hpp"

namespace meltbench::bus {

/// Settings of the bus that [bus] of a rig describes.
[[nodiscard]] BitTimedSettings to_settings(const config::RigBus& bus);

/// By how much the clock of a node's CAN controller is too fast.
struct ClockDrift {
  std::string node;
  double ppm = 0;
};

/// Hears what a medium does to the participants of a run.
class MediumListener {
 public:
  virtual ~MediumListener() = default;
  /// A frame has crossed. @param sender  number of the participant, or kTapSender, kOutsideSender.
  /// @param heard_by  bit n: participant n gets it; its own sender too, if that has further nodes on the bus.
  virtual void on_crossed(const can::StampedFrame& frame, std::size_t sender, std::uint64_t heard_by) = 0;
  /// An error frame for the recording, as the CAN controller of one of the participant's nodes reports it.
  virtual void on_error_frame(const can::StampedFrame& error, std::size_t participant) = 0;
  /// A node of this participant has changed its state.
  virtual void on_node_state(std::size_t participant, const Event& event) = 0;
};

/// How long frames of one identifier took on the bus.
struct ResponseTally {
  std::uint32_t id = 0;
  bool extended = false;
  std::size_t node = 0;  ///< That sent the last one.
  std::uint64_t frames = 0;
  Nanos sum_delay{}, worst_delay{};        ///< From queued to the start of frame that came through.
  Nanos sum_response{}, worst_response{};  ///< From queued to the last bit of end of frame.
};

/// The nodes of all participants on one bit-timed bus.
///
/// What a full transmit queue refuses is lost and counted if the participant names its nodes: those are boards, and a
/// board has no more than its mailboxes. For one that does not (a program behind a kernel's driver) it waits in order
/// until there is room. What a node sends that is bus-off is lost and counted.
///
/// Of one disturbance the recording gets one error frame: that of the node which reports it first.
class BitTimedMedium final : private BusListener {
 public:
  /// A participant's names on the bus; empty nodes: one node, by the participant's own name.
  struct Member {
    std::string_view name;
    std::span<const std::string> nodes;
  };
  /// Two nodes that nobody owns: one for programs outside the run, without power until a frame comes from there, and
  /// one for devices that a fault plugs in.
  static constexpr std::string_view kStranger = "stranger";
  static constexpr std::string_view kTwin = "twin";

  /// @param members  by number of the participant; 62 nodes at most.  @param listener  outlives the medium.
  /// @throws std::invalid_argument for more nodes.
  BitTimedMedium(const BitTimedSettings& settings, std::span<const Member> members, MediumListener& listener);

  /// Queues a frame. @param own_node  as Outbox::speak_as() has it.
  void send(Instant now, std::size_t participant, std::size_t own_node, const can::CanFrame& frame);
  /// Queues a frame of a program outside the run.
  void send_from_outside(Instant now, const can::CanFrame& frame);
  /// How many of those its transmit queue takes now.
  [[nodiscard]] std::size_t room_for_outside();
  /// The node of devices that a fault plugs in: gets or loses its power; queues a frame, or loses it; has a CAN
  /// controller that receives.
  void plug_twin(Instant now, bool in);
  void send_for_twin(Instant now, const can::CanFrame& frame) { static_cast<void>(bus_.send(now, twin(), frame)); }
  [[nodiscard]] bool hears_twin() { return !bus_.node(twin()).is_off(); }
  [[nodiscard]] Instant next_event() const { return bus_.next_event(); }
  void advance(Instant to) { bus_.advance(to); }

  /// States of a participant's nodes, in their order.
  [[nodiscard]] std::span<const can::ErrorState> states(std::size_t participant) const;
  [[nodiscard]] std::uint64_t lost_frames() const { return lost_frames_; }

  /// From the beginning on. Names of nodes that are not there are passed over.
  void set_clock_drifts(std::span<const ClockDrift> drifts);

  /// For faults.
  [[nodiscard]] BitTimedBus& bus() { return bus_; }
  /// @returns kNoNode if there is no node of that name.
  [[nodiscard]] std::size_t find_node(std::string_view name) const;

  [[nodiscard]] const std::vector<std::string>& node_names() const { return names_; }
  /// Standard before extended, then by identifier.
  [[nodiscard]] const std::vector<ResponseTally>& responses() const { return responses_; }

 private:
  void on_delivery(const Delivery& delivery) override;
  void on_error(Instant at, std::size_t node, const can::CanFrame& error) override;
  void on_state(Instant at, std::size_t node, can::ErrorState state) override;
  void count(const Delivery& delivery);
  [[nodiscard]] std::size_t stranger() const { return names_.size() - 2; }
  [[nodiscard]] std::size_t twin() const { return names_.size() - 1; }
  void send_waiting(Instant now, std::size_t participant);

  struct Membership {
    std::size_t first_node = 0;
    std::size_t node_count = 1;
    bool keeps_refused = false;
    std::deque<can::CanFrame> refused;
  };

  MediumListener& listener_;
  std::vector<Membership> members_;
  std::vector<std::string> names_;       // Of the nodes,
  std::vector<std::size_t> owners_;      // their participants,
  std::vector<can::ErrorState> states_;  // and their states.
  Nanos bit_time_;
  Instant last_error_at_ = Instant::never();
  std::uint64_t lost_frames_ = 0;
  std::vector<ResponseTally> responses_;
  BitTimedBus bus_;
};

}  // namespace meltbench::bus
