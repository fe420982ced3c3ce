#pragma once
/// The polymers that the bench knows, with where their figures come from.

#include <cmath>

#include "plant_emulator/model/melt_material.hpp"

namespace meltbench::plant {

enum class PolymerKind { kHdpe, kPla, kLdpe };

/// Newtonian viscosity that falls with temperature, (C5) in plant_emulator/MODEL.md:  eta = eta_ref exp(-k (T -
/// T_ref)).
struct Viscosity {
  double at_reference_Pa_s = 1000;
  double T_reference_degC = 145;
  double decay_1_per_K = 0.0186;

  [[nodiscard]] double at_Pa_s(double T_degC) const {
    return at_reference_Pa_s * std::exp(-decay_1_per_K * (T_degC - T_reference_degC));
  }
};

/// One polymer: both phases for the melting front, and its melt for screw and nozzle.
struct Polymer {
  MeltParameters melt;  ///< Length and nozzle flux are the machine's: [K19]'s until somebody sets them.
  Viscosity viscosity;  ///< 1000 Pa s at T_m + 10 K for all of them: neither paper has one, and grades differ more.
};

/// Polymer of a kind; where the figures come from is in MODEL.md Part 3, "Polymers".
/// @param barrel_exchange_W_per_m3K  hbar of both phases; belongs to the machine.
[[nodiscard]] Polymer make_polymer(PolymerKind kind, double barrel_exchange_W_per_m3K);

}  // namespace meltbench::plant
