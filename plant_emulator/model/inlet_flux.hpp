#pragma once
/// What the preconditioner has put into the granules.

namespace meltbench::plant {

/// Flux at the inlet, and its sums since the start.
struct InletFlux {
  double now_W_per_m2 = 0;    ///< q_f.
  double total_J_per_m2 = 0;  ///< Its integral.
  double at_min_s = 0;        ///< For how long it was cut at its lower limit,
  double at_max_s = 0;        ///< and at its upper one.
};

}  // namespace meltbench::plant
