#pragma once
/// The screw drive on the bus: its encoder to samples, and where the controller moves the screw, a ramped speed to
/// PDOs.

#include <optional>

#include "controller/machine/bus_manager.hpp"
#include "controller/machine/length_loop.hpp"
#include "controller/machine/settings.hpp"
#include "protocols/participant/participant.hpp"

namespace meltbench::machine {

/// A drive that the controller does not move keeps the speed that the boot has given it.
class ScrewControl {
 public:
  explicit ScrewControl(const ControllerSettings& settings);

  /// All boards are configured: takes over the encoder's resolution.
  void connect(const BusManager& bus);

  /// @returns true if the frame was for it.
  bool take(const can::CanFrame& frame, Instant sync_at);
  [[nodiscard]] bool is_complete() const { return sample_.has_value(); }
  /// The sample of this cycle, once. @returns nothing if it was missing.
  std::optional<ScrewSample> close_cycle();

  /// Wanted speed; reached by the ramp of the settings.
  void set_target(double rev_per_s) { target_rev_per_s_ = rev_per_s; }
  /// Once per cycle: moves the ramp on and tells the drive. Does nothing if the controller does not move the screw.
  void drive(Outbox& out);
  void quick_stop(Outbox& out);
  /// After a boot in the middle of a run: goes on from the speed that the screw is heard to have.
  void resume();
  /// Since when the encoder has shown a speed that is far from what was asked for; nothing: it does not.
  [[nodiscard]] std::optional<Instant> wrong_since() const { return wrong_since_; }

  [[nodiscard]] double speed_m_per_s() const { return speed_m_per_s_; }  ///< As measured.
  [[nodiscard]] Instant measured_at() const { return measured_at_; }
  [[nodiscard]] double demand_rev_per_s() const { return demand_rev_per_s_; }

 private:
  void check_speed(Instant at);

  std::uint8_t node_id_;
  double pitch_m_;
  bool moves_;
  double ramp_rev_per_cycle_;
  double own_speed_rev_per_s_;  // Of a screw that the controller does not move.
  double increments_per_rev_ = 65536.0;
  double target_rev_per_s_ = 0.0;
  double demand_rev_per_s_ = 0.0;
  bool stopped_ = false;
  bool resuming_ = false;  // Until it is heard.
  double speed_m_per_s_ = 0.0;
  Instant measured_at_;
  std::optional<Instant> wrong_since_;
  std::optional<ScrewSample> sample_;
};

}  // namespace meltbench::machine
