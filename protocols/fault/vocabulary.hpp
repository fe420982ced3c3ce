#pragma once
/// What can be made to fail, and how: one table of targets, kinds and parameters for the bench that orders faults and
/// the emulator that carries them out.

#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>

namespace meltbench::fault {

enum class Target : std::uint8_t { kFrame, kBus, kBoard, kSensor, kActuator, kPlant, kLine, kClock, kProgram };
inline constexpr std::size_t kTargets = 9;

/// "frame", "board" ...: what stands before the dot of a target.
[[nodiscard]] std::string_view name_of(Target target);

enum class Kind : std::uint8_t {
  // frame
  kDrop,
  kDelay,
  kDuplicate,
  kCorrupt,
  kReorder,
  // board
  kOff,
  kReboot,
  kHang,
  kSlow,
  kHeartbeatLost,
  kWrongIdentity,
  kEmcyStorm,
  kSameNodeId,
  // sensor and actuator
  kStuck,
  kOffset,
  kDrift,
  kNoise,
  kSpike,
  kOpenCircuit,
  kShortCircuit,
  kOutOfRange,
  kDelayed,
  kSaturated,
  kLagging,
  kDead,
  kWeldedOn,
  // plant
  kFeederBridging,
  kHopperEmpty,
  kMaterial,
  kScrewSurge,
  kNozzleClog,
  kColdStart,
  // clock
  kStep,
  // bus and line
  kStuckDominant,
  kBabble,
  kWrongBitRate,
  kBusOff,
  kHalfFrame,
  kWrongParity,
  kStall,
  kUnplugged,
  // program
  kKilled,
  kRestart,
};

/// What the unit at the end of a parameter's key is.
enum class Unit : std::uint8_t {
  kAsNamed,            ///< In the name itself: "delay_ms".
  kOfObject,           ///< A difference of the sensor or actuator: "offset_K".
  kOfObjectPerSecond,  ///< "drift_K_per_s".
  kOfObjectAbsolute,   ///< "value_degC".
};

struct Parameter {
  std::string_view name;
  Unit unit = Unit::kAsNamed;
  double min = 0.0;
  double max = 0.0;
  std::optional<double> fallback;  ///< None: must be given.
};

/// One row of the vocabulary.
struct KindInfo {
  Target target{};
  Kind kind{};
  std::string_view name;
  std::array<Parameter, 3> parameters;
  std::size_t parameter_count = 0;
};

[[nodiscard]] std::span<const KindInfo> vocabulary();

/// Quantities that sensors measure and actuators move, and the board that shows them.
struct ObjectInfo {
  Target target{};
  std::string_view name;
  std::string_view unit;           ///< Of a difference: "Pa", "K", "kg_per_h".
  std::string_view absolute_unit;  ///< Of a value: "Pa", "degC".
  std::string_view board_kind;     ///< As in [board.NAME] kind.
  std::string_view kinds;          ///< Names of the faults that it can have, separated by blanks.
};

[[nodiscard]] std::span<const ObjectInfo> objects();

/// "offset_K" for the sensor of a temperature.
[[nodiscard]] std::string key_of(const Parameter& parameter, const ObjectInfo* object);

/// The place of a heated zone among the channels of a heater: zone1 .. zone4 are 0..3, nozzle is 4.
[[nodiscard]] std::optional<std::size_t> channel_of(std::string_view object);

}  // namespace meltbench::fault
