#include "protocols/fault/vocabulary.hpp"

#include <fmt/format.h>

#include <algorithm>

namespace meltbench::fault {

namespace {

constexpr double kHuge = 1e12;
constexpr std::string_view kTemperatureFaults =
    "stuck offset drift noise spike open_circuit short_circuit out_of_range delayed";
constexpr std::string_view kHeaterFaults = "stuck saturated lagging dead welded_on";

template <class... Parameters>
constexpr KindInfo row(Target target, Kind kind, std::string_view name, Parameters... parameters) {
  return {target, kind, name, {parameters...}, sizeof...(parameters)};
}

constexpr std::array kVocabulary{
    row(Target::kFrame, Kind::kDrop, "drop"),
    row(Target::kFrame, Kind::kDelay, "delay", Parameter{"delay_ms", Unit::kAsNamed, 0.001, 60'000, {}},
        Parameter{"jitter_ms", Unit::kAsNamed, 0, 60'000, 0.0}),
    row(Target::kFrame, Kind::kDuplicate, "duplicate", Parameter{"copies", Unit::kAsNamed, 1, 100, 1.0},
        Parameter{"delay_ms", Unit::kAsNamed, 0, 60'000, 0.0}),
    row(Target::kFrame, Kind::kCorrupt, "corrupt"),
    row(Target::kFrame, Kind::kReorder, "reorder", Parameter{"behind", Unit::kAsNamed, 1, 1000, 1.0},
        Parameter{"hold_ms", Unit::kAsNamed, 0.001, 60'000, 100.0}),

    row(Target::kBoard, Kind::kOff, "off"),
    row(Target::kBoard, Kind::kReboot, "reboot"),
    row(Target::kBoard, Kind::kHang, "hang", Parameter{"watchdog_ms", Unit::kAsNamed, 0, 600'000, 1000.0}),
    row(Target::kBoard, Kind::kSlow, "slow", Parameter{"delay_ms", Unit::kAsNamed, 0.001, 10'000, {}}),
    row(Target::kBoard, Kind::kHeartbeatLost, "heartbeat_lost"),
    row(Target::kBoard, Kind::kWrongIdentity, "wrong_identity",
        Parameter{"product", Unit::kAsNamed, 0, 4'294'967'295.0, 1.0}),
    row(Target::kBoard, Kind::kEmcyStorm, "emcy_storm", Parameter{"code", Unit::kAsNamed, 1, 65'535, 0x1000},
        Parameter{"period_ms", Unit::kAsNamed, 0.1, 10'000, 10.0}),
    row(Target::kBoard, Kind::kSameNodeId, "same_node_id", Parameter{"running", Unit::kAsNamed, 0, 1, 0.0}),

    row(Target::kSensor, Kind::kStuck, "stuck"),
    row(Target::kSensor, Kind::kOffset, "offset", Parameter{"offset", Unit::kOfObject, -kHuge, kHuge, {}}),
    row(Target::kSensor, Kind::kDrift, "drift", Parameter{"drift", Unit::kOfObjectPerSecond, -kHuge, kHuge, {}}),
    row(Target::kSensor, Kind::kNoise, "noise", Parameter{"noise", Unit::kOfObject, 0, kHuge, {}}),
    row(Target::kSensor, Kind::kSpike, "spike", Parameter{"spike", Unit::kOfObject, -kHuge, kHuge, {}},
        Parameter{"share", Unit::kAsNamed, 0, 1, 0.01}),
    row(Target::kSensor, Kind::kOpenCircuit, "open_circuit"),
    row(Target::kSensor, Kind::kShortCircuit, "short_circuit"),
    row(Target::kSensor, Kind::kOutOfRange, "out_of_range",
        Parameter{"value", Unit::kOfObjectAbsolute, -kHuge, kHuge, {}}),
    row(Target::kSensor, Kind::kDelayed, "delayed", Parameter{"delay_ms", Unit::kAsNamed, 0.001, 60'000, {}}),

    row(Target::kActuator, Kind::kStuck, "stuck"),
    row(Target::kActuator, Kind::kSaturated, "saturated", Parameter{"max", Unit::kOfObject, 0, kHuge, {}}),
    row(Target::kActuator, Kind::kLagging, "lagging", Parameter{"lag_ms", Unit::kAsNamed, 1, 600'000, {}}),
    row(Target::kActuator, Kind::kDead, "dead"),
    row(Target::kActuator, Kind::kWeldedOn, "welded_on"),

    row(Target::kPlant, Kind::kFeederBridging, "feeder_bridging"),
    row(Target::kPlant, Kind::kHopperEmpty, "hopper_empty"),
    row(Target::kPlant, Kind::kMaterial, "material", Parameter{"viscosity_factor", Unit::kAsNamed, 0.01, 100, 1.0},
        Parameter{"density_factor", Unit::kAsNamed, 0.1, 10, 1.0},
        Parameter{"melting_point_shift_K", Unit::kAsNamed, -50, 50, 0.0}),
    row(Target::kPlant, Kind::kScrewSurge, "screw_surge", Parameter{"eps", Unit::kAsNamed, 0, 0.9, {}},
        Parameter{"w_rad_per_s", Unit::kAsNamed, 0.001, 100, {}}),
    row(Target::kPlant, Kind::kNozzleClog, "nozzle_clog", Parameter{"closed_share", Unit::kAsNamed, 0, 0.99, {}}),
    row(Target::kPlant, Kind::kColdStart, "cold_start"),

    row(Target::kBus, Kind::kShortCircuit, "short_circuit"),
    row(Target::kBus, Kind::kStuckDominant, "stuck_dominant"),
    row(Target::kBus, Kind::kNoise, "noise", Parameter{"bit_error_rate", Unit::kAsNamed, 0, 1, {}}),
    row(Target::kBus, Kind::kOpenCircuit, "open_circuit"),
    row(Target::kBus, Kind::kBabble, "babble", Parameter{"id", Unit::kAsNamed, 0, 0x7FF, 0.0}),
    row(Target::kBus, Kind::kWrongBitRate, "wrong_bit_rate", Parameter{"divider", Unit::kAsNamed, 2, 50, 2.0}),
    row(Target::kBus, Kind::kBusOff, "bus_off"),

    row(Target::kLine, Kind::kNoise, "noise", Parameter{"share", Unit::kAsNamed, 0, 1, 0.01}),
    row(Target::kLine, Kind::kDrop, "drop", Parameter{"share", Unit::kAsNamed, 0, 1, 0.01}),
    row(Target::kLine, Kind::kHalfFrame, "half_frame", Parameter{"share", Unit::kAsNamed, 0, 1, 1.0}),
    row(Target::kLine, Kind::kWrongParity, "wrong_parity"),
    row(Target::kLine, Kind::kStall, "stall", Parameter{"delay_ms", Unit::kAsNamed, 0.001, 60'000, {}}),
    row(Target::kLine, Kind::kUnplugged, "unplugged"),

    row(Target::kClock, Kind::kDrift, "drift", Parameter{"drift_ppm", Unit::kAsNamed, -100'000, 100'000, {}}),
    row(Target::kClock, Kind::kStep, "step", Parameter{"step_ms", Unit::kAsNamed, 0.001, 60'000, {}}),

    row(Target::kProgram, Kind::kKilled, "killed"),
    row(Target::kProgram, Kind::kRestart, "restart"),
};

constexpr std::array kObjects{
    ObjectInfo{Target::kSensor, "melt_pressure", "Pa", "Pa", "melt_pressure",
               "stuck offset drift noise spike open_circuit short_circuit out_of_range delayed"},
    ObjectInfo{Target::kSensor, "melt_temperature", "K", "degC", "melt_pressure", kTemperatureFaults},
    ObjectInfo{Target::kSensor, "encoder", "rev", "rev", "screw_drive", "stuck"},
    ObjectInfo{Target::kSensor, "front", "m", "m", "melt_camera",
               "stuck offset drift noise spike open_circuit out_of_range delayed"},
    ObjectInfo{Target::kSensor, "inlet_temperature", "K", "degC", "preconditioner", kTemperatureFaults},
    ObjectInfo{Target::kSensor, "zone1", "K", "degC", "heater", kTemperatureFaults},
    ObjectInfo{Target::kSensor, "zone2", "K", "degC", "heater", kTemperatureFaults},
    ObjectInfo{Target::kSensor, "zone3", "K", "degC", "heater", kTemperatureFaults},
    ObjectInfo{Target::kSensor, "zone4", "K", "degC", "heater", kTemperatureFaults},
    ObjectInfo{Target::kSensor, "nozzle", "K", "degC", "heater", kTemperatureFaults},
    ObjectInfo{Target::kActuator, "feed", "kg_per_h", "kg_per_h", "feeder", "stuck saturated lagging dead"},
    ObjectInfo{Target::kActuator, "screw", "rpm", "rpm", "screw_drive", "stuck saturated lagging dead"},
    ObjectInfo{Target::kActuator, "inlet_flux", "W_per_m2", "W_per_m2", "preconditioner", "stuck saturated dead"},
    ObjectInfo{Target::kActuator, "zone1", "share", "share", "heater", kHeaterFaults},
    ObjectInfo{Target::kActuator, "zone2", "share", "share", "heater", kHeaterFaults},
    ObjectInfo{Target::kActuator, "zone3", "share", "share", "heater", kHeaterFaults},
    ObjectInfo{Target::kActuator, "zone4", "share", "share", "heater", kHeaterFaults},
    ObjectInfo{Target::kActuator, "nozzle", "share", "share", "heater", kHeaterFaults},
};

constexpr std::array<std::string_view, kTargets> kTargetNames{"frame", "bus",  "board", "sensor", "actuator",
                                                              "plant", "line", "clock", "program"};
constexpr std::array<std::string_view, 5> kChannels{"zone1", "zone2", "zone3", "zone4", "nozzle"};

}  // namespace

std::string_view name_of(Target target) {
  return kTargetNames.at(static_cast<std::size_t>(target));
}

std::span<const KindInfo> vocabulary() {
  return kVocabulary;
}

std::span<const ObjectInfo> objects() {
  return kObjects;
}

std::string key_of(const Parameter& parameter, const ObjectInfo* object) {
  if (object == nullptr || parameter.unit == Unit::kAsNamed) return std::string{parameter.name};
  switch (parameter.unit) {
    case Unit::kOfObjectAbsolute:
      return fmt::format("{}_{}", parameter.name, object->absolute_unit);
    case Unit::kOfObjectPerSecond:
      return fmt::format("{}_{}_per_s", parameter.name, object->unit);
    default:
      return fmt::format("{}_{}", parameter.name, object->unit);
  }
}

std::optional<std::size_t> channel_of(std::string_view object) {
  const auto* found = std::find(kChannels.begin(), kChannels.end(), object);
  if (found == kChannels.end()) return {};
  return static_cast<std::size_t>(found - kChannels.begin());
}

}  // namespace meltbench::fault
