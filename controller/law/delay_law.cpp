#include "controller/law/delay_law.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <stdexcept>
#include <vector>

#include "controller/law/paper_predictor.hpp"

namespace meltbench::law {

namespace {

constexpr std::size_t kMaxInFlight = 4096;  // Later commands on their way are not looked at.
constexpr double kMinMotion_m = 1e-12;      // Less than this is a screw at rest.

constexpr std::string_view kOpenLoop = "open_loop", kUncompensated = "uncompensated", kExact = "exact_predictor",
                           kStateOnly = "state_only_predictor", kPaper = "paper_predictor";
constexpr std::array kNames{kOpenLoop, kUncompensated, kExact, kStateOnly, kPaper};

/// Filling ratio of what is delivered, (C2) backwards, as the mean over each interval: no mass is lost.
class FeedMeter {
 public:
  explicit FeedMeter(double kg_per_m) : kg_per_m_{kg_per_m} {}

  void start(Instant at, double s_m) {
    until_ = at;
    s_ = s_m;
    waiting_kg_ = 0.0;
    feed_kg_per_s_ = 0.0;
  }

  /// @returns the mean filling ratio up to the end of the interval; negative if the screw has not moved yet.
  double add(const FeedInterval& interval, const MaterialClock& clock) {
    if (interval.until <= until_) return -1.0;
    waiting_kg_ += interval.feed_kg_per_s * to_s(interval.until - until_);
    until_ = interval.until;
    feed_kg_per_s_ = interval.feed_kg_per_s;
    const double s = clock.at(until_);
    const double motion = s - s_;
    if (!(motion > kMinMotion_m)) return -1.0;
    const double U = waiting_kg_ / (kg_per_m_ * motion);
    waiting_kg_ = 0.0;
    s_ = s;
    return U;
  }

  [[nodiscard]] Instant until() const { return until_; }
  [[nodiscard]] double s_m() const { return s_; }
  [[nodiscard]] double feed_kg_per_s() const { return feed_kg_per_s_; }

 private:
  double kg_per_m_;
  Instant until_{};
  double s_ = 0.0;
  double waiting_kg_ = 0.0;  // Delivered since the screw last moved.
  double feed_kg_per_s_ = 0.0;
};

/// What all laws share: the bang-bang law, and what to answer when there is no prediction.
class BangBangLaw : public DelayLaw {
 public:
  BangBangLaw(std::string_view name, const DelayLawSettings& settings)
      : name_{name}, bang_bang_{settings.model, settings.bang_bang} {}

  [[nodiscard]] std::string_view name() const override { return name_; }
  void start(Instant, double, const MaterialClock&) noexcept override {}
  void add_feed(const FeedInterval&, const MaterialClock&) noexcept override {}

 protected:
  [[nodiscard]] DelayLawOutput answer(const Prediction& prediction) const {
    if (!prediction.usable()) return {bang_bang_.U_set(), prediction.P_m, prediction.status};
    return {bang_bang_.calc_U(prediction.P_m), prediction.P_m, prediction.status};
  }
  [[nodiscard]] const BangBang& bang_bang() const { return bang_bang_; }

 private:
  std::string_view name_;
  BangBang bang_bang_;
};

class OpenLoopLaw final : public BangBangLaw {
 public:
  explicit OpenLoopLaw(const DelayLawSettings& settings) : BangBangLaw(kOpenLoop, settings) {}

  DelayLawOutput calc(const DelayLawInput&, const MaterialClock&) noexcept override {
    return {bang_bang().U_set(), bang_bang().x_set_m(), PredictionStatus::kOk};
  }
};

class UncompensatedLaw final : public BangBangLaw {
 public:
  explicit UncompensatedLaw(const DelayLawSettings& settings) : BangBangLaw(kUncompensated, settings) {}

  DelayLawOutput calc(const DelayLawInput& input, const MaterialClock&) noexcept override {
    const bool known = std::isfinite(input.x_m);
    return answer({input.x_m, known ? PredictionStatus::kOk : PredictionStatus::kBadInput});
  }
};

/// A predictor and the axis that it lives on: Axis gives Predictor, Stretch and the place of an instant.
template <typename Axis>
class PredictorLaw final : public BangBangLaw {
 public:
  explicit PredictorLaw(const DelayLawSettings& settings)
      : BangBangLaw(Axis::kName, settings),
        axis_{settings},
        meter_{settings.model.mass_per_length_kg_per_m},
        predictor_{axis_.make_predictor(settings)} {
    ahead_.reserve(kMaxInFlight + 1);
  }

  void start(Instant at, double U, const MaterialClock& clock) noexcept override {
    meter_.start(at, clock.at(at));
    predictor_.start(axis_.place(at, clock), U);
  }

  void add_feed(const FeedInterval& interval, const MaterialClock& clock) noexcept override {
    const double U = meter_.add(interval, clock);
    if (U >= 0.0) predictor_.feed(axis_.place(interval.until, clock), U);
  }

