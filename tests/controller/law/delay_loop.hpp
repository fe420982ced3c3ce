#pragma once
/// Closed loops of the delay extruder for tests: plant and law side by side, without boards and bus.

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>
#include <variant>
#include <vector>

#include "controller/law/bang_bang.hpp"
#include "controller/law/exact_predictor.hpp"
#include "controller/law/paper_predictor.hpp"
#include "plant_emulator/model/bizone_parameters.hpp"
#include "plant_emulator/model/frozen_delay_plant.hpp"
#include "plant_emulator/model/parcel_plant.hpp"

namespace delay_loop {

using namespace meltbench;

enum class Kind { kOpenLoop, kUncompensated, kExact, kStateOnly, kPaper };

/// A controller that knows the plant.
inline law::BizoneModel matched_model(const plant::BizoneParameters& p) {
  law::BizoneModel m;
  m.length_m = p.length_m;
  m.theta2_per_m = p.theta2_per_m();
  m.mass_per_length_kg_per_m = p.mass_per_length_kg_per_m();
  m.nozzle_kg = p.nozzle_kg;
  m.viscosity_Pa_s = p.viscosity_Pa_s;
  m.speed_m_per_s = p.speed_m_per_s;
  m.fluctuation = p.fluctuation;
  m.fluctuation_rad_per_s = p.fluctuation_rad_per_s;
  m.fluctuation_phase_rad = p.fluctuation_phase_rad;
  return m;
}

struct Options {
  Kind kind = Kind::kExact;
  double sample_s = 0.01;
  double end_s = 1.0;
  int looks = 1;  ///< x is recorded so many times per sample.
  law::BangBangSettings bang_bang = {};
  double assumed_U_before = -1.0;    ///< What the predictor takes for the unknown past; negative: the truth, v(x0).
  double actuation_delay_s = 0.0;    ///< A command starts so much later ...
  bool compensate_actuation = true;  ///< ... and the predictor knows.
  double measurement_age_s = 0.0;    ///< x is so old ...
  bool time_stamped = true;          ///< ... and the predictor knows.
  double theta2_factor = 1.0;        ///< The controller's theta2 over the plant's.
  double clock_factor = 1.0;         ///< Metres that the controller believes to be conveyed over the true ones.
  double phase_error_s = 0.0;        ///< The paper's predictor believes the fluctuation to be so much further on.
};

struct Sample {
  double t = 0.0, s = 0.0, x = 0.0, U = 0.0, P = 0.0;
};

/// Samples at t = 0, T/looks, 2 T/looks ...; x as of then, U held from then on, P the prediction that it came from.
struct Run {
  std::vector<Sample> samples;
  bool infeasible = false;
  double sample_s = 0.0;

  [[nodiscard]] double x_at(double t) const {
    return samples.at(static_cast<std::size_t>(std::lround(t / sample_s))).x;
  }

  /// Last time outside x* (1 +- band), between samples by straight line; infinite if that is the end.
  [[nodiscard]] double settling_s(double x_set, double band) const {
    for (std::size_t i = samples.size(); i-- > 1;) {
      const double outside = std::abs(samples[i].x - x_set) - band * x_set;
      if (outside <= 0.0) continue;
      if (i + 1 == samples.size()) return INFINITY;
      const double inside = std::abs(samples[i + 1].x - x_set) - band * x_set;
      return samples[i].t + sample_s * outside / (outside - inside);
    }
    return 0.0;
  }
  [[nodiscard]] double overshoot_m(double x_set) const {
    double over = 0.0;
    for (const Sample& sample : samples) over = std::max(over, sample.x - x_set);
    return over;
  }
  [[nodiscard]] double peak_to_peak_m(double from_s, double to_s) const {
    double low = INFINITY, high = -INFINITY;
    for (const Sample& sample : samples) {
      if (sample.t < from_s || sample.t > to_s) continue;
      low = std::min(low, sample.x);
      high = std::max(high, sample.x);
    }
    return high - low;
  }
  /// Integral of |x - x*|, trapezoidal.
  [[nodiscard]] double absolute_error_m_s(double x_set) const {
    double area = 0.0;
    for (std::size_t i = 1; i < samples.size(); ++i) {
      area += 0.5 * sample_s * (std::abs(samples[i].x - x_set) + std::abs(samples[i - 1].x - x_set));
    }
    return area;
  }
};

/// Either plant behind one face.
class AnyPlant {
 public:
  explicit AnyPlant(const plant::BizoneParameters& p)
      : clock_{p.speed_m_per_s, p.fluctuation, p.fluctuation_rad_per_s, p.fluctuation_phase_rad}, plant_{make(p)} {}

  void advance(double t, double U) {
    if (auto* parcels = std::get_if<plant::ParcelPlant>(&plant_)) {
      parcels->advance({t, clock_.conveyed_m(t)}, U);
    } else {
      std::get<plant::FrozenDelayPlant>(plant_).advance(t, U, clock_);
    }
  }
  [[nodiscard]] double x() const {
    return std::visit([](const auto& one) { return one.x_m(); }, plant_);
  }
  [[nodiscard]] const plant::ScrewClock& clock() const { return clock_; }
  [[nodiscard]] const plant::ParcelPlant& parcels() const { return std::get<plant::ParcelPlant>(plant_); }

