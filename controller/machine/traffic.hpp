#pragma once

#include <vector>

#include "controller/machine/settings.hpp"
#include "protocols/can/frame.hpp"

namespace meltbench::machine {

/// A frame that comes again and again on the bus of a machine in operation.
struct PlannedFrame {
  enum class Cause : std::uint8_t {
    kTimer,  ///< Of its sender alone: SYNC, heartbeats.
    kSync,   ///< Answers a SYNC: TPDOs.
    kCycle,  ///< The controller's set points, once it has what the boards have measured: RPDOs.
  };
  can::CanFrame frame;  ///< Identifier and length; the data are zero.
  Nanos period{};       ///< Shortest time between two of them.
  Cause cause{};
};

/// What a controller with these settings, and the boards that it configures, send in operation: SYNC, PDOs, heartbeats.
/// Not in it, because they have no period: NMT and SDO (of the boot, and of rare later writes), EMCY.
[[nodiscard]] std::vector<PlannedFrame> plan_traffic(const ControllerSettings& settings);

}  // namespace meltbench::machine
