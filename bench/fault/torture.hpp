#pragma once
/// Faults by chance: what nobody would have thought of.

#include <cstdint>

#include "protocols/config/value.hpp"
#include "protocols/fault/fault.hpp"

namespace meltbench::fault {

/// One to four faults of a rig, as [[fault]] tables of a scenario: targets, kinds, parameters, triggers and durations
/// drawn from the seed alone. Parameters are nasty, but such as can be met in a workshop.
/// @param duration  of the run; faults begin in its first three quarters.
[[nodiscard]] config::Array draw_faults(std::uint64_t seed, const Scope& scope, Nanos duration);

}  // namespace meltbench::fault
