// SUNDIALS CVODE as the referee of the plant's fixed-cost stepper, and what a step may not do.

#include <array>
#include <catch2/catch.hpp>
#include <cmath>
#include <cstdlib>
#include <new>

#include "bench/benchmark/sundials/melt_cvode.hpp"
#include "tests/melt/melt_loop.hpp"
#include "tests/tools/allocation_counter.hpp"

namespace meltbench::melt_loop {
namespace {

TEST_CASE("Referee: CVODE reproduces the doublet table with 400 cells to 1 um", "[melt][referee]") {
  const double b = 10e-3;
  const auto parameters = plant::paper_melt_parameters();
  referee::MeltCvode cvode{parameters, 145.0, {.grid_speed_m_per_s = b}};
  const auto steady = plant::calc_melt_steady_state(parameters, 145.0, b, 50e-3);
  cvode.start_steady(steady);
  const std::array expected_um{12.23, 963.8, 2190.6, 2229.8};
  for (int i = 1; i <= 8; ++i) {
    const double step = i == 1 ? -186.5 : i == 2 ? 186.5 : 0.0;
    if (i <= 3) cvode.restart();
    cvode.advance_to(i * 1.0, b, plant::MeltInlet::flux(steady.inlet_flux_W_per_m2 + step));
    if (i >= 5) {
      const double shift_um = 1e6 * (cvode.front_m() - 50e-3);
      CHECK(shift_um == Approx(expected_um[static_cast<std::size_t>(i - 5)]).margin(1.0));
    }
  }
}

TEST_CASE("Referee: from the published cold start, plant and CVODE agree on front and profile", "[melt][referee]") {
  for (const double b : {2e-3, 10e-3, 50e-3}) {
    CAPTURE(b);
    const auto parameters = plant::bench_melt_parameters();
    const double coarseness = 0.5;
    referee::MeltCvode cvode{parameters,
                             145.0,
                             {.solid_cells = 200,
                              .liquid_cells = 60,
                              .grid_speed_m_per_s = b,
                              .end_cell = 0.15 * coarseness,
                              .growth = std::pow(1.3, coarseness),
                              .relative_tolerance = 1e-6,
                              .absolute_tolerance_K = 1e-6}};
    plant::MeltFront front{parameters,
                           {.solid_cells = 200, .grid_speed_m_per_s = b, .max_travel_m = 2e-5, .max_step_s = 1.0}};
    cvode.start_linear(20e-3, 115.0);
    front.start_linear(20e-3, 115.0);
    const double gain = 0.5 * 955.0 * 1895.0 * b;
    for (int i = 1; i <= 10; ++i) {
      const double T_reference = i < 4 ? 100.0 : 125.0;
      const auto inlet = plant::MeltInlet::local_loop(-50.0, gain, T_reference);
      if (i == 1 || i == 4) cvode.restart();
      cvode.advance_to(i * 5e-3 / b, b, inlet);
      front.advance(5e-3 / b, {b, inlet, plant::MeltBarrel::uniform(145.0)});
      CHECK(front.front_m() == Approx(cvode.front_m()).margin(0.05e-3));
      // Mean over the granules: both smear the inlet's jumps over a few cells, each in its own way.
      double sum = 0.0;
      const auto nodes = cvode.solid_nodes();
      for (std::size_t j = 0; j < cvode.solid_T_degC().size(); ++j) {
        const double difference = front.T_degC(cvode.front_m() * nodes[j]) - cvode.solid_T_degC()[j];
        sum += (nodes[j + 1] - nodes[j]) * std::abs(difference);
      }
      CHECK(sum < 0.25);
    }
  }
}

TEST_CASE("Referee: at 2 mm/s an inlet that can only cool swings the front to 92 mm and does not lose it",
          "[melt][referee][saturation]") {
  const double b = 2e-3;
  Settings settings;
  settings.speed_m_per_s = b;
  settings.duration_s = 150.0;
  settings.sample_s = 50e-3;
  settings.flux_max_W_per_m2 = 0.0;
  const auto result = run(settings);

  const Preset& preset = settings.preset;
  referee::MeltCvode cvode{preset.plant,
                           145.0,
                           {.solid_cells = 200,
                            .grid_speed_m_per_s = b,
                            .end_cell = 0.075,
                            .growth = std::sqrt(1.3),
                            .relative_tolerance = 1e-6,
                            .absolute_tolerance_K = 1e-6}};
  cvode.start_linear(settings.front_start_m, settings.T_inlet_start_degC);
  const auto reference = law::calc_melt_reference(preset.model, 145.0, b, settings.front_set_m).value();
  const auto& solid = preset.model.solid;
  estimator::MeltObserver observer{{.conductivity_W_per_mK = solid.conductivity_W_per_mK,
                                    .diffusivity_m2_per_s = solid.diffusivity_m2_per_s(),
                                    .exchange_rate_1_per_s = solid.exchange_rate_1_per_s(),
                                    .T_melt_degC = 135.0,
                                    .length_m = 0.1,
                                    .front_speed_per_flux_m3_per_J = reference.front_speed_per_flux_m3_per_J},
                                   {.cells = 200, .grid_speed_m_per_s = b, .max_step_s = 1.0}};
  observer.start_linear(settings.front_start_m, settings.T_inlet_guess_degC);
  law::BacksteppingMeltLaw law;
  double peak_m = 0.0, flux_before = 0.0;
  for (int k = 1; k <= 3000; ++k) {
    const auto command = law.update(
        reference, {cvode.front_m(), cvode.T_inlet_degC(), observer.nodes(), observer.T_degC()}, settings.sample_s);
    auto inlet =
        plant::MeltInlet::local_loop(command.feedforward_W_per_m2, command.gain_W_per_m2K, command.T_reference_degC);
    inlet.max_W_per_m2 = 0.0;
    cvode.restart();
    cvode.advance_to(k * settings.sample_s, b, inlet);
    const double flux = cvode.inlet_flux_W_per_m2();
    observer.advance(settings.sample_s, {.speed_m_per_s = b,
                                         .T_barrel_degC = 145.0,
                                         .inlet_flux_W_per_m2 = 0.5 * (flux + (k == 1 ? flux : flux_before)),
                                         .liquid_front_flux_W_per_m2 = reference.front_flux_W_per_m2,
                                         .front_m = cvode.front_m(),
                                         .T_inlet_degC = cvode.T_inlet_degC()});
    flux_before = flux;
    peak_m = std::max(peak_m, cvode.front_m());
  }
  CHECK(peak_m == Approx(91.8e-3).margin(0.3e-3));  // 91.81 mm with 400 cells and 20 ms; 50 ms add 0.2 mm.
  CHECK(result.largest(&Sample::front_m) == Approx(peak_m).margin(0.3e-3));
  CHECK(result.status == plant::MeltStatus::kRunning);
  CHECK(result.samples.back().front_m == Approx(cvode.front_m()).margin(0.3e-3));
}

TEST_CASE("Melt loop: plant step, observer and law do not allocate", "[melt][real-time]") {
  plant::MeltFront front{plant::paper_melt_parameters(), {}};
  front.start_linear(20e-3, 115.0);
  const auto model = law::hdpe_melt_model(2e4);
  estimator::MeltObserver observer{{.conductivity_W_per_mK = 0.373,
                                    .diffusivity_m2_per_s = model.solid.diffusivity_m2_per_s(),
                                    .exchange_rate_1_per_s = model.solid.exchange_rate_1_per_s(),
                                    .T_melt_degC = 135.0,
                                    .length_m = 0.1,
                                    .front_speed_per_flux_m3_per_J = 1.0 / (955.0 * 39000.0)},
                                   {}};
  observer.start_linear(20e-3, 95.0);
  law::BacksteppingMeltLaw law;
  const std::uint64_t before = test::count_allocations();
  for (int i = 0; i < 100; ++i) {
    const double dt = i % 2 == 0 ? 10e-3 : 50e-3;  // An Euler step, a two-stage step.
    const auto reference = law::calc_melt_reference(model, 145.0, 10e-3, 50e-3);
    const auto command =
        law.update(*reference, {front.front_m(), front.T_inlet_degC(), observer.nodes(), observer.T_degC()}, dt);
    front.advance(dt, {10e-3,
                       plant::MeltInlet::local_loop(command.feedforward_W_per_m2, command.gain_W_per_m2K,
                                                    command.T_reference_degC),
                       plant::MeltBarrel::uniform(145.0)});
    observer.advance(dt, {10e-3, 145.0, front.mean_inlet_flux_W_per_m2(), 0.0, front.front_m(), front.T_inlet_degC()});
  }
  CHECK(test::count_allocations() == before);
  CHECK(front.status() == plant::MeltStatus::kRunning);
}

}  // namespace
}  // namespace meltbench::melt_loop
