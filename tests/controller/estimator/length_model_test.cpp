#include "controller/estimator/length_model.hpp"

#include <catch2/catch.hpp>

using namespace meltbench;

namespace {

constexpr double kStep_m = 0.00015;  // 10 ms of the published machine at 15 mm/s.

/// Feeds U from the start on, for so many metres conveyed, and measures nothing but what the model says.
double run(estimator::LengthModel& model, double U, double from_m, double length_m) {
  double s = from_m;
  while (s < from_m + length_m) {
    s += kStep_m;
    model.add_feed(U, s);
    model.advance(s, model.x_m());
  }
  return s;
}

}  // namespace

TEST_CASE("Length model: what holds the length holds it, and more arrives after the way to the filled zone",
          "[estimator]") {
  const law::BizoneModel machine;
  estimator::LengthModel model{machine, 0.075};
  model.start(0.1, machine.holding_ratio(0.1), 0.0);
  const double s = run(model, 0.6, 0.0, 0.099);  // L - x = 0.1 m: the new feed is not yet there.
  CHECK(model.x_m() == Approx(0.1).margin(1e-12));
  run(model, 0.6, s, 0.02);
  CHECK(model.x_m() > 0.11);
}

TEST_CASE("Length model: it follows the vectors of the delay plant to its step", "[estimator]") {
  // physics of the slow preset without fluctuation: U = 0 from the start on drains the screw. (D8): P' = -theta2 P.
  const law::BizoneModel machine;
  estimator::LengthModel model{machine, 0.075};
  model.start(0.1, machine.holding_ratio(0.1), 0.0);
  run(model, 0.0, 0.0, 0.3);
  // Mass balance of an emptying screw: dx/ds = -v(x), from s = 0.1 m on: x e^(theta2 x) falls as e^(-theta2 s).
  double x = 0.1;
  for (int i = 0; i < 200'000; ++i) x -= machine.holding_ratio(x) * 1e-6;
  CHECK(model.x_m() == Approx(x).margin(5e-4));  // Steps of 0.15 mm, and the zone recedes from what arrives.
}

TEST_CASE("Length model: it gives in to a measurement within its length", "[estimator]") {
  const law::BizoneModel machine;
  estimator::LengthModel model{machine, 0.075};
  model.start(0.1, machine.holding_ratio(0.1), 0.0);
  double s = 0.0;
  while (s < 0.075) {
    s += kStep_m;
    model.add_feed(machine.holding_ratio(0.1), s);
    model.advance(s, 0.11);
  }
  // One length: 63 % of the difference but for what the balance pulls back.
  CHECK(model.x_m() > 0.105);
  CHECK(model.x_m() < 0.107);
}