  DelayLawOutput calc(const DelayLawInput& input, const MaterialClock& clock) noexcept override {
    ahead_.clear();
    FeedMeter meter = meter_;
    const auto append = [&](const FeedInterval& interval) {
      const double U = meter.add(interval, clock);
      if (U >= 0.0) ahead_.push_back({axis_.place(interval.until, clock), U});
    };
    for (const FeedInterval& interval : input.in_flight) {
      if (ahead_.size() < kMaxInFlight && interval.until < input.effect_at) append(interval);
    }
    append(FeedInterval{input.effect_at, last_feed(input, meter)});
    return answer(predictor_.predict(axis_.place(input.measured_at, clock), input.x_m, ahead_));
  }

 private:
  // What is delivered right before the answer takes effect: the first command on its way that lasts so long.
  static double last_feed(const DelayLawInput& input, const FeedMeter& meter) {
    for (const FeedInterval& interval : input.in_flight) {
      if (interval.until >= input.effect_at) return interval.feed_kg_per_s;
    }
    return meter.feed_kg_per_s();
  }

  Axis axis_;
  FeedMeter meter_;
  typename Axis::Predictor predictor_;
  std::vector<typename Axis::Stretch> ahead_;  // Scratch of calc().
};

ExactPredictor make_exact_predictor(const DelayLawSettings& settings) {
  const BizoneModel& model = settings.model;
  // The fluctuation may let the screw run at up to twice, or hardly at all; the mean speed is what bounds both in the
  // end.
  const double window = model.length_m + 2.0 * model.speed_m_per_s * settings.max_measurement_age_s;
  const double ds_min = 0.5 * model.speed_m_per_s * settings.min_sample_time_s;
  return ExactPredictor({model.length_m, model.theta2_per_m, window, ds_min});
}

/// Metres conveyed, by the encoder.
class EncoderAxis {
 public:
  static constexpr std::string_view kName = kExact;
  using Predictor = ExactPredictor;
  using Stretch = FeedStretch;

  explicit EncoderAxis(const DelayLawSettings&) {}
  static Predictor make_predictor(const DelayLawSettings& settings) { return make_exact_predictor(settings); }
  [[nodiscard]] static double place(Instant at, const MaterialClock& clock) { return clock.at(at); }
};

/// Metres conveyed by a screw that turns evenly, (C8).
class EvenAxis {
 public:
  static constexpr std::string_view kName = kStateOnly;
  using Predictor = ExactPredictor;
  using Stretch = FeedStretch;

  explicit EvenAxis(const DelayLawSettings& settings) : theta1_{settings.model.speed_m_per_s} {}
  static Predictor make_predictor(const DelayLawSettings& settings) { return make_exact_predictor(settings); }
  [[nodiscard]] double place(Instant at, const MaterialClock&) const { return theta1_ * to_s(at); }

 private:
  double theta1_;
};

/// Seconds.
class TimeAxis {
 public:
  static constexpr std::string_view kName = kPaper;
  using Predictor = PaperPredictor;
  using Stretch = TimedFeed;

  explicit TimeAxis(const DelayLawSettings&) {}
  static Predictor make_predictor(const DelayLawSettings& settings) {
    const BizoneModel& model = settings.model;
    const double longest_delay_s = model.length_m / (model.speed_m_per_s * (1.0 - model.fluctuation));
    const double window_s = longest_delay_s + settings.max_measurement_age_s;
    return PaperPredictor(model, 4 + static_cast<std::size_t>(window_s / settings.min_sample_time_s));
  }
  [[nodiscard]] static double place(Instant at, const MaterialClock&) { return to_s(at); }
};

void check(const DelayLawSettings& settings) {
  const auto sound = [](double value) { return value > 0.0 && std::isfinite(value); };
  if (sound(settings.max_measurement_age_s) && sound(settings.min_sample_time_s) &&
      sound(settings.model.mass_per_length_kg_per_m) && sound(settings.model.speed_m_per_s)) {
    return;
  }
  throw std::invalid_argument(
      fmt::format("delay law: max_measurement_age_s = {}, min_sample_time_s = {}, mass_per_length_kg_per_m = {}, "
                  "speed_m_per_s = {}, all must be > 0",
                  settings.max_measurement_age_s, settings.min_sample_time_s, settings.model.mass_per_length_kg_per_m,
                  settings.model.speed_m_per_s));
}

}  // namespace

std::unique_ptr<DelayLaw> make_delay_law(std::string_view name, const DelayLawSettings& settings) {
  check(settings);
  if (name == kOpenLoop) return std::make_unique<OpenLoopLaw>(settings);
  if (name == kUncompensated) return std::make_unique<UncompensatedLaw>(settings);
  if (name == kExact) return std::make_unique<PredictorLaw<EncoderAxis>>(settings);
  if (name == kStateOnly) return std::make_unique<PredictorLaw<EvenAxis>>(settings);
  if (name == kPaper) return std::make_unique<PredictorLaw<TimeAxis>>(settings);
  throw std::invalid_argument(
      fmt::format("no law \"{}\" for the delay extruder; there are {}", name, fmt::join(kNames, ", ")));
}

std::span<const std::string_view> delay_law_names() {
  return kNames;
}

}  // namespace meltbench::law
