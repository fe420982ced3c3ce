#include "tests/melt/melt_loop.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace meltbench::melt_loop {
namespace {

double quantise(double value, double quantum) {
  return quantum > 0.0 ? std::round(value / quantum) * quantum : value;
}

bool is_silent(const Silence& silence, double t) {
  return t >= silence.from_s && t < silence.to_s;
}

double calc_observer_error(const plant::MeltFront& plant, const estimator::MeltObserver& observer) {
  double worst = 0.0;
  for (std::size_t i = 0; i < observer.nodes().size(); ++i) {
    worst = std::max(worst, std::abs(observer.T_degC()[i] - plant.T_degC(plant.front_m() * observer.nodes()[i])));
  }
  return worst;
}

}  // namespace

Preset paper_preset() {
  return {"paper", plant::paper_melt_parameters(), law::hdpe_melt_model(2e4)};
}

Preset bench_preset() {
  return {"bench", plant::bench_melt_parameters(), law::hdpe_melt_model(9e4)};
}

Preset preset_named(std::string_view name) {
  if (name == "paper") return paper_preset();
  if (name == "bench") return bench_preset();
  throw std::invalid_argument("no such preset");
}

double Run::front_at_m(double t_s) const {
  for (std::size_t i = 0; i < samples.size(); ++i) {
    if (samples[i].t_s < t_s - 1e-9) continue;
    if (i == 0) return samples[0].front_m;
    const Sample &a = samples[i - 1], &b = samples[i];
    return a.front_m + (t_s - a.t_s) / (b.t_s - a.t_s) * (b.front_m - a.front_m);
  }
  return samples.back().front_m;
}

double Run::settle_s() const {
  double last = 0.0;
  for (const Sample& sample : samples) {
    if (std::abs(sample.front_m - front_set_m) > 0.02 * std::abs(front_set_m - front_start_m)) last = sample.t_s;
  }
  return last;
}

double Run::integral_of_error_mm_s() const {
  double sum = 0.0;
  double t = 0.0;
  double error = std::abs(front_start_m - front_set_m);
  for (const Sample& sample : samples) {
    const double next = std::abs(sample.front_m - front_set_m);
    sum += 0.5 * (error + next) * (sample.t_s - t);
    t = sample.t_s;
    error = next;
  }
  return 1e3 * sum;
}

double Run::largest(double Sample::*what) const {
  double value = samples.front().*what;
  for (const Sample& sample : samples) value = std::max(value, sample.*what);
  return value;
}

double Run::smallest(double Sample::*what) const {
  double value = samples.front().*what;
  for (const Sample& sample : samples) value = std::min(value, sample.*what);
  return value;
}

