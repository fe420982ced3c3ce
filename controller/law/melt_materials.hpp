#pragma once
/// What the controller believes of the polymers that it may find in the hopper.

#include <optional>
#include <string_view>

#include "controller/law/melt_reference.hpp"

namespace meltbench::law {

/// A polymer by name, with hbar in both phases; length and nozzle flux are those of [K19] until somebody sets them.
/// Names: "hdpe", "pla", "ldpe"; sources of the figures: plant_emulator/MODEL.md Part 3, "Polymers".
/// @returns nothing for another name.
[[nodiscard]] std::optional<MeltModel> find_melt_material(std::string_view name, double barrel_exchange_W_per_m3K);

/// Decay of a Newtonian melt's viscosity eta exp(-k (T - T_ref)) near 10 K above the melting point [1/K]:
/// k = E/(R T²) with an assumed activation energy of flow, 27, 85 and 49 kJ/mol. 0 for another name.
[[nodiscard]] double find_viscosity_decay_1_per_K(std::string_view name);

}  // namespace meltbench::law
