#pragma once
/// The controller as the manager of its bus: boots the boards, produces heartbeat and SYNC, and watches who is alive.

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "controller/machine/node_boot.hpp"
#include "controller/machine/settings.hpp"
#include "controller/machine/trouble.hpp"
#include "controller/safety/pace_watch.hpp"
#include "protocols/canopen/emcy.hpp"
#include "protocols/canopen/heartbeat.hpp"
#include "protocols/canopen/manager.hpp"
#include "protocols/participant/participant.hpp"

namespace meltbench::machine {

/// Any set of boards on CAN. All are configured at once; the first that cannot be ends the boot for all, and when the
/// last is configured all are started together.
///
/// Whatever is wrong becomes a Trouble with one of the codes boot-timeout, identity-mismatch, configuration-failed,
/// heartbeat-lost, node-reset, node-not-operational, node-doubled, emcy; what is survived is reported as an event.
/// Real time: a cycle allocates nothing but for events.
class BusManager {
 public:
  enum class Phase : std::uint8_t { kOff, kBooting, kUp, kFailed };

  /// @param safe_flow_kg_per_h  the feeder's, on loss of master.
  BusManager(const ControllerSettings& settings, double safe_flow_kg_per_h);

  /// Resets all boards and begins to boot them; also once more, after a fault.
  void start(Instant now, Outbox& out);
  /// Whatever is no sample of a board: EMCY, SDO, boot-up and heartbeat.
  void on_frame(Instant now, const can::CanFrame& frame, Outbox& out);
  /// Boot, lost heartbeats, later writes.
  /// @param others_ready  the boards that are not on CAN are configured, too: start all together.
  /// @returns true once: all boards have just been started.
  bool on_time(Instant now, bool others_ready, Outbox& out);
  /// The boot has failed elsewhere.
  void give_up() { phase_ = Phase::kFailed; }
  void send_heartbeat_if_due(Instant now, Outbox& out);
  /// @returns true if a SYNC was sent.
  bool send_sync_if_due(Instant now, Outbox& out);

  /// What has gone wrong, oldest first; nothing more: nothing.
  [[nodiscard]] std::optional<Trouble> take_trouble();

  [[nodiscard]] Phase phase() const { return phase_; }
  [[nodiscard]] Instant ready_at() const { return ready_at_; }
  [[nodiscard]] Instant next_deadline() const;
  /// The board's boot, to read what it said about itself or to write to it later. @pre the rig has one.
  [[nodiscard]] NodeBoot& boot(config::BoardKind kind);
  [[nodiscard]] const NodeBoot& boot(config::BoardKind kind) const;
  [[nodiscard]] std::size_t board_count() const { return boots_.size(); }

  [[nodiscard]] std::uint64_t sdo_timeouts() const;
  [[nodiscard]] std::uint64_t heartbeats_lost() const { return heartbeats_lost_; }
  [[nodiscard]] std::uint64_t emcys() const { return emcys_; }
  [[nodiscard]] std::uint64_t syncs_missed() const { return sync_timer_.missed(); }

 private:
  bool run_boot(Instant now, bool others_ready, Outbox& out);
  void start_nodes(Instant now, Outbox& out);
  void run_later_writes(Instant now, Outbox& out);
  void on_node_control(Instant now, const can::CanFrame& frame, Outbox& out);
  void on_emcy(Instant now, const canopen::ReceivedEmcy& received, Outbox& out);
  void on_heartbeat(Instant now, const canopen::HeartbeatEvent& event, Outbox& out);
  void complain(std::string_view code, std::string text) { troubles_.push_back({code, std::move(text)}); }
  [[nodiscard]] std::size_t find_node(std::uint32_t node_id) const;  ///< board_count() if it is none of ours.
  [[nodiscard]] std::size_t index_of(config::BoardKind kind) const;
  [[nodiscard]] std::string label(std::size_t index) const;  ///< "feeder (node 5)".

  std::uint8_t node_id_;
  Nanos heartbeat_;
  Nanos sync_period_;
  std::vector<BoardSettings> boards_;
  std::vector<NodeBoot> boots_;  // In the order of boards_.
  Phase phase_ = Phase::kOff;
  Instant ready_at_;
  canopen::HeartbeatConsumer heartbeats_;
  std::vector<safety::PaceWatch> paces_;  // Of those heartbeats, in the order of boards_, while they run.
  canopen::PeriodicTimer heartbeat_timer_;
  canopen::PeriodicTimer sync_timer_;
  std::vector<Trouble> troubles_;
  std::uint64_t heartbeats_lost_ = 0;
  std::uint64_t emcys_ = 0;
};

}  // namespace meltbench::machine
