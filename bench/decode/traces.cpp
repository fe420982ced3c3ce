#include "bench/decode/traces.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>

namespace meltbench::decode {
namespace {

using config::BoardKind;

constexpr std::size_t kPersists = 5;  // Samples in a row that are apart.
constexpr double kFar = 20.0;         // A distance that is larger says no more than this.

struct Row {
  BoardKind kind;
  std::string_view object;  // As in the name of the signal; {} is the channel.
  unsigned first, last;     // Channels.
  std::string_view sensor;
  double si_per_digit;
  double tell;  // In digits.
};

/// By fixtures/boards. The converters are good to 1 Pa, 0.1 K and 1 um; runs at wall-clock pace differ by some 30 Pa.
constexpr std::array<Row, 7> kRows{
    Row{BoardKind::kMeltPressure, "9130_{}", 1, 1, "melt_pressure", 1.0, 100.0},
    Row{BoardKind::kMeltPressure, "7130_{}", 2, 2, "melt_temperature", 0.1, 10.0},
    Row{BoardKind::kMeltCamera, "9130_{}", 1, 1, "front", 1e-6, 300.0},
    Row{BoardKind::kPreconditioner, "6130_{}", 1, 1, "inlet_temperature", 1.0, 0.5},
    Row{BoardKind::kHeater, "7130_{}", 1, 4, "zone{}", 0.1, 4.0},
    Row{BoardKind::kHeater, "7130_{}", 5, 5, "nozzle", 0.1, 4.0},
    Row{BoardKind::kMeltCamera, "9130_{}", 2, 2, "inlet_temperature", 1e-3, 500.0},
};

std::vector<Quantity> list_quantities(const config::Rig& rig) {
  std::vector<Quantity> list;
  for (const config::RigBoard& board : rig.boards) {
    if (board.is_on_line()) continue;
    for (const Row& row : kRows) {
      if (row.kind != board.kind) continue;
      for (unsigned channel = row.first; channel <= row.last; ++channel) {
        const std::string object = fmt::format(fmt::runtime(row.object), channel);
        list.push_back({fmt::format(fmt::runtime(row.sensor), channel), fmt::format("wire.{}.{}", board.name, object),
                        row.si_per_digit, row.tell});
      }
    }
  }
  return list;
}

/// 0 where one of both has not been seen.
double difference(const Traces& one, const Traces& other, std::size_t quantity, std::size_t sample) {
  const double apart = static_cast<double>(one.of(quantity)[sample]) - static_cast<double>(other.of(quantity)[sample]);
  return std::isnan(apart) ? 0.0 : std::abs(apart) / one.quantities()[quantity].tell;
}

std::size_t common_end(const Traces& one, const Traces& other, std::size_t end) {
  return std::min({one.size(), other.size(), end});
}

}  // namespace

Traces::Traces(const config::Rig& rig) : wire_{rig.boards, {}} {
  for (Quantity& quantity : list_quantities(rig)) {
    const auto found = std::ranges::find(wire_.signals(), quantity.signal, &SignalInfo::name);
    if (found == wire_.signals().end()) continue;
    columns_.push_back(static_cast<std::size_t>(found - wire_.signals().begin()));
    quantities_.push_back(std::move(quantity));
  }
  values_.resize(wire_.signals().size());
  samples_.resize(quantities_.size());
}

void Traces::take(Instant at, const can::CanFrame& frame) {
  while (next_ < at && size() < kMostSamples && !samples_.empty()) {
    wire_.read(values_);
    for (std::size_t i = 0; i < columns_.size(); ++i) samples_[i].push_back(static_cast<float>(values_[columns_[i]]));
    next_ += kPeriod;
  }
  wire_.on_frame(frame);
}

std::size_t Traces::sample_at(Instant at) {
  if (at.since_start <= kFirst) return 0;
  return static_cast<std::size_t>((at.since_start - kFirst + kPeriod - Nanos{1}) / kPeriod);
}

std::optional<std::size_t> find_departure(const Traces& one, const Traces& other, std::size_t quantity,
                                          std::size_t end) {
  std::size_t row = 0;
  for (std::size_t i = 0; i < common_end(one, other, end); ++i) {
    row = difference(one, other, quantity, i) > 1.0 ? row + 1 : 0;
    if (row == kPersists) return i + 1 - kPersists;
  }
  return std::nullopt;
}

std::optional<Departure> find_departure(const Traces& one, const Traces& other, std::size_t end) {
  std::optional<Departure> first;
  for (std::size_t quantity = 0; quantity < one.quantities().size(); ++quantity) {
    const auto sample = find_departure(one, other, quantity, end);
    if (sample && (!first || *sample < first->sample)) first = Departure{quantity, *sample};
  }
  return first;
}

double calc_distance(const Traces& one, const Traces& other, std::size_t begin, std::size_t end) {
  const std::size_t last = common_end(one, other, end);
  const std::size_t quantities = one.quantities().size();
  if (begin >= last || quantities == 0) return 0.0;
  double sum = 0.0;
  for (std::size_t quantity = 0; quantity < quantities; ++quantity) {
    for (std::size_t i = begin; i < last; ++i) sum += std::min(difference(one, other, quantity, i), kFar);
  }
  return sum / static_cast<double>(quantities * (last - begin));
}

}  // namespace meltbench::decode
