#pragma once
/// The predictor of [D17] (88)-(91), for the delay as printed there.

#include <cstddef>
#include <span>

#include "controller/law/bizone_model.hpp"
#include "controller/law/exact_predictor.hpp"
#include "protocols/time/ring.hpp"

namespace meltbench::law {

/// The paper's prediction, with the instant that it is for.
struct PaperPrediction : Prediction {
  double sigma_s = 0.0;        ///< When the feed that starts at the time of effect arrives.
  double min_denominator = 1;  ///< Least value of den (C9) on the way: how far from infeasible.
  double residual_s = 0.0;     ///< sigma - theta - (L - P)/c(sigma): 0 but for the error of integration.
};

/// Filling ratio held up to a time [s].
struct TimedFeed {
  double t_to_s = 0.0;
  double U = 0.0;
};

/// Predictor of [D17], in the form that stays finite for U -> 1, (C9):
///
///   q = (1 - U)(1 + theta2 P),  a = theta1 eps omega sin(omega sigma + phase)/c(sigma)^2,  den = 1 - a (L - P) q
///   dP/dtheta = c(sigma) (U - theta2 (1 - U) P)/den,     dsigma/dtheta = q/den
///   from theta = t - (L - x)/c(t), P = x, sigma = t   to   theta = time of effect
///
/// It needs eps, omega and the phase of the plant, and it integrates over the whole delay at every call, RK4, restarted
/// where U jumps, steps of at most 1 mm conveyed. Where den is not positive it refuses: kInfeasible.
/// Real time: no heap after construction; cost grows with the delay (about 0.1 us per step).
class PaperPredictor {
 public:
  /// @param samples  how many changes of U are kept.
  /// @throws std::invalid_argument if the model's speed, length or fluctuation is out of range.
  explicit PaperPredictor(const BizoneModel& model, std::size_t samples = 65536);

  /// Forgets all; before t the filling ratio was U.
  void start(double t_s, double U) noexcept;
  /// From the end of the history up to t_to, U has been applied. No effect if t_to is not after it.
  void feed(double t_to_s, double U) noexcept;

  /// As ExactPredictor::predict(), on the time axis.
  [[nodiscard]] PaperPrediction predict(double t_measured_s, double x_measured_m,
                                        std::span<const TimedFeed> ahead = {}) const noexcept;

  [[nodiscard]] double newest_s() const { return samples_.back().t_to_s; }

  /// Below this the answer is refused: the step size no longer resolves 1/den.
  static constexpr double kMinDenominator = 1e-3;

 private:
  struct State {
    double P = 0.0, sigma = 0.0;
  };
  [[nodiscard]] std::size_t find_sample(double t) const noexcept;
  [[nodiscard]] double calc_speed_m_per_s(double t) const noexcept;
  [[nodiscard]] State calc_rate(const State& at, double U, double& min_den) const noexcept;
  void integrate(State& state, double span_s, double U, double& min_den) const noexcept;

  BizoneModel model_;
  Ring<TimedFeed> samples_;  // The oldest one holds for ever before its end.
  bool forgotten_ = false;   // The ring has wrapped: what was before the oldest sample is gone.
};

/// Which of the sufficient conditions of [D17], Theorem 3, the parameters fulfil.
enum class Theorem3 { kNone, k93, k94, k95 };

/// Sufficient, not necessary: the predictor itself decides by its denominator.
[[nodiscard]] Theorem3 check_theorem3(const BizoneModel& model);

}  // namespace meltbench::law
