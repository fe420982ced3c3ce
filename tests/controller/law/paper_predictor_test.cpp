#include "controller/law/paper_predictor.hpp"

#include <catch2/catch.hpp>
#include <cmath>
#include <limits>

using namespace meltbench::law;

namespace {

BizoneModel model(double theta1, double eps, double omega) {
  BizoneModel m;
  m.speed_m_per_s = theta1;
  m.fluctuation = eps;
  m.fluctuation_rad_per_s = omega;
  return m;
}

PaperPredictor three_levels(const BizoneModel& m, double t, double unit) {
  PaperPredictor predictor{m};
  predictor.start(t - 3 * unit, 0.6);
  predictor.feed(t - unit, 0.2);
  predictor.feed(t, 0.5);
  return predictor;
}

}  // namespace

TEST_CASE("Paper predictor: the reference vectors", "[law]") {
  const PaperPrediction slow = three_levels(model(0.015, 0.1, 4.0 / 60.0), 37.0, 1.0).predict(37.0, 0.12);
  CHECK(slow.status == PredictionStatus::kOk);
  CHECK(slow.P_m == Approx(0.142914515744).margin(1e-10).epsilon(0));  // RK4, steps of 1 mm conveyed.
  CHECK(slow.sigma_s == Approx(41.192607586883).margin(1e-8).epsilon(0));
  CHECK(slow.residual_s == Approx(0.0).margin(1e-8));

  const double t = 37.0 / 60.0;
  const PaperPrediction paper = three_levels(model(0.9, 0.1, 4.0), t, 1.0 / 60.0).predict(t, 0.12);
  CHECK(paper.P_m == Approx(0.142914515744).margin(1e-10).epsilon(0));
  CHECK(paper.sigma_s == Approx(0.686543459781).margin(1e-9).epsilon(0));
  CHECK(paper.min_denominator > 0.5);
}

TEST_CASE("Paper predictor: refuses where its denominator is not positive", "[law]") {
  const PaperPrediction phys = three_levels(model(0.015, 0.1, 4.0), 37.0, 1.0).predict(37.0, 0.12);
  CHECK(phys.status == PredictionStatus::kInfeasible);
  CHECK_FALSE(phys.usable());
  CHECK(phys.min_denominator < PaperPredictor::kMinDenominator);
}

TEST_CASE("Paper predictor: without fluctuation it is the exact one", "[law]") {
  const BizoneModel even = model(0.015, 0.0, 0.0);
  ExactPredictor exact{{}};
  exact.start(0.015 * 34.0, 0.6);
  exact.feed(0.015 * 36.0, 0.2);
  exact.feed(0.015 * 37.0, 0.5);
  CHECK(three_levels(even, 37.0, 1.0).predict(37.0, 0.12).P_m ==
        Approx(exact.predict(0.015 * 37.0, 0.12).P_m).margin(1e-11).epsilon(0));
  // Only in the past, and with commands on their way too.
  const TimedFeed in_flight[] = {{37.5, 0.3}};
  const FeedStretch stretch[] = {{0.015 * 37.5, 0.3}};
  CHECK(three_levels(even, 37.0, 1.0).predict(36.5, 0.11, in_flight).P_m ==
        Approx(exact.predict(0.015 * 36.5, 0.11, stretch).P_m).margin(1e-11).epsilon(0));
}

TEST_CASE("Paper predictor: the error shrinks with the fourth power of the step", "[law]") {
  // A history cut into pieces of half a millimetre halves the step: the answer must not move by more than the error.
  const BizoneModel m = model(0.9, 0.4, 0.8);
  PaperPredictor whole{m}, cut{m};
  whole.start(1.0, 0.3);
  cut.start(1.0, 0.3);
  whole.feed(1.1, 0.8);
  for (int i = 1; i <= 360; ++i) cut.feed(1.0 + 0.1 * i / 360.0, 0.8);
  CHECK(whole.predict(1.1, 0.1).P_m == Approx(cut.predict(1.1, 0.1).P_m).margin(1e-11).epsilon(0));
}

TEST_CASE("Paper predictor: a wrapped memory says so, nonsense is refused", "[law]") {
  PaperPredictor predictor{model(0.015, 0.1, 4.0 / 60.0), 8};
  predictor.start(0.0, 0.2);
  for (int i = 1; i <= 100; ++i) predictor.feed(0.1 * i, 0.3);
  CHECK(predictor.predict(10.0, 0.1).status == PredictionStatus::kHistoryTooShort);
  CHECK(predictor.predict(10.0, 0.2).status == PredictionStatus::kOk);  // No delay, no history needed.
  CHECK(predictor.predict(std::numeric_limits<double>::quiet_NaN(), 0.1).status == PredictionStatus::kBadInput);
  BizoneModel bad = model(0.015, 1.0, 4.0);
  CHECK_THROWS_WITH(PaperPredictor{bad}, Catch::Contains("fluctuation = 1"));
}

TEST_CASE("Theorem 3: what each reading of the screw speed fulfils", "[law]") {
  for (const auto& [eps, omega] : {std::pair{0.1, 4.0}, std::pair{0.4, 0.8}}) {
    CHECK(check_theorem3(model(0.9, eps, omega)) == Theorem3::k93);
    CHECK(check_theorem3(model(0.0942478, eps, omega)) == Theorem3::kNone);
    CHECK(check_theorem3(model(0.015, eps, omega)) == Theorem3::kNone);
    CHECK(check_theorem3(model(0.015, eps, omega / 60.0)) == Theorem3::k93);
  }
  CHECK(check_theorem3(model(0.5, 0.1, 12.0)) == Theorem3::k94);
}
