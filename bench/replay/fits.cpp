#include "bench/replay/fits.hpp"

#include <cmath>

namespace meltbench::replay {

double SignalFit::rms() const {
  return numbers == 0 ? 0.0 : std::sqrt(sum_of_squares / static_cast<double>(numbers));
}

void Fits::take(const ValuePair& pair) {
  const auto [place, is_new] = signals_.try_emplace({pair.node, pair.recorded.address});
  SignalFit& fit = place->second;
  if (is_new) fit.name = pair.recorded.name;
  ++fit.compared;
  if (std::isnan(pair.recorded.value) && std::isnan(pair.answered.value)) return;
  const double difference = std::abs(pair.answered.value - pair.recorded.value);  // NaN: one of them is none.
  if (!std::isnan(difference)) {
    ++fit.numbers;
    fit.sum_of_squares += difference * difference;
    if (difference == 0.0) return;
  }
  if (fit.differing++ == 0 || difference > fit.largest) {
    fit.at = pair.at;
    fit.line = pair.line;
  }
  if (difference > fit.largest) fit.largest = difference;
}

}  // namespace meltbench::replay
