#include "controller/law/bang_bang.hpp"

#include <catch2/catch.hpp>
#include <cmath>

using namespace meltbench::law;

namespace {

auto near(double value) {
  return Approx(value).epsilon(1e-9);
}  // Digits of the reference; bisection is good to 1e-15.

}  // namespace

TEST_CASE("Bang-bang law: gains and curve for x* = 0.16 m are those of the reference", "[law]") {
  const BangBang law{BizoneModel{}, BangBangSettings{}};
  CHECK(law.U_set() == near(0.252776022389));
  CHECK(law.min_slope_per_m() == near(6.319400559718));
  CHECK(law.slope_per_m() == near(36.319400559718));
  CHECK(law.left_gain_per_m() == near(56.108576115664));
  CHECK(law.right_gain_per_m() == near(143.214941118566));
  const std::pair<double, double> curve[] = {{0, 0.9},
                                             {0.01, 0.899938505591},
                                             {0.02, 0.899830732066},
                                             {0.1, 0.877743380924},
                                             {0.15, 0.530736073977},
                                             {0.16, 0.252776022389},
                                             {0.161, 0.218937528139},
                                             {0.17, 0.059733973806},
                                             {0.2, 0.0}};
  for (const auto& [x, U] : curve) CHECK(law.calc_U(x) == near(U).margin(1e-12));
}

TEST_CASE("Bang-bang law: gains and curve for x* = 0.02 m, where the left slope binds", "[law]") {
  BangBangSettings settings;
  settings.x_set_m = 0.02;
  const BangBang law{BizoneModel{}, settings};
  CHECK(law.U_set() == near(0.040570302539));
  CHECK(law.min_slope_per_m() == near(42.971484873073));
  CHECK(law.slope_per_m() == near(72.971484873073));
  CHECK(law.left_gain_per_m() == near(58.615262551062));
  CHECK(law.right_gain_per_m() == near(1798.642857142858));
  CHECK(law.calc_U(0.0) == near(0.9));
  CHECK(law.calc_U(0.01) == near(0.592738321670));
  CHECK(law.calc_U(0.02) == near(0.040570302539));
  for (const double x : {0.1, 0.15, 0.16, 0.161, 0.17, 0.2}) CHECK(law.calc_U(x) == Approx(0.0).margin(1e-12));
}

TEST_CASE("Bang-bang law: at the set point it is the open-loop rate once, not twice", "[law]") {
  // [D17] (22) adds both branches; with h(0) = 1 that gives 2 v*.
  const BangBang law{BizoneModel{}, BangBangSettings{}};
  CHECK(law.calc_U(0.16) == near(0.252776022389));
  CHECK(law.calc_U(0.16) == Approx(law.U_set()).epsilon(1e-15));
}

TEST_CASE("Bang-bang law: the slope at the set point is -S from both sides", "[law]") {
  for (const double x_set : {0.005, 0.02, 0.1, 0.16, 0.195}) {
    BangBangSettings settings;
    settings.x_set_m = x_set;
    const BangBang law{BizoneModel{}, settings};
    const double h = 1e-8;  // Difference error: a h S/2 with a < 2e4, 1e-4 of S; rounding 1e-16/h.
    CHECK((law.calc_U(x_set - h) - law.U_set()) / h == Approx(law.slope_per_m()).epsilon(1e-3));
    CHECK((law.U_set() - law.calc_U(x_set + h)) / h == Approx(law.slope_per_m()).epsilon(1e-3));
  }
}

TEST_CASE("Bang-bang law: it falls with x and stays within what the feeder can do", "[law]") {
  for (const double x_set : {0.01, 0.1, 0.16, 0.19}) {
    BangBangSettings settings;
    settings.x_set_m = x_set;
    const BangBang law{BizoneModel{}, settings};
    double before = law.calc_U(-1.0);
    CHECK(before == Approx(0.9).epsilon(1e-15));
    for (int i = 0; i <= 2200; ++i) {
      const double U = law.calc_U(-0.01 + i * 1e-4);
      CHECK(U <= before);
      CHECK(U >= 0.0);
      before = U;
    }
    CHECK(law.calc_U(5.0) == Approx(0.0).margin(1e-15));
  }
}

TEST_CASE("Bang-bang law: the smallest slope does not depend on the feeder's capacity at x* = 0.16 m", "[law]") {
  const std::pair<double, double> left_gain[] = {{.5, 146.9}, {.8, 66.4}, {.9, 56.1}, {.95, 52.1}, {.99, 49.2}};
  for (const auto& [v_max, a_l] : left_gain) {
    BangBangSettings settings;
    settings.max_fill = v_max;
    const BangBang law{BizoneModel{}, settings};
    CHECK(law.min_slope_per_m() == near(6.319400559718));
    CHECK(law.left_gain_per_m() == Approx(a_l).margin(0.05));  // Printed with 1 decimal.
  }
}

TEST_CASE("Bang-bang law: the gain equation has no root where the slope is the smallest one", "[law]") {
  CHECK(calc_gain_per_m(10.0, 0.1, 1.0) == 0.0);
  CHECK(calc_gain_per_m(9.0, 0.1, 1.0) == 0.0);
  const double a = calc_gain_per_m(10.000001, 0.1, 1.0);  // Just above: a X = 2 (S X/A - 1).
  CHECK(a == Approx(2e-6).epsilon(1e-3));
}

TEST_CASE("Bang-bang law: impossible settings are refused and named", "[law]") {
  const auto make = [](double x_set, double v_max, double dS) {
    return BangBang{BizoneModel{}, BangBangSettings{x_set, v_max, dS}};
  };
  CHECK_THROWS_WITH(make(0.2, 0.9, 30.0), Catch::Contains("x_set_m = 0.2") && Catch::Contains("(0, 0.2)"));
  CHECK_THROWS_WITH(make(0.0, 0.9, 30.0), Catch::Contains("x_set_m"));
  CHECK_THROWS_WITH(make(0.16, 1.0, 30.0), Catch::Contains("max_fill = 1"));
  CHECK_THROWS_WITH(make(0.16, 0.2, 30.0), Catch::Contains("max_fill = 0.2"));
  CHECK_THROWS_WITH(make(0.16, 0.9, 0.0), Catch::Contains("slope_margin_per_m = 0"));
  CHECK_THROWS_WITH(make(NAN, 0.9, 30.0), Catch::Contains("x_set_m"));
}
