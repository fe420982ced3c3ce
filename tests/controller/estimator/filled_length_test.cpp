#include "controller/estimator/filled_length.hpp"

#include <catch2/catch.hpp>
#include <cmath>
#include <limits>

using namespace meltbench;
using namespace meltbench::estimator;

namespace {

/// Pressure of an extruder with these constants, written out: eta theta2 x/(1 + theta2 x) rho0 S c/Kd.
double pressure_Pa(double x, double c) {
  const law::BizoneModel m;
  const double r = m.theta2_per_m * x / (1.0 + m.theta2_per_m * x);
  return m.viscosity_Pa_s * m.mass_per_length_kg_per_m * c * r / m.nozzle_kg;
}

}  // namespace

TEST_CASE("Filled length: pressure and speed give the length back over the whole barrel", "[estimator]") {
  for (double x = 0.0; x <= 0.2; x += 0.005) {
    for (const double c : {0.009, 0.015, 0.021}) {
      const FilledLength estimate = calc_filled_length({}, pressure_Pa(x, c), c);
      CHECK(estimate.x_m == Approx(x).margin(1e-14).epsilon(0));
      CHECK(estimate.usable());
    }
  }
}

TEST_CASE("Filled length: the sensitivity is the derivative, 0.847 m at the set point", "[estimator]") {
  const double p = pressure_Pa(0.16, 0.015), h = 1.0;
  const FilledLength estimate = calc_filled_length({}, p, 0.015);
  CHECK(estimate.x_per_r == Approx(0.847).margin(5e-4));  // Printed with 3 digits.
  const double difference =
      (calc_filled_length({}, p + h, 0.015).x_m - calc_filled_length({}, p - h, 0.015).x_m) / (2.0 * h);
  CHECK(estimate.x_per_Pa == Approx(difference).epsilon(1e-6));
}

TEST_CASE("Filled length: a speed of another instant shows as an error of x", "[estimator]") {
  // 1 % of c is 1 % of r: dx = 0.847 m * 0.2528 * 0.01.
  const FilledLength estimate = calc_filled_length({}, pressure_Pa(0.16, 0.015), 0.015 * 1.01);
  CHECK(estimate.x_m == Approx(0.16 - 0.847 * 0.2528 * 0.01).margin(4e-5).epsilon(0));  // Second order in 1 %.
}

TEST_CASE("Filled length: noise at the ends of the barrel is clamped, more is invalid", "[estimator]") {
  CHECK(calc_filled_length({}, pressure_Pa(0.2, 0.015) * 1.01, 0.015).status == FilledLengthStatus::kClamped);
  CHECK(calc_filled_length({}, pressure_Pa(0.2, 0.015) * 1.01, 0.015).x_m == 0.2);
  CHECK(calc_filled_length({}, -500.0, 0.015).status == FilledLengthStatus::kClamped);
  CHECK(calc_filled_length({}, -500.0, 0.015).x_m == 0.0);
  CHECK(calc_filled_length({}, pressure_Pa(0.25, 0.015), 0.015).status == FilledLengthStatus::kInvalid);
  CHECK(calc_filled_length({}, -50e3, 0.015).status == FilledLengthStatus::kInvalid);
  CHECK(calc_filled_length({}, 1e9, 0.015).status == FilledLengthStatus::kInvalid);  // r > 1.
  CHECK_FALSE(calc_filled_length({}, 1e9, 0.015).usable());
}

TEST_CASE("Filled length: a screw that hardly turns gives no length", "[estimator]") {
  CHECK(calc_filled_length({}, 1000.0, 0.0).status == FilledLengthStatus::kTooSlow);
  CHECK(calc_filled_length({}, 0.0, 0.0).status == FilledLengthStatus::kTooSlow);
  CHECK(calc_filled_length({}, 1000.0, -0.015).status == FilledLengthStatus::kTooSlow);
  CHECK_FALSE(calc_filled_length({}, 1000.0, 1e-6).usable());
}

TEST_CASE("Filled length: a broken number is invalid", "[estimator]") {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  CHECK(calc_filled_length({}, nan, 0.015).status == FilledLengthStatus::kInvalid);
  CHECK(calc_filled_length({}, 1000.0, nan).status == FilledLengthStatus::kInvalid);
  CHECK(calc_filled_length({}, INFINITY, 0.015).status == FilledLengthStatus::kInvalid);
}
