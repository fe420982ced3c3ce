#pragma once
/// The controller under test: manager of the bus, and the loops that hold filled length, melting front and zones.

#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "controller/machine/bus_manager.hpp"
#include "controller/machine/feed_control.hpp"
#include "controller/machine/melt_control.hpp"
#include "controller/machine/screw_control.hpp"
#include "controller/machine/sequence.hpp"
#include "controller/machine/serial_master.hpp"
#include "controller/machine/settings.hpp"
#include "controller/machine/zone_control.hpp"
#include "protocols/participant/participant.hpp"

namespace meltbench::machine {

/// | state   | boards                                   | feed, front, zones                             |
/// |---------|------------------------------------------|------------------------------------------------|
/// | off     | not touched                              | the boards' own                                |
/// | booting | reset, checked, configured by SDO        | the boards' own                                |
/// | ready   | Operational, SYNC runs                   | feeder's own; inlet flux off; zones as asked   |
/// | running | Operational                              | asked for by the laws at every SYNC            |
/// | holding | Operational                              | the same, at the hold speed of the sequence    |
/// | safe    | Operational as far as they are alive     | safe feed; heaters and inlet flux off; screw as configured |
/// | fault   | did not all boot: Pre-operational        | the boards' own                                |
///
/// off -> booting -> ready -> running <-> holding; from ready, running and holding any doubt leads to safe; a boot that
/// does not come to its end leads to fault. Out of safe and fault leads the order "start" alone, to booting: all boards
/// are checked and configured anew, for who comes back first is not known to be well.
/// With a sequence, "running" is every phase of it but cold and holding, and the phase says what runs; it then begins
/// from the start.
enum class ControllerState : std::uint8_t { kOff, kBooting, kReady, kRunning, kSafe, kFault, kHolding };
[[nodiscard]] std::string_view text(ControllerState state);

/// Boots the boards, produces SYNC and heartbeat, and at every SYNC turns what the boards measured into set points. It
/// knows the boards by their EDS files only, and runs the loops that these boards make.
///
/// A cycle: SYNC at k * period; the boards answer with what they had sampled by then and how old it is; when all have
/// answered, or half the period is over, the laws are asked and their answers sent at once. A lost answer is no doubt:
/// the laws go on from what is known, by its time stamp. Only what stays away longer than the limits trips.
///
/// Whatever trips is reported once as a fault with a stable code: those of BusManager, those of SerialUnit,
/// link-down, line-down, bus-off, bus-passive, law-refused, zone-stale, sequence-overdue, and those of
/// safety::code_of(). Real time: a cycle allocates nothing but for events.
class Controller final : public Participant {
 public:
  /// @throws std::invalid_argument if a law cannot be made from the settings.
  explicit Controller(ControllerSettings settings);

  [[nodiscard]] std::string_view name() const override { return "controller"; }
  [[nodiscard]] std::span<const std::string> lines() const override { return line_names_; }
  void wake(const Wakeup& in, Outbox& out) override;
  [[nodiscard]] std::span<const SignalInfo> signals() const override { return signals_; }
  void read_signals(std::span<double> values) const override;

  [[nodiscard]] ControllerState state() const { return state_; }

 private:
  void on_link(Instant now, LinkState link, Outbox& out);
  void on_node(Instant now, can::ErrorState state, Outbox& out);
  void restart(Instant now, Outbox& out);
  void refuse_order(Instant now, Outbox& out) const;
  void on_lines(Instant now, std::span<const LinkState> lines, Outbox& out);
  void on_serial(Instant now, const SerialArrival& arrival, Outbox& out);
  void run_lines(Instant now, Outbox& out);
  void make_lines();
  [[nodiscard]] bool are_units_configured() const;
  void on_frame(Instant now, const can::CanFrame& frame, Outbox& out);
  void handle_troubles(Instant now, Outbox& out);
  void join(Instant now);
  void begin(Instant now, Outbox& out);

  void run_timeline(Instant now, Outbox& out);
  void obey(Instant now, const Order& order, Outbox& out);
  void update_safe_flow(Instant now, Outbox& out);
  void tell_safe_flow(Instant now, Outbox& out);

  void close_cycle_if_due(Instant now, Outbox& out);
  [[nodiscard]] bool has_all_samples() const;
  void hand_over_samples();
  [[nodiscard]] std::optional<double> find_coldest_at_melt() const;
  void control(Instant now, Outbox& out);
  [[nodiscard]] std::optional<Trouble> judge(Instant now);
  void run_sequence(Instant now, Outbox& out);
  void control_feed(Instant now, Outbox& out);
  void control_melt(Instant now, Outbox& out);
  void repeat_safe(Instant now, Outbox& out);
  [[nodiscard]] bool are_loops_ready() const;
  [[nodiscard]] bool are_loops_good() const;
  [[nodiscard]] SequenceDemand demand() const;
  [[nodiscard]] Instant next_deadline() const;

  void trip(Instant now, std::string_view code, std::string reason, Outbox& out);
  [[nodiscard]] bool is_up() const;  ///< Ready, running or safe: the boards are Operational.
  [[nodiscard]] bool is_controlling() const;
  [[nodiscard]] std::string describe_safe() const;
  void make_signals();

  ControllerSettings settings_;
  ControllerState state_ = ControllerState::kOff;
  LinkState link_ = LinkState::kUp;
  can::ErrorState node_state_ = can::ErrorState::kActive;
  Instant node_state_since_;
  bool restarted_ = false;  // By order, after a fault.
  bool joined_ = false;     // Started in the middle of a run.
  std::optional<FeedControl> feed_;
  std::optional<MeltControl> melt_;
  std::optional<ZoneControl> zones_;
  std::optional<Sequence> sequence_;
  ScrewControl screw_;
  BusManager bus_;  // After feed_: the plan of its boots needs the safe flow.
  std::vector<std::string> line_names_;
  std::vector<SerialUnit*> units_;      // On all lines.
  std::vector<SerialMaster> masters_;   // In the order of line_names_,
  std::vector<LinkState> line_states_;  // so are these.

  Instant sync_at_;
  Instant cycle_deadline_ = Instant::never();  // never: no cycle is open.
  std::size_t next_order_ = 0;
  double run_rev_per_s_;
  double reaction_s_ = 0.0;
  std::uint64_t samples_missed_ = 0;
  std::vector<SignalInfo> signals_;
};

}  // namespace meltbench::machine
