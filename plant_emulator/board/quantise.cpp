#include "plant_emulator/board/quantise.hpp"

#include <algorithm>
#include <cmath>

namespace meltbench::board {

double quantise(double value, double step) {
  return step > 0 ? std::round(value / step) * step : value;
}

std::uint16_t to_age(Nanos age, Nanos unit) {
  const std::int64_t count = (age + unit / 2) / unit;
  return static_cast<std::uint16_t>(std::clamp<std::int64_t>(count, 0, 0xFFFF));
}

}  // namespace meltbench::board
