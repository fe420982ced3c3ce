#include "controller/law/exact_predictor.hpp"

#include <catch2/catch.hpp>
#include <cmath>
#include <deque>
#include <limits>
#include <random>
#include <vector>

#include "controller/law/bizone_model.hpp"

using namespace meltbench::law;

namespace {

const double kTheta2 = BizoneModel{}.theta2_per_m;
constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

/// Prediction by walking through the history, stretch by stretch: the referee of the constant-time one.
class StretchByStretch {
 public:
  StretchByStretch(double s, double U) : U_before_{U}, begin_{s} {}

  void feed(double s_to, double U) {
    stretches_.push_back({s_to, U});
    while (s_to - stretches_.front().s_to_m > 0.5) {
      U_before_ = stretches_.front().U;
      begin_ = stretches_.front().s_to_m;
      stretches_.pop_front();
    }
  }

  [[nodiscard]] double predict(double s_measured, double x) const {
    double y = s_measured - (0.2 - x), P = x;
    const auto walk = [&](double to, double U) {
      const double r = kTheta2 * (1.0 - U);
      P = P * std::exp(-r * (to - y)) + U * (1.0 - std::exp(-r * (to - y))) / r;
      y = to;
    };
    if (begin_ > y) walk(begin_, U_before_);
    for (const FeedStretch& stretch : stretches_) {
      if (stretch.s_to_m > y) walk(stretch.s_to_m, stretch.U);
    }
    return P;
  }

 private:
  double U_before_, begin_;
  std::deque<FeedStretch> stretches_;
};

class Random {
 public:
  double operator()(double low, double high) {
    return low + (high - low) * static_cast<double>(engine_() >> 11) * 0x1p-53;
  }

 private:
  std::mt19937_64 engine_{11};
};

/// Conveyed length of the bench's screw.
double conveyed(double theta1, double eps, double omega, double t) {
  return theta1 * (t + eps * std::sin(omega * t) / omega);
}

}  // namespace

TEST_CASE("Exact predictor: the reference vectors", "[law]") {
  // x = 0.12 m at t; U was .6 until t - 3 delays of the unit, .2 until t - 1, .5 until t. `unit` is the time scale.
  struct Vector {
    double theta1, omega, t, unit, exact, state_only, U;
  };
  const Vector vectors[] = {
      {0.015, 4.0 / 60.0, 37.0, 1.0, 0.142673196149, 0.141551995094, 0.655234017446},
      {0.015, 4.0, 37.0, 1.0, 0.141491937659, 0.141551995094, 0.670936107174},
      {0.9, 4.0, 37.0 / 60.0, 1.0 / 60.0, 0.142673196149, 0.141551995094, 0.655234017446},
  };
  for (const Vector& v : vectors) {
    ExactPredictor exact{{}}, state_only{{}};
    const auto s = [&](double t) { return conveyed(v.theta1, 0.1, v.omega, t); };
    exact.start(s(v.t - 3 * v.unit), 0.6);
    exact.feed(s(v.t - v.unit), 0.2);
    exact.feed(s(v.t), 0.5);
    CHECK(exact.predict(s(v.t), 0.12).P_m == Approx(v.exact).margin(1e-11).epsilon(0));
    state_only.start(v.theta1 * (v.t - 3 * v.unit), 0.6);
    state_only.feed(v.theta1 * (v.t - v.unit), 0.2);
    state_only.feed(v.theta1 * v.t, 0.5);
    CHECK(state_only.predict(v.theta1 * v.t, 0.12).P_m == Approx(v.state_only).margin(1e-11).epsilon(0));
  }
}