 private:
  std::variant<plant::ParcelPlant, plant::FrozenDelayPlant> make(const plant::BizoneParameters& p) const {
    const double U = p.U_before_start.value_or(p.outflow_ratio(p.x0_m));
    if (p.delay_reading == plant::DelayReading::kTransport) {
      return plant::ParcelPlant(p.length_m, p.theta2_per_m(), p.x0_m, U);
    }
    return plant::FrozenDelayPlant(p.length_m, p.theta2_per_m(), p.x0_m, U, clock_);
  }
  plant::ScrewClock clock_;
  std::variant<plant::ParcelPlant, plant::FrozenDelayPlant> plant_;
};

/// Whichever predictor the law uses, on the axis that it uses: metres conveyed, theta1 t, or t.
class AnyPredictor {
 public:
  AnyPredictor(Kind kind, const law::BizoneModel& model, const plant::ScrewClock& clock, double U_before,
               double clock_factor = 1.0)
      : kind_{kind},
        clock_factor_{clock_factor},
        theta1_{model.speed_m_per_s},
        clock_{clock},
        exact_{{model.length_m, model.theta2_per_m, 2.0 * model.length_m, 5e-6}},
        paper_{model} {
    exact_.start(place(0.0), U_before);
    paper_.start(0.0, U_before);
  }

  void feed(double t_to, double U) {
    if (kind_ == Kind::kPaper) {
      paper_.feed(t_to, U);
    } else {
      exact_.feed(place(t_to), U);
    }
  }

  /// Prediction for t_effect, with U_ahead between the end of the history and t_effect.
  [[nodiscard]] law::Prediction predict(double t_measured, double x, double t_effect, double U_ahead) const {
    if (kind_ == Kind::kPaper) {
      const law::TimedFeed ahead[] = {{t_effect, U_ahead}};
      return paper_.predict(t_measured, x, ahead);
    }
    const law::FeedStretch ahead[] = {{place(t_effect), U_ahead}};
    return exact_.predict(place(t_measured), x, ahead);
  }

 private:
  [[nodiscard]] double place(double t) const {
    return clock_factor_ * (kind_ == Kind::kStateOnly ? theta1_ * t : clock_.conveyed_m(t));
  }
  Kind kind_;
  double clock_factor_, theta1_;
  plant::ScrewClock clock_;
  law::ExactPredictor exact_;
  law::PaperPredictor paper_;
};

/// Runs the loop: sample, predict, hold. Stops where the law is infeasible.
inline Run run(const plant::BizoneParameters& p, const Options& options) {
  law::BizoneModel model = matched_model(p);
  model.theta2_per_m *= options.theta2_factor;
  model.fluctuation_phase_rad += model.fluctuation_rad_per_s * options.phase_error_s;
  const law::BangBang bang_bang{model, options.bang_bang};
  AnyPlant extruder{p};
  const double v0 = p.outflow_ratio(p.x0_m);
  AnyPredictor predictor{options.kind, model, extruder.clock(),
                         options.assumed_U_before >= 0.0 ? options.assumed_U_before : v0, options.clock_factor};
  const double T = options.sample_s, late = options.actuation_delay_s, age = options.measurement_age_s;
  if (late > T || age > T || (late > 0.0 && age > 0.0)) {
    throw std::invalid_argument("delay_loop: one latency at a time, up to one sample");
  }

  Run result;
  result.sample_s = T / options.looks;
  double U_held = v0, P_held = p.x0_m;  // Before the first command takes effect.
  const auto move_to = [&](double t_to, double U) {
    for (;;) {
      const double t_look = static_cast<double>(result.samples.size()) * result.sample_s;
      if (t_look > t_to - 1e-9 * T) break;
      extruder.advance(t_look, U);
      result.samples.push_back({t_look, extruder.clock().conveyed_m(t_look), extruder.x(), U, P_held});
    }
    extruder.advance(t_to, U);
  };
  double x_aged = p.x0_m;  // x as of t - age.
  const auto samples = std::lround(options.end_s / T);
  for (long k = 0; k <= samples; ++k) {
    const double t = static_cast<double>(k) * T;
    const double x = extruder.x();
    const double x_seen = age > 0.0 ? x_aged : x;
    const double t_seen = options.time_stamped ? std::max(t - age, 0.0) : t;
    const double t_effect = options.compensate_actuation ? t + late : t;
    law::Prediction prediction{x_seen};
    if (options.kind != Kind::kOpenLoop && options.kind != Kind::kUncompensated) {
      prediction = predictor.predict(t_seen, x_seen, t_effect, U_held);
    }
    if (!prediction.usable()) {
      result.infeasible = true;
      return result;
    }
    const double U = options.kind == Kind::kOpenLoop ? bang_bang.U_set() : bang_bang.calc_U(prediction.P_m);
    result.samples.push_back({t, extruder.clock().conveyed_m(t), x, U, prediction.P_m});
    P_held = prediction.P_m;

    // The history is what was applied, but a law that ignores the latency believes its command acts at once.
    if (late > 0.0) {
      move_to(t + late, U_held);
      predictor.feed(t + late, options.compensate_actuation ? U_held : U);
    }
    U_held = U;
    if (age > 0.0) {
      move_to(t + T - age, U);
      x_aged = extruder.x();
    }
    move_to(t + T, U);
    predictor.feed(t + T, U);
  }
  return result;
}

}  // namespace delay_loop
