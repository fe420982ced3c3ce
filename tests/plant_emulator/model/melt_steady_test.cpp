#include "plant_emulator/model/melt_steady.hpp"

#include <catch2/catch.hpp>
#include <cmath>
#include <stdexcept>

namespace meltbench::plant {
namespace {

struct Row {
  bool bench;
  double b, q1, q2, q3, q4, p3, K, q_f, T0, T_nozzle;
};

// Computed with 60 digits from (11)-(19); s_r = 50 mm, T_b = 145 degC.
constexpr Row kRows[] = {
    {false, 2e-3, 12715.9655, -4.85440095, 9709.14186, -5.52255840, -1.34422241e-3, 15.7282591, -27.1463596, 131.821607,
     137.176366},
    {false, 10e-3, 63556.5268, -.971236129, 48519.2016, -1.10511511, -5.38882915e-5, 3.14680506, -4.35623479,
     134.431948, 135.478726},
    {false, 50e-3, 317777.972, -.194250076, 242590.704, -.221027855, -2.15572311e-6, .629370245, -.833595395,
     134.888875, 135.097620},
    {true, 2e-3, 12732.9268, -21.8157052, 9728.42157, -24.8022623, -6.00050538e-3, 70.6828849, -319.531541, 110.460694,
     141.658958},
};

TEST_CASE("Melt steady state: every figure agrees with 60-digit arithmetic at all three speeds", "[plant][melt]") {
  for (const Row& row : kRows) {
    CAPTURE(row.bench, row.b);
    const auto steady =
        calc_melt_steady_state(row.bench ? bench_melt_parameters() : paper_melt_parameters(), 145.0, row.b, 50e-3);
    const double nine_digits = 1e-8;  // The table is printed with nine digits.
    CHECK(steady.q1_1_per_m == Approx(row.q1).epsilon(nine_digits));
    CHECK(steady.q2_1_per_m == Approx(row.q2).epsilon(nine_digits));
    CHECK(steady.q3_1_per_m == Approx(row.q3).epsilon(nine_digits));
    CHECK(steady.q4_1_per_m == Approx(row.q4).epsilon(nine_digits));
    CHECK(steady.p2_K == Approx(-10.0).epsilon(1e-12));
    CHECK(steady.p3_K == Approx(row.p3).epsilon(nine_digits));
    CHECK(steady.front_flux_W_per_m2 == Approx(row.K).epsilon(nine_digits));
    CHECK(steady.inlet_flux_W_per_m2 == Approx(row.q_f).epsilon(nine_digits));
    CHECK(steady.T_inlet_degC() == Approx(row.T0).epsilon(nine_digits));
    CHECK(steady.T_liquid_degC(0.1) == Approx(row.T_nozzle).epsilon(nine_digits));
  }
}

TEST_CASE("Melt steady state: fields solve (8)-(10) for any speed, coupling and set point", "[plant][melt]") {
  for (const double hbar : {2e4, 9e4, 3e5}) {
    for (const double b : {0.5e-3, 2e-3, 10e-3, 50e-3}) {
      for (const double s_r : {5e-3, 50e-3, 95e-3}) {
        CAPTURE(hbar, b, s_r);
        const auto parameters = hdpe_melt_parameters(hbar);
        const auto st = calc_melt_steady_state(parameters, 145.0, b, s_r);
        const double alpha_s = parameters.solid.diffusivity_m2_per_s();
        const double alpha_l = parameters.liquid.diffusivity_m2_per_s();
        const double h_s = parameters.solid.exchange_rate_1_per_s();
        const double h_l = parameters.liquid.exchange_rate_1_per_s();
        // (8): each exponential solves the equation; the residual is measured against its largest term.
        const auto residual = [b](double alpha, double h, double q) {
          return std::abs(alpha * q * q - b * q - h) / (alpha * q * q + b * std::abs(q) + h);
        };
        CHECK(residual(alpha_l, h_l, st.q1_1_per_m) < 1e-14);
        CHECK(residual(alpha_l, h_l, st.q2_1_per_m) < 1e-14);
        CHECK(residual(alpha_s, h_s, st.q3_1_per_m) < 1e-14);
        CHECK(residual(alpha_s, h_s, st.q4_1_per_m) < 1e-14);
        CHECK(st.T_solid_degC(s_r) == Approx(135.0).epsilon(1e-13));
        CHECK(st.T_liquid_degC(s_r) == Approx(135.0).epsilon(1e-13));
        // (9), (10) with the slopes of (11).
        const double e1 = std::exp(-st.q1_1_per_m * (0.1 - s_r));
        const double e2 = std::exp(st.q2_1_per_m * (0.1 - s_r));
        const double slope_l = st.q1_1_per_m * st.P1L_K * e1 + st.q2_1_per_m * st.p2_K;
        const double slope_s = st.q3_1_per_m * st.p3_K + st.q4_1_per_m * st.p4_K;
        const double slope_L = st.q1_1_per_m * st.P1L_K + st.q2_1_per_m * st.p2_K * e2;
        const double slope_0 = st.q3_1_per_m * st.p3_K * std::exp(-st.q3_1_per_m * s_r) +
                               st.q4_1_per_m * st.p4_K * std::exp(-st.q4_1_per_m * s_r);
        CHECK(0.324 * slope_l == Approx(st.front_flux_W_per_m2).epsilon(1e-10));
        CHECK(0.373 * slope_s == Approx(st.front_flux_W_per_m2).epsilon(1e-8));  // p3 q3 and p4 q4 nearly cancel.
        CHECK(0.324 * slope_L == Approx(100.0).epsilon(1e-10));
        CHECK(-0.373 * slope_0 == Approx(st.inlet_flux_W_per_m2).epsilon(1e-12));
      }
    }
  }
}

TEST_CASE("Melt steady state: the window of Lemma 1 is that of (20)-(22)", "[plant][melt]") {
  const double expected[2][3] = {{81.0, 334.0, 1604.0}, {42.0, 88.0, 369.0}};
  const double speeds[3] = {2e-3, 10e-3, 50e-3};
  for (int preset = 0; preset < 2; ++preset) {
    for (int k = 0; k < 3; ++k) {
      CAPTURE(preset, speeds[k]);
      const auto parameters = preset == 0 ? paper_melt_parameters() : bench_melt_parameters();
      const auto window = calc_melt_barrel_window(parameters, speeds[k], 50e-3);
      CHECK(window.upper_K == Approx(expected[preset][k]).margin(0.5));  // Expected values are whole kelvins.
      CHECK(window.lower_K <= 0.0);
      CHECK(window.lower_K > -1e-9);
      // Inside the window the profile rises; just beyond its end the melt cools towards the nozzle.
      const auto inside = calc_melt_steady_state(parameters, 135.0 + 0.99 * window.upper_K, speeds[k], 50e-3);
      const auto outside = calc_melt_steady_state(parameters, 135.0 + 1.5 * window.upper_K, speeds[k], 50e-3);
      CHECK(inside.P1L_K > 0.0);
      CHECK(outside.P1L_K < 0.0);
    }
  }
}

TEST_CASE("Melt steady state: an impossible speed or set point is refused by name and value", "[plant][melt]") {
  CHECK_THROWS_WITH(calc_melt_steady_state(paper_melt_parameters(), 145.0, 0.0, 50e-3),
                    Catch::Matchers::Contains("speed = 0"));
  CHECK_THROWS_WITH(calc_melt_steady_state(paper_melt_parameters(), 145.0, 2e-3, 0.1),
                    Catch::Matchers::Contains("front = 0.1"));
}

}  // namespace
}  // namespace meltbench::plant
