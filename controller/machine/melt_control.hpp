#pragma once
/// The melting front on the bus: frames of melt camera and preconditioner to samples, and the law's request to PDOs.

#include <cstddef>
#include <memory>
#include <optional>

#include "controller/machine/bus_manager.hpp"
#include "controller/machine/melt_loop.hpp"
#include "controller/machine/settings.hpp"
#include "controller/machine/trouble.hpp"
#include "protocols/participant/participant.hpp"

namespace meltbench::machine {

/// Per cycle: take() frames until is_complete() or the time is up, close_cycle(), then control() or rest().
/// Real time: no allocation but for events and a change of material.
class MeltControl {
 public:
  /// @throws std::invalid_argument if law or observer cannot be made from the settings. @pre settings.melt.
  explicit MeltControl(const ControllerSettings& settings);

  /// All boards are configured: takes over what they said about themselves.
  void connect(const BusManager& bus);

  /// @returns true if the frame was for it.
  bool take(const can::CanFrame& frame, Instant sync_at);
  [[nodiscard]] bool is_complete() const { return front_ && inlet_ && flux_; }
  /// Hands the samples over to the loop; nothing for T: not measured. @returns how many were missing.
  /// @param T_coldest_degC  the coldest that touches the melt.
  unsigned close_cycle(double screw_speed_m_per_s, std::optional<double> T_barrel_degC,
                       std::optional<double> T_coldest_degC);

  [[nodiscard]] bool is_ready() const { return loop_->is_ready(); }
  /// The loop runs on fresh measurements.
  [[nodiscard]] bool is_measured_well() const;
  /// Asks the law and tells the preconditioner. @returns why the front must be let go.
  [[nodiscard]] std::optional<Trouble> control(Instant sync_at, Outbox& out);
  /// Flux off, the loop starts anew with the next control(); repeated every cycle, for the board's watchdog.
  void rest(Outbox& out);

  void set_front(double front_set_m);
  void set_material(const MaterialSettings& material);

  [[nodiscard]] const MeltLoop& loop() const { return *loop_; }

 private:
  void make_loop() { loop_ = std::make_unique<MeltLoop>(melt_, facts_, sync_period_); }

  MeltSettings melt_;
  MeltFacts facts_;
  Nanos sync_period_;
  std::uint8_t camera_id_;
  std::uint8_t preconditioner_id_;
  double metres_per_count_ = 1e-6;
  std::unique_ptr<MeltLoop> loop_;
  std::optional<FrontSample> front_;  // Since the last cycle was closed.
  std::optional<InletSample> inlet_;
  std::optional<double> flux_;
};

}  // namespace meltbench::machine
