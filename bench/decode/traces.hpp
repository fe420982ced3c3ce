#pragma once
/// What the boards measured, at a fixed pace: two runs of one machine can be laid over each other.

#include <optional>
#include <span>
#include <string>
#include <vector>

#include "bench/decode/wire_signals.hpp"
#include "protocols/config/rig.hpp"

namespace meltbench::decode {

/// A measurement that a fault can falsify, or that shows what an actuator does.
struct Quantity {
  std::string sensor;       ///< As faults name it: "melt_pressure", "zone2".
  std::string signal;       ///< "wire.heater.7130_2".
  double si_per_digit = 1;  ///< What a fault's unit (Pa, K, m) makes of one digit on the wire.
  double tell = 1;          ///< Digits that two healthy runs do not differ by: several times resolution and noise.
};

/// Samples the measurements of a bus every kPeriod, as they were last seen. Memory: 4 bytes per quantity and sample, at
/// most kMostSamples of them; what comes later is not kept.
class Traces {
 public:
  static constexpr Nanos kPeriod = 100ms;
  static constexpr std::size_t kMostSamples = 1 << 16;  // Nearly two hours.

  /// @throws config::ConfigError at the board whose EDS cannot be used.
  explicit Traces(const config::Rig& rig);

  /// @param at  not before that of the frame before.
  void take(Instant at, const can::CanFrame& frame);

  [[nodiscard]] const std::vector<Quantity>& quantities() const { return quantities_; }
  /// NaN as long as nothing was seen. Cut to the shortest of all.
  [[nodiscard]] std::span<const float> of(std::size_t quantity) const { return samples_[quantity]; }
  [[nodiscard]] std::size_t size() const { return samples_.empty() ? 0 : samples_.front().size(); }
  /// Between the cycles of a machine whose SYNC comes every 10 ms: a frame that is late does not change a sample.
  [[nodiscard]] static Instant time_of(std::size_t sample) {
    return Instant{kFirst + static_cast<std::int64_t>(sample) * kPeriod};
  }
  /// First sample at or after this time.
  [[nodiscard]] static std::size_t sample_at(Instant at);

 private:
  static constexpr Nanos kFirst = 5ms;
  std::vector<Quantity> quantities_;
  std::vector<std::size_t> columns_;  ///< Of the quantities, among the signals.
  WireSignals wire_;
  std::vector<double> values_;
  std::vector<std::vector<float>> samples_;
  Instant next_{kFirst};
};

/// Where two runs part.
struct Departure {
  std::size_t quantity = 0;
  std::size_t sample = 0;
};

/// The first quantity that is further apart than it may for half a second, before `end`; nothing if none is.
[[nodiscard]] std::optional<Departure> find_departure(const Traces& one, const Traces& other, std::size_t end);
/// The same, of one quantity.
[[nodiscard]] std::optional<std::size_t> find_departure(const Traces& one, const Traces& other, std::size_t quantity,
                                                        std::size_t end);

/// Mean distance over [begin, end) and all quantities, in units of what healthy runs differ by.
[[nodiscard]] double calc_distance(const Traces& one, const Traces& other, std::size_t begin, std::size_t end);

}  // namespace meltbench::decode
