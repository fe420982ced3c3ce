/// Cost of the delay extruder's predictors and plants, per update of a control loop.

#include <benchmark/benchmark.h>

#include <cmath>
#include <memory>

#include "controller/law/delay_law.hpp"
#include "controller/law/exact_predictor.hpp"
#include "controller/law/paper_predictor.hpp"
#include "plant_emulator/model/bizone_extruder.hpp"

namespace {

using namespace meltbench;

constexpr double kLength_m = 0.2, kSpeed_m_per_s = 0.015;

/// A feed that differs in every sample, so that nothing can be merged.
double feed_ratio(std::int64_t k) {
  return 0.25 + 0.2 * std::sin(0.01 * static_cast<double>(k));
}

/// One sample of the loop: append what was applied, predict. The argument is the number of samples under way.
void exact_predictor_update(benchmark::State& state) {
  const double delay_m = 0.1;
  const double ds = delay_m / static_cast<double>(state.range(0));
  law::ExactPredictor predictor{{.length_m = kLength_m, .window_m = 2.0 * kLength_m, .ds_min_m = 0.5 * ds}};
  predictor.start(0.0, 0.2);
  std::int64_t k = 0;
  double s = 0.0;
  const auto update = [&] {
    s += ds;
    predictor.feed(s, feed_ratio(++k));
    // The measurement wanders a little and is one sample old.
    return predictor.predict(s - ds, kLength_m - delay_m + 1e-4 * static_cast<double>(k % 7));
  };
  for (std::int64_t i = 0; i < 3 * state.range(0); ++i) update();
  for (auto _ : state) benchmark::DoNotOptimize(update());
}
BENCHMARK(exact_predictor_update)->Arg(666)->Arg(2222)->Arg(22222);

/// The same, integrating over the delay at every update.
void paper_predictor_update(benchmark::State& state) {
  const double delay_s = 0.1 / kSpeed_m_per_s;
  const double dt = delay_s / static_cast<double>(state.range(0));
  law::BizoneModel model;
  law::PaperPredictor predictor{model};
  predictor.start(0.0, 0.2);
  std::int64_t k = 0;
  for (; k < 3 * state.range(0); ++k) predictor.feed(static_cast<double>(k) * dt, feed_ratio(k));
  for (auto _ : state) {
    const double t = static_cast<double>(k) * dt;
    predictor.feed(t, feed_ratio(k++));
    benchmark::DoNotOptimize(predictor.predict(t, 0.1));
  }
}
BENCHMARK(paper_predictor_update)->Arg(666)->Arg(2222)->Unit(benchmark::kMicrosecond);

/// A whole cycle of a law through the seam: encoder, two intervals of feed, answer.
void delay_law_cycle(benchmark::State& state, const char* name) {
  law::DelayLawSettings settings;
  const auto delay_law = law::make_delay_law(name, settings);
  law::MaterialClock clock{kSpeed_m_per_s};
  Instant now{};
  clock.add(now, 0.0);
  delay_law->start(now, 0.2, clock);
  std::int64_t k = 0;
  const auto cycle = [&] {
    const double feed = settings.model.feed_kg_per_s(feed_ratio(++k), kSpeed_m_per_s);
    now += 10ms;
    clock.add(now, kSpeed_m_per_s * to_s(now));
    delay_law->add_feed({now - 8ms, feed}, clock);
    delay_law->add_feed({now, 1.01 * feed}, clock);
    return delay_law->calc({now - 2ms, 0.15, now + 2ms, {}}, clock);
  };
  for (int i = 0; i < 3000; ++i) cycle();
  for (auto _ : state) benchmark::DoNotOptimize(cycle());
}
BENCHMARK_CAPTURE(delay_law_cycle, exact_predictor, "exact_predictor");
BENCHMARK_CAPTURE(delay_law_cycle, uncompensated, "uncompensated");

/// Plant: 10 ms in steps of the given number of microseconds, feeder in kg/s, then all outputs.
void extruder_step(benchmark::State& state, plant::Preset preset) {
  plant::BizoneExtruder extruder{plant::make_parameters(preset, plant::FluctuationCase::kA)};
  const double hold = extruder.parameters().holding_feed_kg_per_s(0.1);
  const Nanos step{state.range(0) * 1000};
  Instant now{};
  std::int64_t k = 0;
  const auto advance = [&] {
    extruder.set_feed_kg_per_s(hold * (1.0 + 0.3 * std::sin(0.01 * static_cast<double>(++k))));
    now += step;
    extruder.advance_to(now);
  };
  for (int i = 0; i < 4000; ++i) advance();
  for (auto _ : state) {
    advance();
    benchmark::DoNotOptimize(extruder.x_m());
  }
}
BENCHMARK_CAPTURE(extruder_step, slow, plant::Preset::kSlow)->Arg(10000)->Arg(1000);
BENCHMARK_CAPTURE(extruder_step, phys, plant::Preset::kPhys)->Arg(10000);
BENCHMARK_CAPTURE(extruder_step, paper_reading, plant::Preset::kPaper)->Arg(10000);

void extruder_outputs(benchmark::State& state) {
  plant::BizoneExtruder extruder{plant::make_parameters(plant::Preset::kSlow, plant::FluctuationCase::kA)};
  for (int i = 1; i < 4000; ++i) extruder.advance_to(Instant{i * 10ms});
  for (auto _ : state) benchmark::DoNotOptimize(extruder.outputs());
}
BENCHMARK(extruder_outputs);

}  // namespace
