// Cost of the melt loop's parts per sample: plant, observer, law. The screw speed in mm/s is the argument.

#include <benchmark/benchmark.h>

#include <cstdint>

#include "controller/estimator/melt_observer.hpp"
#include "controller/law/melt_law.hpp"
#include "plant_emulator/model/melt_front.hpp"

namespace meltbench {
namespace {

law::MeltReference make_reference(double b) {
  return law::calc_melt_reference(law::hdpe_melt_model(2e4), 145.0, b, 50e-3).value();
}

estimator::MeltObserver make_observer(double b) {
  const auto model = law::hdpe_melt_model(2e4);
  return {{.conductivity_W_per_mK = model.solid.conductivity_W_per_mK,
           .diffusivity_m2_per_s = model.solid.diffusivity_m2_per_s(),
           .exchange_rate_1_per_s = model.solid.exchange_rate_1_per_s(),
           .T_melt_degC = model.T_melt_degC,
           .length_m = model.length_m,
           .front_speed_per_flux_m3_per_J = 1.0 / (955.0 * 39000.0)},
          {.grid_speed_m_per_s = b}};
}

double speed_of(const benchmark::State& state) {
  return 1e-3 * static_cast<double>(state.range(0));
}

/// One internal step of 100 + 40 cells, 0.1 mm of travel, in mid-transient: the inlet reference swings.
void plant_step(benchmark::State& state) {
  const double b = speed_of(state);
  plant::MeltFront front{plant::paper_melt_parameters(),
                         {.solid = static_cast<plant::MeltDiscretisation>(state.range(1)), .grid_speed_m_per_s = b}};
  front.start_linear(50e-3, 115.0);
  const auto reference = make_reference(b);
  std::int64_t step = 0;
  for (auto _ : state) {
    const double T_reference = reference.T_inlet_degC + ((step++ / 200) % 2 == 0 ? -1.0 : 1.0);
    benchmark::DoNotOptimize(front.advance(
        0.1e-3 / b,
        {b, plant::MeltInlet::local_loop(reference.inlet_flux_W_per_m2, reference.loop_gain_W_per_m2K, T_reference),
         plant::MeltBarrel::uniform(145.0)}));
  }
  if (front.status() != plant::MeltStatus::kRunning) state.SkipWithError("the front was lost");
}
BENCHMARK(plant_step)->ArgNames({"mm_per_s", "scheme"})->ArgsProduct({{2, 10, 50}, {0, 1}});

/// What the controller does per sample at 10 ms: reference for the measured speed, law, observer.
void observer_and_law(benchmark::State& state) {
  const double b = speed_of(state);
  auto observer = make_observer(b);
  observer.start_linear(50e-3, 115.0);
  law::BacksteppingMeltLaw law;
  std::int64_t sample = 0;
  for (auto _ : state) {
    const auto reference = make_reference(b);
    const double front = 50e-3 + ((sample++ / 50) % 2 == 0 ? 10e-6 : 0.0);
    const auto command = law.update(reference, {front, 134.0, observer.nodes(), observer.T_degC()}, 10e-3);
    benchmark::DoNotOptimize(command);
    observer.advance(10e-3, {.speed_m_per_s = b,
                             .T_barrel_degC = 145.0,
                             .inlet_flux_W_per_m2 = reference.inlet_flux_W_per_m2,
                             .liquid_front_flux_W_per_m2 = reference.front_flux_W_per_m2,
                             .front_m = front,
                             .T_inlet_degC = reference.T_inlet_degC});
  }
}
BENCHMARK(observer_and_law)->ArgName("mm_per_s")->Arg(2)->Arg(10)->Arg(50);

void law_alone(benchmark::State& state) {
  const double b = speed_of(state);
  const auto reference = make_reference(b);
  auto observer = make_observer(b);
  observer.start_linear(50e-3, 115.0);
  law::BacksteppingMeltLaw law;
  for (auto _ : state) {
    benchmark::DoNotOptimize(law.update(reference, {50e-3, 134.0, observer.nodes(), observer.T_degC()}, 10e-3));
  }
}
BENCHMARK(law_alone)->ArgName("mm_per_s")->Arg(2)->Arg(10)->Arg(50);

}  // namespace
}  // namespace meltbench
