#include "bench/fault/torture.hpp"

#include <array>
#include <cmath>
#include <random>
#include <string>
#include <vector>

namespace meltbench::fault {

namespace {

/// Own draws, because the distributions of the standard library differ between libraries.
class Dice {
 public:
  explicit Dice(std::uint64_t seed) : engine_{seed} {}
  [[nodiscard]] double uniform(double low, double high) {
    return low + (high - low) * static_cast<double>(engine_() >> 11U) * 0x1p-53;
  }
  [[nodiscard]] std::size_t below(std::size_t count) {
    return static_cast<std::size_t>(uniform(0, static_cast<double>(count)));
  }
  [[nodiscard]] bool chance(double probability) { return uniform(0, 1) < probability; }

 private:
  std::mt19937_64 engine_;
};

struct Span {
  std::string_view name;
  double low, high;
  bool whole = false;
};

/// Of the parameters whose unit is in their name.
constexpr std::array kSpans{
    Span{"delay_ms", 0.1, 400},
    Span{"jitter_ms", 0, 100},
    Span{"copies", 1, 4, true},
    Span{"behind", 1, 6, true},
    Span{"hold_ms", 1, 200},
    Span{"watchdog_ms", 100, 3000},
    Span{"product", 1, 1e6, true},
    Span{"code", 1, 65535, true},
    Span{"period_ms", 1, 200},
    Span{"running", 0, 2, true},
    Span{"share", 0, 0.3},
    Span{"lag_ms", 10, 5000},
    Span{"viscosity_factor", 0.4, 2.5},
    Span{"density_factor", 0.8, 1.2},
    Span{"melting_point_shift_K", -8, 8},
    Span{"eps", 0, 0.6},
    Span{"w_rad_per_s", 0.05, 12},
    Span{"closed_share", 0, 0.95},
    Span{"drift_ppm", -5000, 5000},
    Span{"step_ms", 0.1, 1500},
};

/// Largest error of a sensor, or power of an actuator, by its unit.
double scale_of(std::string_view unit) {
  if (unit == "Pa") return 3e4;
  if (unit == "m") return 0.1;
  if (unit == "kg_per_h") return 10;
  if (unit == "rpm") return 120;
  if (unit == "W_per_m2") return 5000;
  if (unit == "share") return 1;
  return 60;  // Kelvins.
}

double draw_value(Dice& dice, const Parameter& parameter, const ObjectInfo* object) {
  if (parameter.unit == Unit::kAsNamed || object == nullptr) {
    for (const Span& span : kSpans) {
      if (span.name != parameter.name) continue;
      const double value = dice.uniform(span.low, span.high);
      return span.whole ? std::floor(value) : value;
    }
    return parameter.fallback.value_or(parameter.min);
  }
  const double scale = scale_of(object->unit);
  if (parameter.unit == Unit::kOfObjectAbsolute) return dice.uniform(-scale, 5 * scale);
  return parameter.min >= 0 ? dice.uniform(0, scale) : dice.uniform(-scale, scale);
}

void put(config::Table& table, std::string_view key, config::Value::Data data) {
  table.set(key, config::Value{std::move(data), {}});
}

void draw_frames(Dice& dice, config::Table& table, const Scope& scope) {
  // PDOs, SDO, EMCY, heartbeats and SYNC of a node, or everything of a kind.
  constexpr std::array<std::int64_t, 13> kBases{0x080, 0x180, 0x200, 0x280, 0x300, 0x380, 0x400,
                                                0x480, 0x500, 0x580, 0x600, 0x700, 0x080};
  constexpr std::int64_t kFunctionMask = 0x780;
  const std::int64_t base = kBases.at(dice.below(kBases.size()));
  if (dice.chance(0.2)) {
    put(table, "id", base);
    put(table, "mask", kFunctionMask);
  } else {
    const config::RigBoard& board = scope.rig.boards[dice.below(scope.rig.boards.size())];
    put(table, "id", dice.chance(0.1) ? std::int64_t{0x80} : base + std::int64_t{board.node_id});
  }
  if (dice.chance(0.7)) put(table, "probability", dice.uniform(0.02, 1));
  if (dice.chance(0.2)) put(table, "count", static_cast<std::int64_t>(1 + dice.below(200)));
}

void draw_trigger(Dice& dice, config::Table& table, double duration_s) {
  if (dice.chance(0.1)) {
    config::Table frame;
    put(frame, "id", std::int64_t{0x80});
    put(frame, "n", static_cast<std::int64_t>(1 + dice.below(static_cast<std::size_t>(duration_s * 75))));
    put(table, "at_frame", std::move(frame));
  } else {
    put(table, "at_s", std::round(dice.uniform(0, 0.75 * duration_s) * 1e6) * 1e-6);
  }
  if (dice.chance(0.7)) put(table, "for_s", std::exp(dice.uniform(std::log(0.005), std::log(duration_s))));
}

config::Table draw_fault(Dice& dice, const Scope& scope, double duration_s) {
  const std::vector<std::string> targets = list_targets(scope);
  config::Table table;
  for (;;) {
    // A third of all faults are on the wire: a plain draw would rarely meet it among so many sensors.
    const std::string& target = dice.chance(0.3) ? targets.front() : targets[dice.below(targets.size())];
    const auto kinds = list_kinds(target, scope);
    if (kinds.empty()) continue;
    const KindInfo& kind = *kinds[dice.below(kinds.size())];
    if (kind.kind == Kind::kColdStart) continue;  // Another scenario altogether.
    put(table, "target", target);
    put(table, "kind", std::string{kind.name});
    const ObjectInfo* object = object_of(target);
    for (std::size_t i = 0; i < kind.parameter_count; ++i) {
      put(table, key_of(kind.parameters[i], object), draw_value(dice, kind.parameters[i], object));
    }
    if (kind.target == Target::kFrame) draw_frames(dice, table, scope);
    draw_trigger(dice, table, duration_s);
    put(table, "seed", static_cast<std::int64_t>(dice.below(1'000'000)));
    return table;
  }
}

}  // namespace

config::Array draw_faults(std::uint64_t seed, const Scope& scope, Nanos duration) {
  constexpr std::size_t kMost = 4;
  Dice dice{seed};
  config::Array faults;
  for (std::size_t left = 1 + dice.below(kMost); left > 0; --left) {
    faults.push_back({draw_fault(dice, scope, to_s(duration)), {}});
  }
  return faults;
}

}  // namespace meltbench::fault