TEST_CASE("Exact predictor: equals the walk through the history, over a million updates and without drift", "[law]") {
  Random random;
  ExactPredictor predictor{{}};
  predictor.start(0.0, 0.2);
  StretchByStretch referee{0.0, 0.2};
  double s = 0.0, worst = 0.0;
  for (int k = 1; k <= 1'000'000; ++k) {
    s += random(2e-5, 3e-4);
    const double U = random(0.0, 0.95);
    predictor.feed(s, U);
    referee.feed(s, U);
    if (k % 997 != 0) continue;  // The referee is slow.
    const double x = random(0.0, 0.2), age = random(0.0, 0.05);
    worst = std::max(worst, std::abs(predictor.predict(s - age, x).P_m - referee.predict(s - age, x)));
  }
  CHECK(worst < 1e-9);
  CHECK(worst < 1e-12);  // What rounding gives: A grows to 300 here, R stays of order 1.
}

TEST_CASE("Exact predictor: late, repeated and reordered measurements need no care", "[law]") {
  ExactPredictor predictor{{}};
  StretchByStretch referee{0.0, 0.3};
  predictor.start(0.0, 0.3);
  Random random;
  double s = 0.0;
  for (int k = 0; k < 3000; ++k) {
    s += 1.5e-4;
    const double U = random(0.0, 0.6);
    predictor.feed(s, U);
    referee.feed(s, U);
  }
  double worst = 0.0;
  for (int k = 0; k < 500; ++k) {  // Time stamps in any order.
    const double age = random(0.0, 0.15), x = random(0.0, 0.2);
    worst = std::max(worst, std::abs(predictor.predict(s - age, x).P_m - referee.predict(s - age, x)));
  }
  CHECK(worst < 1e-13);
}

TEST_CASE("Exact predictor: commands on their way extend the window", "[law]") {
  ExactPredictor waits{{}}, knows{{}};
  for (ExactPredictor* predictor : {&waits, &knows}) predictor->start(0.0, 0.2);
  waits.feed(0.05, 0.6);
  knows.feed(0.05, 0.6);
  knows.feed(0.06, 0.1);
  knows.feed(0.065, 0.4);
  const FeedStretch in_flight[] = {{0.06, 0.1}, {0.065, 0.4}};
  CHECK(waits.predict(0.05, 0.12, in_flight).P_m == Approx(knows.predict(0.05, 0.12).P_m).margin(1e-15).epsilon(0));
  // A measurement newer than the history, in a barrel that is nearly full: only the commands matter.
  CHECK(waits.predict(0.058, 0.2, in_flight).P_m ==
        Approx(calc_affine_step(calc_affine_step(0.2, 0.002, 0.1, kTheta2), 0.005, 0.4, kTheta2)).margin(1e-15));
}

TEST_CASE("Exact predictor: a full barrel has no delay, so the prediction is the measurement", "[law]") {
  ExactPredictor predictor{{}};
  predictor.start(0.0, 0.5);
  predictor.feed(0.3, 0.9);
  CHECK(predictor.predict(0.3, 0.2).P_m == Approx(0.2).margin(1e-15).epsilon(0));
  CHECK(predictor.predict(0.3, 7.0).P_m == Approx(0.2).margin(1e-15).epsilon(0));  // Clamped to L.
}

TEST_CASE("Exact predictor: at rest it predicts rest, however old the past", "[law]") {
  ExactPredictor predictor{{}};
  const double U = BizoneModel{}.holding_ratio(0.1);
  predictor.start(5.0, U);
  CHECK(predictor.predict(5.0, 0.1).P_m == Approx(0.1).margin(1e-15).epsilon(0));
  CHECK(predictor.predict(5.0, 0.1).status == PredictionStatus::kOk);
  for (int k = 1; k <= 5000; ++k) predictor.feed(5.0 + 1e-3 * k, U);
  CHECK(predictor.predict(predictor.newest_m(), 0.1).P_m == Approx(0.1).margin(1e-14).epsilon(0));
}

