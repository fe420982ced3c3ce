#pragma once
/// What stands behind the boards: one of the bench's extruders, with its own truth for the recording.

#include <span>

#include "plant_emulator/board/board.hpp"
#include "plant_emulator/model/polymer.hpp"
#include "protocols/participant/participant.hpp"

namespace meltbench::emulator {

/// How the process differs from what the rig says.
struct Disturbance {
  double viscosity_factor = 1.0;
  double density_factor = 1.0;
  double melting_point_shift_K = 0.0;
  double nozzle_open = 1.0;  ///< Share of the nozzle's conductance that is left.
  bool operator==(const Disturbance&) const = default;
};

/// An extruder that the emulator moves from touch to touch of its boards.
class Plant : public board::Process {
 public:
  /// Moves on to the instant `to`; earlier than now does nothing.
  virtual void advance_to(Instant to) = 0;
  /// Called at the end of a wake-up: all that is due has been done up to `now`.
  virtual void settle(Instant /*now*/) {}

  /// The model's own truth, which no board shows: names with their SI unit.
  [[nodiscard]] virtual std::span<const SignalInfo> signals() const = 0;
  /// As of the last settle(), in the order of signals().
  virtual void read_signals(std::span<double> values) const = 0;

  /// The barrel holds another polymer from now on. Plants that know but one take no notice.
  virtual void change_polymer(const plant::Polymer& /*polymer*/) {}

  /// From now on; the default takes it back. Plants without a nozzle take no notice.
  virtual void disturb(const Disturbance& /*disturbance*/) {}

  /// Says what has happened to the material since the last call.
  virtual void report(Instant now, Outbox& out) = 0;
};

}  // namespace meltbench::emulator
