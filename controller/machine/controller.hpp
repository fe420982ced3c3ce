#pragma once
/// The controller under test: manager of the bus, and the loop that holds the filled length.

#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "controller/machine/length_loop.hpp"
#include "controller/machine/node_boot.hpp"
#include "controller/machine/settings.hpp"
#include "protocols/canopen/emcy.hpp"
#include "protocols/canopen/heartbeat.hpp"
#include "protocols/canopen/manager.hpp"
#include "protocols/participant/participant.hpp"

namespace meltbench::machine {

/// | state   | boards                                   | feed                                     |
/// |---------|------------------------------------------|------------------------------------------|
/// | off     | not touched                              | the feeder's own                         |
/// | booting | reset, checked, configured by SDO        | the feeder's own                         |
/// | ready   | Operational, SYNC runs                   | the feeder's own                         |
/// | running | Operational                              | asked for by the law at every SYNC       |
/// | safe    | Operational as far as they are alive     | safe feed, at every SYNC; screw as configured |
/// | fault   | did not all boot: Pre-operational        | the feeder's own                         |
///
/// Safe and fault last until the controller is started again: who comes back first is not known to be well.
enum class ControllerState : std::uint8_t { kOff, kBooting, kReady, kRunning, kSafe, kFault };
[[nodiscard]] std::string_view text(ControllerState state);

/// Boots the boards, produces SYNC and heartbeat, and at every SYNC turns what the boards measured into a set point of
/// the feeder. It knows the boards by their EDS files only.
///
/// A cycle: SYNC at k * period; the boards answer with what they had sampled by then and how old it is; when all three
/// have answered, or half the period is over, the law is asked and its answer sent at once. A lost answer is no doubt:
/// the law goes on from what is known, by its time stamp. Only what stays away longer than the limits trips.
///
/// Whatever trips is reported once as a fault with a stable code: boot-timeout, identity-mismatch,
/// configuration-failed, heartbeat-lost, node-reset, node-not-operational, emcy, link-down, law-refused, and those of
/// safety::code_of(). Real time: a cycle allocates nothing but for events.
class Controller final : public Participant {
 public:
  /// @throws std::invalid_argument if the law cannot be made from the settings.
  explicit Controller(ControllerSettings settings);

  [[nodiscard]] std::string_view name() const override { return "controller"; }
  void wake(const Wakeup& in, Outbox& out) override;
  [[nodiscard]] std::span<const SignalInfo> signals() const override;
  void read_signals(std::span<double> values) const override;

  [[nodiscard]] ControllerState state() const { return state_; }

 private:
  enum Board : std::size_t { kFeeder, kScrewDrive, kMeltPressure, kBoardCount };

  void start(Instant now, Outbox& out);
  void on_link(Instant now, LinkState link, Outbox& out);
  void on_frame(Instant now, const can::CanFrame& frame, Outbox& out);
  [[nodiscard]] bool take_sample(const can::CanFrame& frame);
  void on_node_control(Instant now, const can::CanFrame& frame, Outbox& out);
  void on_emcy(Instant now, const canopen::ReceivedEmcy& received, Outbox& out);
  void on_heartbeat(Instant now, const canopen::HeartbeatEvent& event, Outbox& out);

  void run_boot(Instant now, Outbox& out);
  void start_nodes(Instant now, Outbox& out);
  [[nodiscard]] BoardFacts collect_facts() const;
  void send_heartbeat_if_due(Instant now, Outbox& out);
  void run_set_points(Instant now, Outbox& out);
  void run_feeder_writes(Instant now, Outbox& out);
  void send_sync_if_due(Instant now, Outbox& out);
  void close_cycle_if_due(Instant now, Outbox& out);
  void hand_over_samples();
  void control(Instant now, Outbox& out);
  [[nodiscard]] safety::Observation observe(Instant now) const;
  [[nodiscard]] Instant next_deadline() const;

  void trip(Instant now, std::string_view code, std::string reason, Outbox& out);
  void send_flow(Instant now, double flow_kg_per_s, Outbox& out);
  [[nodiscard]] bool is_up() const;  ///< Ready, running or safe: the boards are Operational.
  [[nodiscard]] const BoardSettings& board(std::size_t index) const;
  [[nodiscard]] std::size_t find_board(std::uint32_t node_id) const;  ///< kBoardCount if it is none of ours.
  [[nodiscard]] std::string label(std::size_t index) const;           ///< "feeder (node 5)".
  [[nodiscard]] double set_point_m() const { return settings_.set_points[set_point_].x_m; }
  [[nodiscard]] double safe_flow_kg_per_s() const;

  ControllerSettings settings_;
  ControllerState state_ = ControllerState::kOff;
  LinkState link_ = LinkState::kUp;
  std::vector<NodeBoot> boots_;  // In the order of Board.
  canopen::HeartbeatConsumer heartbeats_;
  canopen::PeriodicTimer heartbeat_timer_;
  canopen::PeriodicTimer sync_timer_;
  std::unique_ptr<LengthLoop> loop_;

  Instant ready_at_;
  Instant sync_at_;
  Instant cycle_deadline_ = Instant::never();  // never: no cycle is open.
  std::optional<ScrewSample> screw_;           // Since the last cycle was closed.
  std::optional<FeedSample> feed_;
  std::optional<PressureSample> pressure_;
  std::size_t set_point_ = 0;  // Index of the one in force.

  LengthCommand command_;
  double reaction_s_ = 0.0;
  std::uint64_t heartbeats_lost_ = 0;
  std::uint64_t samples_missed_ = 0;
  std::uint64_t emcys_ = 0;
  bool history_warned_ = false;
};

}  // namespace meltbench::machine
