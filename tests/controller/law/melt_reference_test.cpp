#include "controller/law/melt_reference.hpp"

#include <catch2/catch.hpp>
#include <cmath>

namespace meltbench::law {
namespace {

struct Row {
  double hbar, b, q3, q4, p3, K, A, d1, d2, q_f, T0;
};

// Computed with 60 digits from (11)-(19), (64), (69); s_r = 50 mm, T_b = 145 degC.
constexpr Row kRows[] = {
    {2e4, 2e-3, 9709.14186, -5.52255840, -1.34422241e-3, 15.7282591, -1.27003921e-3, 9708.50855, -2.84037111,
     -27.1463596, 131.821607},
    {2e4, 10e-3, 48519.2016, -1.10511511, -5.38882915e-5, 3.14680506, -1.27050482e-3, 48519.0746, -.568152206,
     -4.35623479, 134.431948},
    {2e4, 50e-3, 242590.704, -.221027855, -2.15572311e-6, .629370245, -1.27052346e-3, 242590.678, -.113631065,
     -.833595395, 134.888875},
    {9e4, 2e-3, 9728.42157, -24.8022623, -6.00050538e-3, 70.6828849, -5.70756336e-3, 9725.60224, -12.7752569,
     -319.531541, 110.460694},
};

TEST_CASE("Melt reference: profile and gain coefficients agree with 60-digit arithmetic", "[law][melt]") {
  for (const Row& row : kRows) {
    CAPTURE(row.hbar, row.b);
    const auto reference = calc_melt_reference(hdpe_melt_model(row.hbar), 145.0, row.b, 50e-3).value();
    const double nine_digits = 1e-8;  // The table is printed with nine digits.
    CHECK(reference.q3_1_per_m == Approx(row.q3).epsilon(nine_digits));
    CHECK(reference.q4_1_per_m == Approx(row.q4).epsilon(nine_digits));
    CHECK(reference.p3_K == Approx(row.p3).epsilon(nine_digits));
    CHECK(reference.front_flux_W_per_m2 == Approx(row.K).epsilon(nine_digits));
    CHECK(reference.A_1_per_s == Approx(row.A).epsilon(nine_digits));
    CHECK(reference.d1_1_per_m == Approx(row.d1).epsilon(nine_digits));
    CHECK(reference.d2_1_per_m == Approx(row.d2).epsilon(nine_digits));
    CHECK(reference.inlet_flux_W_per_m2 == Approx(row.q_f).epsilon(nine_digits));
    CHECK(reference.T_inlet_degC == Approx(row.T0).epsilon(nine_digits));
    CHECK(reference.gamma_1_per_m == Approx(4851.8097 * row.b / 2e-3).epsilon(1e-7));
    CHECK(reference.loop_gain_W_per_m2K == Approx(955.0 * 1895.0 * row.b / 2.0).epsilon(1e-12));
  }
}

TEST_CASE("Melt reference: d1 and d2 solve the kernel's equation (66) at speeds and couplings of no table",
          "[law][melt]") {
  for (const double hbar : {2e4, 9e4}) {
    for (const double b : {0.7e-3, 10e-3, 50e-3}) {
      CAPTURE(hbar, b);
      const auto model = hdpe_melt_model(hbar);
      const auto r = calc_melt_reference(model, 145.0, b, 50e-3).value();
      const double alpha = model.solid.diffusivity_m2_per_s(), h = model.solid.exchange_rate_1_per_s();
      const double beta = r.front_speed_per_flux_m3_per_J, C = r.front_flux_W_per_m2;
      // A - β b C/α cancels four to five digits here; the closed form in the code does not.
      for (const double d : {r.d1_1_per_m, r.d2_1_per_m}) {
        const double terms = alpha * d * d + std::abs((b + beta * C) * d) + h;
        const double residual = alpha * d * d - (b + beta * C) * d - (r.A_1_per_s - beta * b * C / alpha + h);
        CHECK(std::abs(residual) / terms < 1e-10);
      }
    }
  }
}

TEST_CASE("Melt reference: the profile stays finite and continuous beyond the set point", "[law][melt]") {
  for (const double b : {2e-3, 10e-3, 50e-3}) {
    CAPTURE(b);
    const auto reference = calc_melt_reference(hdpe_melt_model(2e4), 145.0, b, 50e-3).value();
    CHECK(reference.T_degC(50e-3) == Approx(135.0).epsilon(1e-13));
    CHECK(reference.T_degC(50e-3 + 1e-9) == Approx(reference.T_degC(50e-3 - 1e-9)).margin(1e-6));
    CHECK(reference.T_degC(100e-3) > 135.0);
    CHECK(reference.T_degC(100e-3) < 145.0);
  }
}

TEST_CASE("Melt reference: a standing screw or a set point outside the barrel has no reference", "[law][melt]") {
  CHECK_FALSE(calc_melt_reference(hdpe_melt_model(2e4), 145.0, 0.0, 50e-3));
  CHECK_FALSE(calc_melt_reference(hdpe_melt_model(2e4), 145.0, 2e-3, 0.0));
  CHECK_FALSE(calc_melt_reference(hdpe_melt_model(2e4), 145.0, 2e-3, 0.1));
  CHECK_FALSE(calc_melt_reference(hdpe_melt_model(2e4), 145.0, std::nan(""), 50e-3));
}

}  // namespace
}  // namespace meltbench::law
