#pragma once
/// Signals that are one quantity at equal steps over the length of the screw: which they are, and their thinned values.

#include <optional>
#include <span>
#include <string>
#include <vector>

#include "bench/report/report.hpp"

namespace meltbench::report {

/// The points of one profile: "melt.T_00_degC" at the inlet, "melt.T_01_degC", ... to the nozzle.
struct ProfileSignals {
  std::string prefix;              ///< "melt.T".
  std::string unit;                ///< As in the names: "degC".
  std::vector<std::string> names;  ///< Point by point.
};

/// Profiles among `names`: <prefix>_NN_<unit> with NN = 00, 01, ... without a gap, at least five of them.
/// What has a gap or fewer points is no profile, and its signals are ordinary ones.
[[nodiscard]] std::vector<ProfileSignals> find_profile_signals(std::span<const std::string> names);

/// One profile of one run at some instants. NaN = no value.
struct ProfileLayer {
  std::vector<double> values;   ///< Instants x points, instant by instant; empty if this run does not have it.
  std::vector<double> front_m;  ///< Melting front, from <source>.front_m, per instant; empty if not recorded.
  std::vector<double> melting;  ///< Melting point, from <source>.<quantity>_melt_<unit>; empty if not recorded.
};

struct ProfileRun {
  int run = 0;
  std::vector<double> times_s;
  std::optional<double> length_m;    ///< From <source>.length_m of any layer.
  std::vector<ProfileLayer> layers;  ///< As Profile::sources.
};

/// A quantity over the length, as seen by those that know it: the plant's truth first, the controller's estimate last.
struct Profile {
  std::string quantity;  ///< "T".
  std::string unit;      ///< "degC".
  std::size_t points = 0;
  std::vector<std::string> sources;  ///< "melt", "controller".
  std::vector<ProfileRun> runs;      ///< Only those that have it.
};

/// Profiles of the same quantity with the same number of points belong together. Each run is thinned to instants of its
/// own, first and last row included: half of them spread over the time, half over what the profiles change, so that a
/// fast start in a long run can still be scrubbed.
[[nodiscard]] std::vector<Profile> make_profiles(std::span<const Run> runs, std::size_t max_instants = 300);

/// [{quantity, unit, points, layers: [{signal, role}], runs: [{run, t, length_m, layers: [{from, step, data, front,
/// melting} or null]}]}]; a value is from + step n, n little-endian uint16 in base64, 65535 = none.
[[nodiscard]] std::string write_profiles_json(std::span<const Profile> profiles);

}  // namespace meltbench::report