TEST_CASE("Exact predictor: a measurement older than the memory says so and still gives a number", "[law]") {
  ExactPredictor::Settings settings;
  settings.window_m = 0.25;
  settings.ds_min_m = 0.005;
  ExactPredictor predictor{settings};
  predictor.start(0.0, 0.2);
  for (int k = 1; k <= 1000; ++k) predictor.feed(0.01 * k, 0.3);
  CHECK(predictor.predict(10.0, 0.1).status == PredictionStatus::kOk);
  const Prediction old = predictor.predict(2.0, 0.1);
  CHECK(old.status == PredictionStatus::kHistoryTooShort);
  CHECK(old.usable());
  CHECK(std::isfinite(old.P_m));
}

TEST_CASE("Exact predictor: a crawling screw is merged within the memory, at equal mass", "[law]") {
  ExactPredictor::Settings settings;
  settings.ds_min_m = 1e-4;
  ExactPredictor coarse{settings};
  StretchByStretch referee{0.0, 0.2};
  coarse.start(0.0, 0.2);
  Random random;
  double s = 0.0;
  for (int k = 0; k < 40000; ++k) {
    s += 1e-5;
    const double U = random(0.0, 0.6);
    coarse.feed(s, U);
    referee.feed(s, U);
  }
  CHECK(coarse.stretches() <= 4002);  // window / ds_min + 2.
  // Mass is misplaced by at most a merged stretch: 0.6 * 1e-4 m / 4 at the end, and much less before.
  CHECK(coarse.predict(s, 0.1).P_m == Approx(referee.predict(s, 0.1)).margin(1.5e-5).epsilon(0));
}

TEST_CASE("Exact predictor: nonsense is refused and leaves no trace", "[law]") {
  ExactPredictor predictor{{}};
  predictor.start(0.0, 0.2);
  predictor.feed(0.1, 0.4);
  const double P = predictor.predict(0.1, 0.12).P_m;
  predictor.feed(0.05, 0.9);  // Backwards.
  predictor.feed(kNaN, 0.9);
  predictor.feed(INFINITY, 0.9);
  CHECK(predictor.predict(0.1, 0.12).P_m == P);
  CHECK(predictor.predict(kNaN, 0.12).status == PredictionStatus::kBadInput);
  CHECK_FALSE(predictor.predict(0.1, kNaN).usable());
  predictor.feed(0.12, kNaN);  // A lost value: the last one stands.
  ExactPredictor held{{}};
  held.start(0.0, 0.2);
  held.feed(0.12, 0.4);
  CHECK(predictor.predict(0.12, 0.12).P_m == Approx(held.predict(0.12, 0.12).P_m).margin(1e-15).epsilon(0));
  CHECK_THROWS_WITH(ExactPredictor({.length_m = 0.2, .theta2_per_m = 0.0}), Catch::Contains("theta2_per_m = 0"));
  CHECK_THROWS_WITH(ExactPredictor({.length_m = 0.2, .window_m = 0.1}), Catch::Contains("window_m = 0.1"));
}

TEST_CASE("Affine step: solves its equation, smoothly down to no length and up to a full channel", "[law]") {
  // dP/dy = U - theta2 (1 - U) P by RK4 in 1000 pieces: error below 1e-15.
  for (const double U : {0.0, 0.25, 0.9, 0.999, 1.0}) {
    const auto slope = [&](double at) { return U - kTheta2 * (1.0 - U) * at; };
    double P = 0.07;
    const double h = 0.1 / 1000;
    for (int i = 0; i < 1000; ++i) {
      const double k1 = slope(P), k2 = slope(P + h / 2 * k1), k3 = slope(P + h / 2 * k2), k4 = slope(P + h * k3);
      P += h * (k1 + 2 * k2 + 2 * k3 + k4) / 6;
    }
    CHECK(calc_affine_step(0.07, 0.1, U, kTheta2) == Approx(P).margin(1e-14).epsilon(0));
    CHECK(calc_affine_step(0.07, 0.0, U, kTheta2) == 0.07);
    CHECK(calc_affine_step(0.07, 1e-12, U, kTheta2) == Approx(0.07 + 1e-12 * slope(0.07)).margin(1e-16).epsilon(0));
  }
}
