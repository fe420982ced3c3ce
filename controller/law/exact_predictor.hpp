#pragma once
/// Where the filled zone will be when the feed of now arrives there, exactly, in a time that does not grow with the
/// delay.

#include <cstddef>
#include <cstdint>
#include <span>

#include "protocols/time/ring.hpp"

namespace meltbench::law {

enum class PredictionStatus : std::uint8_t {
  kOk,
  kInfeasible,  ///< The paper's denominator is not positive: the predictor is not defined here. P is not to be used.
  kHistoryTooShort,  ///< The measurement is older than the history kept; the oldest known feed stands in for the rest.
  kBadInput,         ///< A number is missing (NaN, infinite). P is not to be used.
};

/// A prediction, and whether it may be used.
struct Prediction {
  double P_m = 0.0;  ///< Filled length when the feed that starts at the time of effect reaches it.
  PredictionStatus status = PredictionStatus::kOk;

  [[nodiscard]] bool usable() const {
    return status == PredictionStatus::kOk || status == PredictionStatus::kHistoryTooShort;
  }
};

/// Feed held up to s_to on the material clock: history, or a command that is on its way.
struct FeedStretch {
  double s_to_m = 0.0;
  double U = 0.0;
};

/// Predictor on the material clock s (metres conveyed), (C6):
///
///   dP/dy = U(y) - theta2 (1 - U(y)) P,   from P = x at y = s_meas - (L - x)   to   y = s_effect
///
/// Uses the flow that was really applied and the encoder; neither a model of the fluctuation nor its future.
/// On s = theta1 t the same class is the state-dependent predictor of [D17] (121)-(125).
///
/// (C6) is affine in P, so the answer needs no integration over the delay, (C7): with one free-running solution R of
/// (C6) and A' = theta2 (1 - U), kept at every change of U,
///
///   P(y) = R(y) + e^{-(A(y) - A(phi))} (x - R(phi))
///
/// Every answer starts from the measurement: nothing drifts, and late, lost or reordered measurements need no care, if
/// only s_meas belongs to the time stamp of x.
///
/// Memory is bounded by window_m / ds_min_m. Stretches shorter than ds_min_m are merged at equal mass (harmless: they
/// come from a crawling screw). A measurement older than the window gives kHistoryTooShort.
/// Real time: no heap after construction; feed() and predict() cost about 30 ns each at any delay.
class ExactPredictor {
 public:
  struct Settings {
    double length_m = 0.2;                                ///< L.
    double theta2_per_m = 2.45e-5 / (9.345e-9 * 1240.0);  ///< theta2.
    double window_m = 0.4;   ///< History kept: L plus what is conveyed while x may stay away.
    double ds_min_m = 1e-5;  ///< Shortest stretch kept: conveyed in the shortest sample time.
  };

  /// @throws std::invalid_argument naming the value if a setting is not positive or the window is shorter than L.
  explicit ExactPredictor(const Settings& settings);

  /// Forgets all; all material that entered before s has filling ratio U.
  void start(double s_m, double U) noexcept;

  /// From the end of the history up to s_to, U has been applied. No effect if s_to is not beyond it.
  /// U is clamped to [0, kMaxFillRatio]; NaN repeats the last one.
  void feed(double s_to_m, double U) noexcept;

  /// Filled length when the feed that enters after the last of `ahead` arrives.
  /// @param s_measured_m  material clock when x was measured; may be older or newer than the history.
  /// @param x_measured_m  clamped to [0, L].
  /// @param ahead         feed after the end of the history, ascending: commands on their way.
  [[nodiscard]] Prediction predict(double s_measured_m, double x_measured_m,
                                   std::span<const FeedStretch> ahead = {}) const noexcept;

  /// End of the history [m].
  [[nodiscard]] double newest_m() const { return knots_.back().s; }
  [[nodiscard]] std::size_t stretches() const { return knots_.size(); }

 private:
  struct Knot {  // State of the free-running solution at the end of a stretch in which U was held.
    double s = 0.0;
    double A = 0.0;  // int theta2 (1 - U) ds.
    double R = 0.0;
    double U = 0.0;
  };
  [[nodiscard]] Knot calc_knot(const Knot& from, double s_to, double U) const noexcept;
  [[nodiscard]] std::size_t find_stretch(double y) const noexcept;

  Settings settings_;
  Ring<Knot> knots_;
  bool forgotten_ = false;        // The ring has wrapped: what was before the oldest knot is gone.
  mutable std::size_t hint_ = 0;  // Distance from the newest knot at which the last answer was found.
};

/// Solution of dP/dy = U - theta2 (1 - U) P after the length d of constant U, (C5).
///   P(d) = P0 e^{-r d} + U (1 - e^{-r d})/r,   r = theta2 (1 - U);   the limit P0 + U d for r d -> 0 is smooth.
[[nodiscard]] double calc_affine_step(double P0_m, double d_m, double U, double theta2_per_m) noexcept;

}  // namespace meltbench::law
