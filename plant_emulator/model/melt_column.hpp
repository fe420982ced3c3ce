#pragma once
/// The melting extruder on the bench's axis of time, solved for only when somebody looks.

#include "plant_emulator/model/inlet_flux.hpp"
#include "plant_emulator/model/melt_front.hpp"
#include "protocols/time/instant.hpp"

namespace meltbench::plant {

/// A MeltFront that follows the screw. A solve costs microseconds, and most of what moves or samples elsewhere in the
/// machine does not concern it: so it lags behind, and catches up in one go. Over a lag the speed is the mean one, by
/// what the screw has conveyed; the barrel is held. After a change of the inlet it must have caught up first.
class MeltColumn {
 public:
  static constexpr Nanos kLeastStep = 100us;

  /// @throws as MeltFront.
  MeltColumn(const MeltParameters& parameters, const MeltNumerics& numerics) : melt_{parameters, numerics} {}

  /// To set it up, and to look at the field of solved_to().
  [[nodiscard]] MeltFront& melt() { return melt_; }
  [[nodiscard]] const MeltFront& melt() const { return melt_; }

  /// As if it had been solved to this instant and place, without solving: after a start.
  void place(Instant at, double conveyed_m);
  /// The screw stands: nothing passes the preconditioner, so its flux goes nowhere until the next place().
  void hold(Instant at);
  /// Held, with the sums of a predecessor.
  void resume(Instant at, const InletFlux& flux) {
    flux_ = flux;
    solved_to_ = at;
    hold(at);
  }

  /// Solves up to `to`, when the screw has conveyed `conveyed_m`; less than kLeastStep after solved_to() is not worth
  /// it.
  void catch_up(Instant to, double conveyed_m, const MeltBarrel& barrel) noexcept;
  [[nodiscard]] Instant solved_to() const { return solved_to_; }

  /// From solved_to() on.
  void set_inlet(const MeltInlet& inlet) { inlet_ = inlet; }
  [[nodiscard]] const MeltInlet& inlet() const { return inlet_; }

  /// At an instant from solved_to() on: straight on with the speed of the last step. [m]
  [[nodiscard]] double front_m(Instant at) const;
  /// Up to an instant from solved_to() on, with the flux of the last step.
  [[nodiscard]] InletFlux flux(Instant at) const;

 private:
  [[nodiscard]] bool runs() const { return !held_ && melt_.status() == MeltStatus::kRunning; }

  MeltFront melt_;
  MeltInlet inlet_ = MeltInlet::flux(0);
  Instant solved_to_{};
  double conveyed_m_ = 0;
  bool held_ = false;
  InletFlux flux_;  // Up to solved_to_.
};

}  // namespace meltbench::plant
