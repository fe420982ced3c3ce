#pragma once
/// What is asked and written by SDO before a board is started.

#include <cstddef>
#include <optional>
#include <string>
#include <vector>

#include "controller/machine/settings.hpp"
#include "protocols/canopen/manager.hpp"

namespace meltbench::machine {

/// The steps for one board. The first `identity_steps` compare who it is; nothing is written before they have held.
struct BootPlan {
  std::vector<canopen::SdoStep> steps;
  std::size_t identity_steps = 0;
  std::optional<double> screw_rev_per_s;  ///< Drive only: then to be brought to Operation enabled at this speed.
};

/// Boards miss the controller, and the controller misses a board, after so many heartbeats.
inline constexpr int kHeartbeatsMissed = 3;

/// Set point PDO and report at every SYNC; flow on loss of master = `safe_flow_kg_per_h`; reads latency and cycle.
[[nodiscard]] BootPlan make_feeder_plan(const ControllerSettings& settings, double safe_flow_kg_per_h);
/// Control word PDO, position and velocity at every SYNC; reads the encoder's resolution.
[[nodiscard]] BootPlan make_screw_drive_plan(const ControllerSettings& settings);
/// Pressure, status and age at every SYNC; the unit must be bar; reads digits, sample period and latency.
[[nodiscard]] BootPlan make_melt_pressure_plan(const ControllerSettings& settings);

/// The write of the feeder's flow on loss of master, for a set point that changes.
[[nodiscard]] canopen::SdoStep make_loss_of_master_step(double flow_kg_per_h);

}  // namespace meltbench::machine
