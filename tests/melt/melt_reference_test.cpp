// Writes fixtures/reference/melt_*.csv anew, into the working directory. Hidden, because it takes 20 s:
//
//   melt_tests "[.melt-reference]"
//
// Plant: MeltCvode, an integrator and a discretisation of its own, on a mesh where halving changes nothing printed.

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <catch2/catch.hpp>
#include <cmath>
#include <fstream>
#include <string>

#include "bench/benchmark/sundials/melt_cvode.hpp"
#include "tests/melt/melt_loop.hpp"

namespace meltbench::melt_loop {
namespace {

constexpr std::array kSpeeds_m_per_s{2e-3, 10e-3, 50e-3};

referee::MeltCvode make_referee(const Preset& preset, double T_barrel_degC, double b, std::size_t cells,
                                double tolerance) {
  const double coarseness = 100.0 / static_cast<double>(cells);
  return {preset.plant,
          T_barrel_degC,
          {.solid_cells = cells,
           .liquid_cells = 80,
           .grid_speed_m_per_s = b,
           .end_cell = 0.15 * coarseness,
           .growth = std::pow(1.3, coarseness),
           .relative_tolerance = tolerance,
           .absolute_tolerance_K = tolerance}};
}

void write_doublet(std::ofstream& file) {
  file
      << "# Shift of the front after a doublet of the inlet flux from exact equilibrium at s_r = 50 mm, T_b = 145 "
         "degC:\n"
         "# q_f = q_f* - 186.5 W/m2 for T1 = 10 mm/b, q_f* + 186.5 W/m2 for T1, then q_f*.\n"
         "# Made by tests/melt/melt_reference_test.cpp: CVODE (BDF, 1e-8), third-order upwind, 800 + 80 graded cells;\n"
         "# 400 cells differ by at most 0.8 um. The paper rows agree with a second solver to 0.1 "
         "um.\n"
         "preset,speed_m_per_s,t_over_T1,shift_m\n";
  for (const Preset& preset : {paper_preset(), bench_preset()}) {
    for (const double b : kSpeeds_m_per_s) {
      auto plant = make_referee(preset, 145.0, b, 800, 1e-8);
      const auto steady = plant::calc_melt_steady_state(preset.plant, 145.0, b, 50e-3);
      plant.start_steady(steady);
      for (int i = 1; i <= 15; ++i) {
        const double step = i == 1 ? -186.5 : i == 2 ? 186.5 : 0.0;
        if (i <= 3) plant.restart();
        plant.advance_to(i * 10e-3 / b, b, plant::MeltInlet::flux(steady.inlet_flux_W_per_m2 + step));
        file << fmt::format("{},{:g},{},{:.4e}\n", preset.name, b, i, plant.front_m() - 50e-3);
      }
    }
  }
}

void write_closed_loop(std::ofstream& file) {
  file << "# Output feedback (82) in continuous time: front at six times, last time outside 2 % of the step, integral "
          "of\n"
          "# |s - s_r|, lowest inlet temperature. s_0 = 20 mm, s_r = 50 mm, T_s(0,0) = 115, That(0,0) = 95 degC, c = "
          "100 b/m.\n"
          "# Made by tests/melt/melt_reference_test.cpp: plant CVODE (BDF, 1e-7), 400 + 80 graded cells, the local "
          "inlet\n"
          "# loop inside its right side; observer 400 cells, law and observer every 0.01 mm of screw travel.\n"
          "preset,speed_m_per_s,t1_s,s1_m,t2_s,s2_m,t3_s,s3_m,t4_s,s4_m,t5_s,s5_m,t6_s,s6_m,settle_s,iae_m_s,T_inlet_"
          "min_degC\n";
  const std::array<std::array<double, 6>, 3> times{
      {{10, 20, 30, 40, 60, 120}, {2, 4, 5, 7.5, 10, 15}, {0.4, 0.8, 1, 1.5, 2, 3}}};
  for (const Preset& preset : {paper_preset(), bench_preset()}) {
    for (std::size_t row = 0; row < kSpeeds_m_per_s.size(); ++row) {
      const double b = kSpeeds_m_per_s[row];
      const double dt = 0.01e-3 / b;
      auto plant = make_referee(preset, 145.0, b, 400, 1e-7);
      plant.start_linear(20e-3, 115.0);
      const auto reference = law::calc_melt_reference(preset.model, 145.0, b, 50e-3).value();
      const auto& solid = preset.model.solid;
      estimator::MeltObserver observer{{.conductivity_W_per_mK = solid.conductivity_W_per_mK,
                                        .diffusivity_m2_per_s = solid.diffusivity_m2_per_s(),
                                        .exchange_rate_1_per_s = solid.exchange_rate_1_per_s(),
                                        .T_melt_degC = 135.0,
                                        .length_m = 0.1,
                                        .front_speed_per_flux_m3_per_J = reference.front_speed_per_flux_m3_per_J},
                                       {.cells = 400, .grid_speed_m_per_s = b, .max_step_s = 1.0}};
      observer.start_linear(20e-3, 95.0);
      law::BacksteppingMeltLaw law;
      double settle = 0.0, iae = 0.0, T_min = 1e9;
      std::string line = fmt::format("{},{:g}", preset.name, b);
      std::size_t next = 0;
      const auto count = std::lround(times[row][5] * 1.5 / dt);
      double flux_before = plant.inlet_flux_W_per_m2();
      for (long k = 1; k <= count; ++k) {
        const auto command =
            law.update(reference, {plant.front_m(), plant.T_inlet_degC(), observer.nodes(), observer.T_degC()}, dt);
        const double t = static_cast<double>(k) * dt;
        plant.advance_to(t, b,
                         plant::MeltInlet::local_loop(command.feedforward_W_per_m2, command.gain_W_per_m2K,
                                                      command.T_reference_degC));
        const double flux = plant.inlet_flux_W_per_m2();
        observer.advance(dt, {.speed_m_per_s = b,
                              .T_barrel_degC = 145.0,
                              .inlet_flux_W_per_m2 = k == 1 ? flux : 0.5 * (flux + flux_before),
                              .liquid_front_flux_W_per_m2 = reference.front_flux_W_per_m2,
                              .front_m = plant.front_m(),
                              .T_inlet_degC = plant.T_inlet_degC()});
        flux_before = flux;
        const double error = std::abs(plant.front_m() - 50e-3);
        if (error > 0.02 * 30e-3) settle = t;
        iae += error * dt;
        T_min = std::min(T_min, plant.T_inlet_degC());
        if (next < 6 && t >= times[row][next] - 1e-9) {
          line += fmt::format(",{:g},{:.6f}", times[row][next], plant.front_m());
          ++next;
        }
      }
      file << line << fmt::format(",{:.4f},{:.6f},{:.2f}\n", settle, iae, T_min);
    }
  }
}

TEST_CASE("Reference tables of the melt model are regenerated", "[.melt-reference]") {
  std::ofstream doublet{"melt_doublet.csv"};
  write_doublet(doublet);
  REQUIRE(doublet.good());
  std::ofstream closed_loop{"melt_closed_loop.csv"};
  write_closed_loop(closed_loop);
  REQUIRE(closed_loop.good());
}

}  // namespace
}  // namespace meltbench::melt_loop
