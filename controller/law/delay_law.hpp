#pragma once
/// The seam between the controller's bus side and the laws for the delay extruder: swap them by name.

#include <memory>
#include <span>
#include <string_view>

#include "controller/law/bang_bang.hpp"
#include "controller/law/bizone_model.hpp"
#include "controller/law/exact_predictor.hpp"
#include "controller/law/material_clock.hpp"
#include "protocols/time/instant.hpp"

namespace meltbench::law {

/// A mass flow held by the feeder up to an instant.
struct FeedInterval {
  Instant until;
  double feed_kg_per_s = 0.0;
};

/// What a law is asked.
struct DelayLawInput {
  Instant measured_at;  ///< Time stamp of x, by the sensor.
  double x_m = 0.0;     ///< Filled length then, from the estimator.
  Instant effect_at;    ///< When the feeder will start to deliver the answer.
  /// Feed between the end of what add_feed() was told and effect_at: commands already sent. May be empty: then the last
  /// feed is taken to go on.
  std::span<const FeedInterval> in_flight = {};
};

/// What it answers.
struct DelayLawOutput {
  double U = 0.0;  ///< Filling ratio to command from effect_at on, in [0, vmax].
  double P_m =
      0.0;  ///< Filled length that U was chosen for: prediction, measurement (uncompensated) or x* (open loop).
  /// kInfeasible and kBadInput: the law refuses; U is then the open-loop rate v*, which is safe for ever, and the
  /// caller must say so and decide.
  PredictionStatus status = PredictionStatus::kOk;
};

/// A law for the filled length. Call order: start() once, then per cycle add_feed() for what the feeder reports as
/// delivered, then calc(). The caller owns the material clock and adds the encoder sample of the cycle first.
/// Real time: nothing here allocates or throws after construction.
class DelayLaw {
 public:
  virtual ~DelayLaw() = default;

  /// Its name in rigs and scenarios.
  [[nodiscard]] virtual std::string_view name() const = 0;

  /// From here on; all material that entered before `at` has filling ratio U. Usually U = v(x) of the first
  /// measurement.
  virtual void start(Instant at, double U, const MaterialClock& clock) noexcept = 0;

  /// The feeder has delivered feed_kg_per_s from the end of the previous interval until interval.until. Mass counts:
  /// what falls on a standing screw is taken to enter with the next motion.
  virtual void add_feed(const FeedInterval& interval, const MaterialClock& clock) noexcept = 0;

  [[nodiscard]] virtual DelayLawOutput calc(const DelayLawInput& input, const MaterialClock& clock) noexcept = 0;
};

struct DelayLawSettings {
  BizoneModel model;
  BangBangSettings bang_bang;
  double max_measurement_age_s = 10.0;  ///< Predictions reach back this far before the delay; bounds the memory.
  double min_sample_time_s = 1e-3;      ///< Shortest time between two calls of add_feed() to be resolved.
};

/// Makes a law by name:
///   "open_loop"             U = v*, whatever x is, [D17] (19)
///   "uncompensated"         U = bang-bang of the measurement
///   "exact_predictor"       U = bang-bang of the prediction on the encoder's clock
///   "state_only_predictor"  the same with a screw that is believed to turn evenly, [D17] (121)-(125)
///   "paper_predictor"       [D17] (88)-(91); refuses where that is not defined
/// @throws std::invalid_argument with the list of names if there is no such law, or as BangBang.
[[nodiscard]] std::unique_ptr<DelayLaw> make_delay_law(std::string_view name, const DelayLawSettings& settings);

/// The names that make_delay_law() knows.
[[nodiscard]] std::span<const std::string_view> delay_law_names();

}  // namespace meltbench::law