Run run(const Settings& settings, law::MeltLaw& law) {
  const double b = settings.speed_m_per_s;
  const double dt = settings.sample_s;
  const auto reference =
      law::calc_melt_reference(settings.preset.model, settings.T_barrel_degC, b, settings.front_set_m).value();

  plant::MeltFront plant{settings.preset.plant,
                         {.solid = settings.solid,
                          .solid_cells = settings.plant_cells,
                          .grid_speed_m_per_s = b,
                          .max_travel_m = settings.max_travel_m,
                          .max_step_s = 1.0}};
  plant.start_linear(settings.front_start_m, settings.T_inlet_start_degC);
  const auto& solid = settings.preset.model.solid;
  estimator::MeltObserver observer{{.conductivity_W_per_mK = solid.conductivity_W_per_mK,
                                    .diffusivity_m2_per_s = solid.diffusivity_m2_per_s(),
                                    .exchange_rate_1_per_s = solid.exchange_rate_1_per_s(),
                                    .T_melt_degC = settings.preset.model.T_melt_degC,
                                    .length_m = settings.preset.model.length_m,
                                    .front_speed_per_flux_m3_per_J = reference.front_speed_per_flux_m3_per_J},
                                   {.cells = settings.observer_cells,
                                    .grid_speed_m_per_s = b,
                                    .max_travel_m = settings.max_travel_m,
                                    .max_step_s = 1.0}};
  observer.start_linear(settings.front_start_m, settings.T_inlet_guess_degC);

  Run result;
  result.front_set_m = settings.front_set_m;
  result.front_start_m = settings.front_start_m;
  std::vector<double> fronts{plant.front_m()}, inlets{plant.T_inlet_degC()};
  double held_front = plant.front_m(), held_inlet = plant.T_inlet_degC();
  double Y1 = held_front, Y2 = held_inlet;

  const auto count = static_cast<long>(std::lround(settings.duration_s / dt));
  for (long k = 0; k < count; ++k) {
    const double t = static_cast<double>(k) * dt;
    law::MeltObservation seen{Y1, Y2, observer.nodes(), observer.T_degC()};
    if (settings.full_state) seen = {Y1, Y2, plant.solid_nodes(), plant.solid_T_degC()};
    law::MeltCommand command = law.update(reference, seen, dt);
    const double Z = -reference.loop_gain_W_per_m2K * (command.T_reference_degC - reference.T_inlet_degC);

    plant::MeltInlet inlet;
    if (settings.placement == Placement::kBoard) {
      inlet = plant::MeltInlet::local_loop(command.feedforward_W_per_m2, command.gain_W_per_m2K,
                                           command.T_reference_degC - settings.T_bias_K);
    } else {
      if (settings.placement == Placement::kCapped) command = law::limit_melt_gain(command, reference, dt);
      inlet = plant::MeltInlet::flux(command.calc_flux_W_per_m2(Y2));
    }
    inlet.min_W_per_m2 = settings.flux_min_W_per_m2;
    inlet.max_W_per_m2 = settings.flux_max_W_per_m2;
    if (inlet.gain_W_per_m2K == 0.0) {
      inlet.feedforward_W_per_m2 =
          std::clamp(inlet.feedforward_W_per_m2, settings.flux_min_W_per_m2, settings.flux_max_W_per_m2);
    }
    result.status = plant.advance(dt, {b, inlet, plant::MeltBarrel::uniform(settings.T_barrel_degC)});
    result.ended_s = t + dt;

    fronts.push_back(plant.front_m());
    inlets.push_back(plant.T_inlet_degC() + settings.T_bias_K);
    const auto age = std::min<std::size_t>(static_cast<std::size_t>(settings.delay_samples), fronts.size() - 1);
    const bool front_silent = is_silent(settings.front_silent, t + dt);
    const bool inlet_silent = is_silent(settings.inlet_silent, t + dt);
    if (!front_silent) held_front = quantise(fronts[fronts.size() - 1 - age], settings.front_quantum_m);
    if (!inlet_silent) held_inlet = quantise(inlets[inlets.size() - 1 - age], settings.T_quantum_K);
    estimator::MeltObserverInput input{.speed_m_per_s = b,
                                       .T_barrel_degC = settings.T_barrel_degC,
                                       .inlet_flux_W_per_m2 = plant.mean_inlet_flux_W_per_m2(),
                                       .liquid_front_flux_W_per_m2 = reference.front_flux_W_per_m2,
                                       .front_m = held_front,
                                       .T_inlet_degC = held_inlet};
    if (settings.on_silence == OnSilence::kModel) {
      if (front_silent) input.front_m.reset();
      if (inlet_silent) input.T_inlet_degC.reset();
    }
    if (observer.advance(dt, input) == estimator::MeltObserverStatus::kTripped) result.observer_tripped = true;
    Y1 = input.front_m.value_or(observer.front_m());
    Y2 = input.T_inlet_degC.value_or(observer.T_inlet_degC());

    result.samples.push_back({t + dt, plant.front_m(), plant.T_inlet_degC(), plant.inlet_flux_W_per_m2(), Z,
                              calc_observer_error(plant, observer)});
    const auto validity = plant.validity();
    result.worst_solid_margin_K = std::min(result.worst_solid_margin_K, validity.solid_margin_K);
    result.worst_liquid_margin_K = std::min(result.worst_liquid_margin_K, validity.liquid_margin_K);
    if (result.status != plant::MeltStatus::kRunning) break;
  }
  result.front_flux_W_per_m2 = plant.solid_front_flux_W_per_m2();
  return result;
}

Run run(const Settings& settings) {
  law::BacksteppingMeltLaw law;
  return run(settings, law);
}

}  // namespace meltbench::melt_loop
