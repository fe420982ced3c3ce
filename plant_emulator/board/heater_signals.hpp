#pragma once

#include <array>
#include <string_view>

namespace meltbench::board {

/// What a heater lets the bench record, on either wire.
inline constexpr std::array<std::string_view, 17> kHeaterSignals{
    "zone1_set_degC",  "zone1_degC",  "zone1_output_percent",  "zone2_set_degC", "zone2_degC", "zone2_output_percent",
    "zone3_set_degC",  "zone3_degC",  "zone3_output_percent",  "zone4_set_degC", "zone4_degC", "zone4_output_percent",
    "nozzle_set_degC", "nozzle_degC", "nozzle_output_percent", "alarms",         "master_lost"};

}  // namespace meltbench::board
