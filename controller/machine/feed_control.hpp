#pragma once
/// The filled length on the wire: reports of feeder and melt pressure to samples, and the law's answer to a set point.

#include <cstddef>
#include <memory>
#include <optional>
#include <vector>

#include "controller/machine/bus_manager.hpp"
#include "controller/machine/feeder_wire.hpp"
#include "controller/machine/length_loop.hpp"
#include "controller/machine/sequence.hpp"
#include "controller/machine/settings.hpp"
#include "controller/machine/trouble.hpp"
#include "protocols/participant/participant.hpp"

namespace meltbench::machine {

/// Per cycle: take() frames until is_complete() or the time is up, close_cycle(), then one of control(), feed() and
/// go_safe() or none of them, end_cycle(). Real time: no allocation but for events.
class FeedControl {
 public:
  /// @throws std::invalid_argument if the law cannot be made from the settings.
  explicit FeedControl(const ControllerSettings& settings);

  /// All boards are configured: takes over what they said about themselves.
  void connect(const BusManager& bus);
  [[nodiscard]] FeederWire& feeder() { return *feeder_; }

  /// @returns true if the frame was for it.
  bool take(const can::CanFrame& frame, Instant sync_at);
  [[nodiscard]] bool is_complete() const { return pressure_ && (feeder_->has_sample() || !feeder_->reports_at_sync()); }
  /// Hands the samples over to the loop. @returns how many were missing.
  unsigned close_cycle(const std::optional<ScrewSample>& screw);

  [[nodiscard]] bool is_ready() const { return loop_->is_ready(); }
  /// The newest pressure is one of this extruder.
  [[nodiscard]] bool is_measured_well() const { return loop_->is_ready() && !loop_->implausible_since(); }
  [[nodiscard]] safety::Observation observe(Instant now, Instant ready_at) const;

  /// Asks the law. @returns why it refuses.
  [[nodiscard]] std::optional<Trouble> control(Instant sync_at, Instant now, Outbox& out);
  /// Nothing, or what holds the set point at the screw's speed of now. @pre mode is not kLaw.
  void feed(FeedMode mode, Instant now, Outbox& out);
  /// The feed of the safe state; repeated every cycle, for the feeder's watchdog.
  void go_safe(Instant now, Outbox& out);
  void end_cycle(Instant now) { feeder_->end_cycle(now); }
  /// Commands that have left the controller since: the feed on its way.
  void note_sent();
  void tell_safe_flow(Instant now, BusManager& bus, Outbox& out) {
    feeder_->set_safe_flow(now, safe_flow_kg_per_s(), bus, out);
  }

  /// After a fault: the laws begin with what the feeder delivers, without a bump.
  void start_from_feed() { loop_->start_from_feed(); }

  /// Another polymer is in the screw: model, and laws that begin anew.
  void set_material(const MaterialSettings& material);
  void start_empty() { loop_->start_empty(); }
  void stop() { loop_->stop(); }

  /// Of the timeline. The configured one stays. @pre before connect().
  void forget_set_points_before(Instant now);
  /// @returns true if another set point is in force now.
  bool run_set_points(Instant now);
  [[nodiscard]] Instant next_set_point() const;
  /// Speed and feed that the safe state refers to. @returns true if the safe flow has changed.
  bool set_safe(double speed_m_per_s, bool feeds);
  [[nodiscard]] double safe_flow_kg_per_s() const;
  [[nodiscard]] double set_point_m() const { return set_points_[set_point_].x_m; }

  [[nodiscard]] const LengthLoop& loop() const { return *loop_; }
  [[nodiscard]] const LengthCommand& command() const { return command_; }
  [[nodiscard]] std::optional<double> T_melt_degC() const { return T_melt_degC_; }

 private:
  void make_loop();
  void send_flow(Instant now, double flow_kg_per_s, Outbox& out);
  [[nodiscard]] double calc_safe_now_kg_per_s(Instant now) const;
  void check_echo(const FeedSample& sample);

  ControllerSettings settings_;
  std::vector<SetPoint> set_points_;
  std::size_t set_point_ = 0;  // Index of the one in force.
  std::uint8_t pressure_id_;
  BoardFacts facts_;
  std::unique_ptr<LengthLoop> loop_;
  std::unique_ptr<FeederWire> feeder_;
  std::optional<PressureSample> pressure_;  // Since the last cycle was closed.
  std::optional<double> T_melt_degC_;
  LengthCommand command_;
  double safe_speed_m_per_s_;
  bool safe_feeds_;
  bool history_warned_ = false;
  std::optional<double> last_asked_kg_per_s_;
  std::optional<Instant> unechoed_since_;
};

}  // namespace meltbench::machine
