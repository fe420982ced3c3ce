#include "controller/safety/melt_interlock.hpp"

#include <fmt/format.h>

#include <algorithm>

namespace meltbench::safety {

namespace {

double calc_hottest_degC(const MeltObservation& seen) {
  return std::max(seen.T_solid_max_degC, seen.T_inlet_degC.value_or(seen.T_solid_max_degC));
}

std::string describe_stale(std::string_view what, double coasted_m, const MeltLimits& limits,
                           const MeltObservation& seen) {
  constexpr double kMmPerM = 1e3;
  return fmt::format("{} not measured for {:.3g} mm of screw travel, limit {:.3g} mm; are its PDOs lost?", what,
                     coasted_m * kMmPerM, limits.max_coasted_share * seen.front_m * kMmPerM);
}

}  // namespace

MeltTrip judge(const MeltLimits& limits, const MeltObservation& seen) {
  if (calc_hottest_degC(seen) > limits.T_melt_degC + limits.max_superheat_K) return MeltTrip::kSuperheated;
  if (seen.T_liquid_min_degC && *seen.T_liquid_min_degC < limits.T_melt_degC - limits.max_undercooling_K) {
    return MeltTrip::kFreezing;
  }
  if (seen.front_m < limits.min_length_m) return MeltTrip::kSolidLost;
  if (limits.length_m - seen.front_m < limits.min_length_m) return MeltTrip::kMeltLost;
  if (seen.front_coasted_m > limits.max_coasted_share * seen.front_m) return MeltTrip::kFrontStale;
  if (seen.inlet_coasted_m > limits.max_coasted_share * seen.front_m) return MeltTrip::kInletStale;
  return MeltTrip::kNone;
}

std::string_view code_of(MeltTrip trip) {
  switch (trip) {
    case MeltTrip::kNone:
      break;
    case MeltTrip::kSuperheated:
      return "superheated";
    case MeltTrip::kFreezing:
      return "melt-freezing";
    case MeltTrip::kSolidLost:
      return "solid-lost";
    case MeltTrip::kMeltLost:
      return "melt-lost";
    case MeltTrip::kFrontStale:
      return "front-stale";
    case MeltTrip::kInletStale:
      return "inlet-stale";
  }
  return "none";
}

std::string describe(MeltTrip trip, const MeltLimits& limits, const MeltObservation& seen) {
  constexpr double kMmPerM = 1e3;
  switch (trip) {
    case MeltTrip::kNone:
      break;
    case MeltTrip::kSuperheated:
      return fmt::format("granules at {:.4g} C, melting point {:.4g} C, limit {:.3g} K above; they stick at the inlet",
                         calc_hottest_degC(seen), limits.T_melt_degC, limits.max_superheat_K);
    case MeltTrip::kFreezing:
      return fmt::format("melt at {:.4g} C, melting point {:.4g} C, limit {:.3g} K below; which zone has no power?",
                         seen.T_liquid_min_degC.value_or(0.0), limits.T_melt_degC, limits.max_undercooling_K);
    case MeltTrip::kSolidLost:
      return fmt::format("melting front at {:.3g} mm: no granules are left in the barrel; is the inlet too hot?",
                         seen.front_m * kMmPerM);
    case MeltTrip::kMeltLost:
      return fmt::format("melting front {:.3g} mm before the nozzle: no melt is left; are the granules too cold?",
                         (limits.length_m - seen.front_m) * kMmPerM);
    case MeltTrip::kFrontStale:
      return describe_stale("melting front", seen.front_coasted_m, limits, seen);
    case MeltTrip::kInletStale:
      return describe_stale("inlet temperature", seen.inlet_coasted_m, limits, seen);
  }
  return "nothing";
}

}  // namespace meltbench::safety
