#pragma once
/// The delay extruder as the boards see it: feed and screw speed in, filled length, flow and pressure out.

#include <variant>

#include "plant_emulator/model/bizone_parameters.hpp"
#include "plant_emulator/model/frozen_delay_plant.hpp"
#include "plant_emulator/model/parcel_plant.hpp"
#include "plant_emulator/model/screw_clock.hpp"
#include "protocols/time/instant.hpp"

namespace meltbench::plant {

/// State and outputs of the extruder at one instant.
struct BizoneOutputs {
  double x_m = 0.0;              ///< Filled length.
  double U = 0.0;                ///< Filling ratio at the inlet, (D1), as much as fits.
  double U_at_interface = 0.0;   ///< Filling ratio of the material that reaches the filled zone now.
  double delay_s = 0.0;          ///< D: since when the material now arriving is under way. 0 when flooded.
  double delay_rate = 0.0;       ///< dD/dt. From 1 on, feed no longer arrives (paper reading only).
  bool feasible = true;          ///< delay_rate < 1: the feasibility condition of [D17] (56), at this instant.
  double speed_m_per_s = 0.0;    ///< c.
  double conveyed_m = 0.0;       ///< s, by the material.
  double encoder_m = 0.0;        ///< s, as an encoder on the screw shows it: without the fluctuation if that is slip.
  double encoder_m_per_s = 0.0;  ///< Its rate.
  double feed_kg_per_s = 0.0;    ///< F_in.
  double flow_kg_per_s = 0.0;    ///< F_d through the nozzle, (D5).
  double pressure_Pa = 0.0;      ///< dP over the nozzle, (D6).
  bool flooded = false;          ///< x = L.
  double spill_m = 0.0;          ///< Feed refused since the start because flooded, metres of full channel.
  double rejected_feed_kg =
      0.0;                       ///< Feed refused since the start because the throat was full or the screw stood still.
  double mass_residual_m = 0.0;  ///< (D12). Transport reading: < 1e-8 m, else a fault. Paper reading: its own error.
};

/// A bizone extruder in either reading of the delay, driven by events.
///
/// The feeder's mass flow is held until it is changed, as a feeder does, so the filling ratio at the inlet varies with
/// the screw, (D1): U = F_in/(rho0 S_eff c). Between two calls of advance_to() steps are split where c changes by more
/// than 0.1 %, and each substep gets the exact mean of U, so that no mass is lost however long the step.
///
/// Starts running, at x0, with v(x0) under way (or BizoneParameters::U_before_start) and the feed that holds x0.
/// Real time: no heap after construction; cost of advance_to() bounded by kMaxSubsteps.
class BizoneExtruder {
 public:
  /// @throws std::invalid_argument as BizoneParameters::check().
  explicit BizoneExtruder(const BizoneParameters& parameters);

  /// Mass flow of the feeder from now() on; negative or NaN counts as 0.
  void set_feed_kg_per_s(double feed_kg_per_s);
  /// Nominal conveying speed theta1 from now() on; negative or NaN counts as 0. At 0 nothing enters, moves or leaves.
  void set_speed_m_per_s(double speed_m_per_s);
  /// The same in turns of the screw: theta1 = xi N.
  void set_screw_rev_per_s(double N_rev_per_s) { set_speed_m_per_s(N_rev_per_s * parameters_.pitch_m); }
  /// Viscosity eta of the melt in the nozzle from now() on. @pre > 0.
  void set_viscosity_Pa_s(double viscosity_Pa_s) { parameters_.viscosity_Pa_s = viscosity_Pa_s; }
  /// Conductance Kd of the nozzle from now() on, and with it theta2. Transport reading only; the paper reading has one
  /// for ever. @pre > 0.
  void set_nozzle_kg(double nozzle_kg);
  /// Density rho0 from now() on, and with it theta2, as set_nozzle_kg(): the channel is as full as before, of another
  /// polymer. @pre > 0.
  void set_density_kg_per_m3(double density_kg_per_m3);

  /// Moves on to the instant `to`; earlier than now() does nothing.
  void advance_to(Instant to);

  [[nodiscard]] Instant now() const { return now_; }
  /// Everything, at now(). About 0.1 us: the delay is solved for here.
  [[nodiscard]] BizoneOutputs outputs() const;
  /// Metres conveyed at now() by the material, (D3).
  [[nodiscard]] double conveyed_m() const { return clock_.conveyed_m(t_); }
  /// Filled length at now() alone.
  [[nodiscard]] double x_m() const;
  /// Position of an encoder on the screw at now() [m of conveyed length].
  [[nodiscard]] double encoder_m() const;
  /// Its rate.
  [[nodiscard]] double encoder_m_per_s() const;
  /// Pressure over the nozzle at now() [Pa].
  [[nodiscard]] double pressure_Pa() const;
  /// As they are now.
  [[nodiscard]] const BizoneParameters& parameters() const { return parameters_; }

  static constexpr int kMaxSubsteps = 256;  ///< Per call of advance_to().

 private:
  void advance_substep(double t_next);
  [[nodiscard]] double flow_kg_per_s() const;
  void read_plant(const ParcelPlant& plant, BizoneOutputs& out) const;
  void read_plant(const FrozenDelayPlant& plant, BizoneOutputs& out) const;

  BizoneParameters parameters_;
  double speed_before_m_per_s_;  // theta1 at t < 0: what entered then moved at this speed.
  ScrewClock clock_;
  std::variant<ParcelPlant, FrozenDelayPlant> plant_;
  Instant now_{};
  double t_ = 0.0;  // now_ in seconds.
  double feed_kg_per_s_;
  double rejected_feed_kg_ = 0.0;
};

}  // namespace meltbench::plant
