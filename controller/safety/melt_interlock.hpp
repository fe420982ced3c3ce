#pragma once
/// When the controller must let go of the melting front. Numbers in, a decision with its reason out.

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

namespace meltbench::safety {

/// What is still safe to control the front with.
struct MeltLimits {
  /// Travel of the screw without a fresh front or inlet temperature, as a share of the front position: the model
  /// carries on that long. After a whole flush, share 1, nothing of the estimate rests on a measurement any more.
  double max_coasted_share = 0.5;
  /// Inlet this far above the melting point: the granules stick. At the heat of fusion over the heat capacity, 20.6 K
  /// for polyethylene, the front would be blown out of the barrel.
  double max_superheat_K = 10.0;
  /// Melt this far below the melting point: it freezes, blocks the nozzle and overloads the screw.
  double max_undercooling_K = 10.0;
  double T_melt_degC = 135.0;
  double length_m = 0.1;         ///< L, inlet to nozzle.
  double min_length_m = 1.5e-3;  ///< Less than this of granules or of melt: the front has left the barrel.
};

/// What the controller sees at one cycle.
struct MeltObservation {
  double front_m = 0.0;                ///< Newest one, or the model's while it is not measured.
  std::optional<double> T_inlet_degC;  ///< Newest one; nothing while it is not measured.
  double T_solid_max_degC = 0.0;       ///< Hottest place of the estimated granules.
  /// Lower bound of the melt's temperature: the coldest of barrel behind the front and thermometer at the nozzle. Melt
  /// between a front at T_m and warmer surroundings cannot be colder (maximum principle of (2), q_m >= 0).
  std::optional<double> T_liquid_min_degC{};
  double front_coasted_m = 0.0;  ///< Screw travel since the front was last measured.
  double inlet_coasted_m = 0.0;  ///< And since the inlet temperature was.
};

/// Why control of the front must stop; kNone: it may go on.
enum class MeltTrip : std::uint8_t {
  kNone,
  kSuperheated,  ///< (6) of [K19] is violated by more than the limit, measured or estimated.
  kFreezing,     ///< (7) of [K19] may be violated by more than the limit.
  kSolidLost,
  kMeltLost,
  kFrontStale,
  kInletStale,
};

/// The most urgent reason, in the order of MeltTrip.
[[nodiscard]] MeltTrip judge(const MeltLimits& limits, const MeltObservation& seen);

/// Stable, in kebab case: "front-stale". @pre trip is not kNone.
[[nodiscard]] std::string_view code_of(MeltTrip trip);

/// For people: value, limit and what to look at.
[[nodiscard]] std::string describe(MeltTrip trip, const MeltLimits& limits, const MeltObservation& seen);

}  // namespace meltbench::safety
