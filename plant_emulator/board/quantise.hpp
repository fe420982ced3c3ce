#pragma once
/// Numbers as converters and registers have them.

#include <cstdint>

#include "protocols/time/instant.hpp"

namespace meltbench::board {

/// Nearest multiple of `step`; 0 leaves the value as it is.
[[nodiscard]] double quantise(double value, double step);

/// A span as a count of `unit`, rounded, held within 0..0xFFFF: ages on the wire.
[[nodiscard]] std::uint16_t to_age(Nanos age, Nanos unit);

}  // namespace meltbench::board
