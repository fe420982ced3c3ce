// Cost at equal error: the plant's fixed-cost stepper and SUNDIALS CVODE (BDF, band) on the same 100 + 40 cells.
//
// in_loop:  a new inlet flux every 10 ms for 10 T1, T1 = 10 mm/b, as from a controller: what the bench does all day.
// free_run: the same flux doublet with three jumps only, CVODE free to choose its steps in between.
// Counters: error_um = largest deviation of the front from CVODE at 1e-8 on 400 cells, at the ten multiples of T1;
// us_per_input = processor time per 10 ms of process.

#include <benchmark/benchmark.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <ctime>
#include <map>
#include <numbers>
#include <utility>

#include "bench/benchmark/sundials/melt_cvode.hpp"
#include "plant_emulator/model/melt_front.hpp"

namespace meltbench {
namespace {

constexpr double kInput_s = 10e-3;
using Fronts = std::array<double, 10>;

plant::MeltSteadyState make_steady(double b) {
  return plant::calc_melt_steady_state(plant::paper_melt_parameters(), 145.0, b, 50e-3);
}

/// Inlet flux over q_f*: one period of a sine in steps of 10 ms, or the doublet's two rectangles.
double calc_excitation(bool in_loop, double b, double t) {
  const double phase = t * b / 20e-3;
  if (phase >= 1.0 - 1e-9) return 0.0;
  if (in_loop) return -186.5 * std::sin(2.0 * std::numbers::pi * phase);
  return phase < 0.5 - 1e-9 ? -186.5 : 186.5;
}

/// Calls advance(t_end, flux, jumped) for every 10 ms (in_loop) or every T1, and read() at every T1.
template <typename Advance, typename Read>
Fronts drive(bool in_loop, double b, Advance advance, Read read) {
  const double T1 = 10e-3 / b;
  const double q_f = make_steady(b).inlet_flux_W_per_m2;
  Fronts fronts{};
  const auto inputs = std::lround(T1 / kInput_s);
  for (std::size_t slice = 0; slice < fronts.size(); ++slice) {
    const double start = static_cast<double>(slice) * T1;
    if (in_loop) {
      for (long k = 0; k < inputs; ++k) {
        const double t = start + static_cast<double>(k) * kInput_s;
        advance(t + kInput_s, q_f + calc_excitation(true, b, t), t < 20e-3 / b + kInput_s);
      }
    } else {
      advance(start + T1, q_f + calc_excitation(false, b, start), slice < 3);
    }
    fronts[slice] = read();
  }
  return fronts;
}

referee::MeltCvode make_cvode(double b, std::size_t cells, double tolerance) {
  const double coarseness = 100.0 / static_cast<double>(cells);
  return {plant::paper_melt_parameters(),
          145.0,
          {.solid_cells = cells,
           .liquid_cells = 40,
           .grid_speed_m_per_s = b,
           .end_cell = 0.15 * coarseness,
           .growth = std::pow(1.3, coarseness),
           .relative_tolerance = tolerance,
           .absolute_tolerance_K = tolerance}};
}

Fronts run_cvode(referee::MeltCvode& cvode, bool in_loop, double b, bool restart_at_jumps) {
  cvode.start_steady(make_steady(b));
  return drive(
      in_loop, b,
      [&](double t, double flux, bool jumped) {
        if (jumped && restart_at_jumps) cvode.restart();
        cvode.advance_to(t, b, plant::MeltInlet::flux(flux));
      },
      [&] { return cvode.front_m(); });
}

Fronts run_plant(plant::MeltFront& front, bool in_loop, double b) {
  front.start_steady(make_steady(b));
  double now = 0.0;
  return drive(
      in_loop, b,
      [&](double t, double flux, bool) {
        front.advance(t - now, {b, plant::MeltInlet::flux(flux), plant::MeltBarrel::uniform(145.0)});
        now = t;
      },
      [&] { return front.front_m(); });
}

const Fronts& reference_of(bool in_loop, double b) {
  static std::map<std::pair<bool, double>, Fronts> known;
  const auto key = std::pair{in_loop, b};
  if (!known.contains(key)) {
    referee::MeltCvode cvode = make_cvode(b, 400, 1e-8);
    known[key] = run_cvode(cvode, in_loop, b, true);
  }
  return known[key];
}

double calc_speed_m_per_s(const benchmark::State& state) {
  return 1e-3 * static_cast<double>(state.range(0));
}

/// Times run(in_loop, b); making the solver is not timed, on either side.
template <typename Run>
void measure(benchmark::State& state, Run run) {
  const double b = calc_speed_m_per_s(state);
  const bool in_loop = state.range(1) != 0;
  const Fronts& expected = reference_of(in_loop, b);
  Fronts fronts{};
  const std::clock_t started = std::clock();  // Processor time: other work on the machine does not count.
  for (auto _ : state) fronts = run(in_loop, b);
  const double took_s = static_cast<double>(std::clock() - started) / CLOCKS_PER_SEC;
  double worst = 0.0;
  for (std::size_t i = 0; i < fronts.size(); ++i) worst = std::max(worst, std::abs(fronts[i] - expected[i]));
  state.counters["error_um"] = 1e6 * worst;
  state.counters["us_per_input"] = 1e6 * took_s / static_cast<double>(state.iterations()) / (100e-3 / b / kInput_s);
}

/// Third argument: travel of the screw per Euler step; 100 um is what the bench runs with.
void melt_front(benchmark::State& state) {
  const double max_travel_m = 1e-6 * static_cast<double>(state.range(2));
  plant::MeltFront front{plant::paper_melt_parameters(),
                         {.grid_speed_m_per_s = calc_speed_m_per_s(state), .max_travel_m = max_travel_m}};
  measure(state, [&](bool in_loop, double b) { return run_plant(front, in_loop, b); });
}
BENCHMARK(melt_front)
    ->ArgNames({"mm_per_s", "in_loop", "travel_um"})
    ->ArgsProduct({{2, 10, 50}, {1, 0}, {100, 50}})
    ->Unit(benchmark::kMillisecond);

/// Third argument: tolerance 10^-n. Fourth: whether it is told of jumps (restarted) or finds out by failing steps.
void melt_cvode(benchmark::State& state) {
  const double tolerance = std::pow(10.0, -static_cast<double>(state.range(2)));
  referee::MeltCvode cvode = make_cvode(calc_speed_m_per_s(state), 100, tolerance);
  measure(state, [&](bool in_loop, double b) { return run_cvode(cvode, in_loop, b, state.range(3) != 0); });
}
BENCHMARK(melt_cvode)
    ->ArgNames({"mm_per_s", "in_loop", "tolerance", "restart"})
    ->ArgsProduct({{2, 10, 50}, {1, 0}, {2, 3, 4, 5}, {1, 0}})
    ->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace meltbench
