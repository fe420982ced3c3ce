#pragma once

#include <cstdint>

namespace meltbench::can {

/// How far a node trusts itself on the bus (ISO 11898-1, fault confinement): error-passive from a counter of 128 on,
/// bus-off from a transmit error counter of 256 on.
enum class ErrorState : std::uint8_t { kActive, kPassive, kBusOff };

}  // namespace meltbench::can
