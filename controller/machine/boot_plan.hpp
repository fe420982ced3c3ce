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

/// What is to be done with a board of this kind:
/// - feeder: set point PDO, report at every SYNC; flow on loss of master = `safe_flow_kg_per_h`; reads latency and
/// cycle
/// - screw drive: control word PDO (and speed, if the controller moves the screw), position and velocity at every SYNC;
///   reads the encoder's resolution
/// - melt pressure: pressure, status and age at every SYNC (and melt temperature, if viscosity follows it); the unit
///   must be bar; reads digits, sample period and latency
/// - melt camera: front, status and age at every SYNC; the unit must be m; reads digits, period and latency
/// - preconditioner: two set point PDOs; temperature, age and mean flux at every SYNC; reads period and latency
/// - heater: two set point PDOs; temperatures, states and outputs every kZoneReportPeriod; high alarm per zone
[[nodiscard]] BootPlan make_boot_plan(const ControllerSettings& settings, config::BoardKind kind,
                                      double safe_flow_kg_per_h);

/// Zones are slow: so often they are reported and told their set points, to the nearest SYNC.
inline constexpr Nanos kZoneReportPeriod = 100ms;
/// The same in SYNCs, 1..240.
[[nodiscard]] unsigned calc_syncs_per_zone_report(Nanos sync_period);

/// The controller moves the screw itself: it has a sequence or speed changes in its timeline.
[[nodiscard]] bool moves_screw(const ControllerSettings& settings);

/// The write of the feeder's flow on loss of master, for a set point that changes.
[[nodiscard]] canopen::SdoStep make_loss_of_master_step(double flow_kg_per_h);

}  // namespace meltbench::machine
