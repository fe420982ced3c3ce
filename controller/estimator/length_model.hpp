#pragma once
/// Filled length from what the feeder delivers: a second source, to hold the pressure against.

#include <cstddef>

#include "controller/law/bizone_model.hpp"
#include "protocols/time/ring.hpp"

namespace meltbench::estimator {

/// The filled length as the mass balance has it, slowly pulled towards what is measured:
///
///   dx/ds = (u - v(x))/(1 - u) + (x_measured - x)/l_c,    u = U where s - (L - x) was conveyed              (E4)
///
/// l_c [m conveyed] is how long the two sources may disagree before the balance gives in. A pressure that is stuck, a
/// feeder that delivers nothing and a nozzle that clogs all show as a difference; a wrong constant of the model only as
/// a small one. Explicit steps, one per encoder sample: 0.15 mm of travel, so no more than 1 mm of x.
/// Real time: no allocation after construction; O(1) per step.
class LengthModel {
 public:
  /// @param correction_m  l_c.
  LengthModel(const law::BizoneModel& model, double correction_m);

  /// Begins at x, with filling ratio U under way and behind.
  void start(double x_m, double U, double s_m);
  [[nodiscard]] bool has_started() const { return started_; }

  /// Feed of filling ratio U has entered up to conveyed length `s_m`.
  void add_feed(double U, double s_m);
  /// Conveys up to `s_m`. @param x_measured_m  newest usable one.
  void advance(double s_m, double x_measured_m);

  [[nodiscard]] double x_m() const { return x_m_; }

 private:
  struct Entered {
    double until_m = 0.0;
    double U = 0.0;
  };
  [[nodiscard]] double ratio_at(double y_m);

  law::BizoneModel model_;
  double correction_m_;
  Ring<Entered> entered_;
  double U_before_ = 0.0;  // Of what is no longer kept.
  double entered_until_m_ = 0.0;
  double s_m_ = 0.0;
  double x_m_ = 0.0;
  bool started_ = false;
};

}  // namespace meltbench::estimator
