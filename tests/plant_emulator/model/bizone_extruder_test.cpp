#include "plant_emulator/model/bizone_extruder.hpp"

#include <catch2/catch.hpp>
#include <cmath>
#include <random>
#include <vector>

using namespace meltbench;
using namespace meltbench::plant;

namespace {

BizoneParameters slow(FluctuationCase fluctuation) {
  return make_parameters(Preset::kSlow, fluctuation);
}

}  // namespace

TEST_CASE("Bizone extruder: an evenly turning screw and a holding feed keep it at rest", "[model]") {
  BizoneExtruder extruder{slow(FluctuationCase::kNone)};
  extruder.advance_to(Instant{100s});
  const BizoneOutputs out = extruder.outputs();
  CHECK(out.x_m == Approx(0.1).margin(1e-13).epsilon(0));
  CHECK(out.delay_s == Approx(0.1 / 0.015).epsilon(1e-12));
  CHECK(out.delay_rate == Approx(0.0).margin(1e-12));
  CHECK(out.flow_kg_per_s == Approx(out.feed_kg_per_s).epsilon(1e-12));
  CHECK(out.encoder_m == Approx(1.5).epsilon(1e-12));
}

TEST_CASE("Bizone extruder: flow and pressure at the set point are those of the nozzle law", "[model]") {
  BizoneParameters p = slow(FluctuationCase::kNone);
  p.x0_m = 0.16;
  const BizoneExtruder extruder{p};
  CHECK(extruder.outputs().flow_kg_per_s == Approx(1.05237e-3).epsilon(1e-5));
  CHECK(extruder.outputs().pressure_Pa == Approx(42954).epsilon(1e-4));  // eta F_d/Kd = 1000 * 1.05237e-3/2.45e-5.
  CHECK(extruder.pressure_Pa() == extruder.outputs().pressure_Pa);
}

TEST_CASE("Bizone extruder: mass fed equals content plus outflow however the steps are cut", "[model]") {
  // A feeder holds kg/s, so U follows 1/c within every step: only the mean of U keeps the mass.
  const auto fluctuation = GENERATE(FluctuationCase::kA, FluctuationCase::kB);
  const auto preset = GENERATE(Preset::kSlow, Preset::kPhys);
  std::vector<double> x;
  for (const Nanos step : {1ms, 10ms, 100ms, 1000ms}) {
    BizoneExtruder extruder{make_parameters(preset, fluctuation)};
    extruder.set_feed_kg_per_s(extruder.parameters().holding_feed_kg_per_s(0.16));
    for (Instant t{step}; t <= Instant{30s}; t += step) extruder.advance_to(t);
    CHECK(extruder.outputs().mass_residual_m == Approx(0.0).margin(1e-8));
    CHECK(extruder.outputs().rejected_feed_kg == 0.0);
    x.push_back(extruder.x_m());
  }
  // A substep of 1 s / 9 conveys 2 mm; 0.1 % of change in U misplaces 1/8 of that share: below 1e-7 m.
  for (const double x_m : x) CHECK(x_m == Approx(x.front()).margin(1e-7).epsilon(0));
}

TEST_CASE("Bizone extruder: the delay is the travel time of the material, by an independent search", "[model]") {
  BizoneExtruder extruder{make_parameters(Preset::kPhys, FluctuationCase::kB)};
  extruder.set_feed_kg_per_s(extruder.parameters().holding_feed_kg_per_s(0.16));
  const ScrewClock clock{0.015, 0.4, 0.8, 0.0};
  for (int i = 1; i <= 60; ++i) {
    extruder.advance_to(Instant{i * 500ms});
    const BizoneOutputs out = extruder.outputs();
    double low = -40.0, high = i * 0.5;  // Bisection on (D7): conveyed since then = L - x.
    for (int k = 0; k < 100; ++k) {
      const double middle = 0.5 * (low + high);
      (clock.conveyed_m(i * 0.5) - clock.conveyed_m(middle) > 0.2 - out.x_m ? low : high) = middle;
    }
    CHECK(out.delay_s == Approx(i * 0.5 - low).margin(1e-11).epsilon(0));
    CHECK(out.feasible);
  }
}

TEST_CASE("Bizone extruder: the delay rate is the derivative of the delay, in both readings", "[model]") {
  const auto reading = GENERATE(DelayReading::kTransport, DelayReading::kPaper);
  BizoneParameters p = make_parameters(Preset::kPaper, FluctuationCase::kA);
  p.delay_reading = reading;
  BizoneExtruder extruder{p};
  extruder.set_feed_kg_per_s(p.holding_feed_kg_per_s(0.16));
  for (int i = 1; i <= 20; ++i) {
    const Instant t{i * 51ms};
    extruder.advance_to(t - 100us);
    const double before = extruder.outputs().delay_s;
    extruder.advance_to(t);
    const BizoneOutputs now = extruder.outputs();
    extruder.advance_to(t + 100us);
    const double difference = (extruder.outputs().delay_s - before) / 2e-4;
    if (std::abs(to_s(t) - 0.102) < 1e-3) continue;            // The first new feed arrives: D has a kink.
    CHECK(now.delay_rate == Approx(difference).margin(5e-4));  // U is a staircase of 0.1 %.
  }
}

TEST_CASE("Bizone extruder: an encoder sees a fluctuation of the screw and no slip", "[model]") {
  BizoneParameters p = slow(FluctuationCase::kB);
  BizoneExtruder on_screw{p};
  p.fluctuation_place = FluctuationPlace::kSlip;
  BizoneExtruder slipping{p};
  on_screw.advance_to(Instant{20s});
  slipping.advance_to(Instant{20s});
  CHECK(on_screw.encoder_m() == on_screw.outputs().conveyed_m);
  CHECK(slipping.encoder_m() == Approx(0.3).epsilon(1e-12));
  CHECK(slipping.outputs().encoder_m_per_s == 0.015);
  CHECK(slipping.outputs().conveyed_m == on_screw.outputs().conveyed_m);
  CHECK(slipping.x_m() == on_screw.x_m());
}

TEST_CASE("Bizone extruder: feed that does not fit the throat is rejected and counted", "[model]") {
  BizoneExtruder extruder{slow(FluctuationCase::kNone)};
  const double capacity = extruder.parameters().mass_per_length_kg_per_m() * 0.015;
  extruder.set_feed_kg_per_s(2.0 * capacity);
  extruder.advance_to(Instant{1s});
  CHECK(extruder.outputs().U == kMaxFillRatio);
  CHECK(extruder.outputs().rejected_feed_kg == Approx((2.0 - kMaxFillRatio) * capacity));
  extruder.set_feed_kg_per_s(-1.0);
  CHECK(extruder.outputs().feed_kg_per_s == 0.0);
}

TEST_CASE("Bizone extruder: a stopped screw holds everything and starts again where it was", "[model]") {
  const auto reading = GENERATE(DelayReading::kTransport, DelayReading::kPaper);
  BizoneParameters p = slow(FluctuationCase::kA);
  p.delay_reading = reading;
  BizoneExtruder extruder{p};
  extruder.advance_to(Instant{10s});
  const double x = extruder.x_m(), s = extruder.encoder_m();
  extruder.set_screw_rev_per_s(0.0);
  extruder.advance_to(Instant{15s});
  BizoneOutputs out = extruder.outputs();
  CHECK(out.x_m == x);
  CHECK(out.encoder_m == s);
  CHECK(out.flow_kg_per_s == 0.0);
  CHECK(out.rejected_feed_kg == Approx(5.0 * out.feed_kg_per_s));
  extruder.set_screw_rev_per_s(1.5);
  extruder.advance_to(Instant{20s});
  out = extruder.outputs();
  CHECK(out.encoder_m > s);
  CHECK(std::isfinite(out.delay_s));
  // The material that now arrives stood still for 5 s on its way.
  if (reading == DelayReading::kTransport) {
    CHECK(out.delay_s == Approx(5.0 + (p.length_m - out.x_m) / 0.015).margin(0.8));
    CHECK(out.mass_residual_m == Approx(0.0).margin(1e-8));
  }
}

TEST_CASE("Bizone extruder: the same plant 60 times slower gives the same curve 60 times later", "[model]") {
  BizoneParameters fast = make_parameters(Preset::kPaper, FluctuationCase::kB);
  fast.delay_reading = DelayReading::kTransport;
  BizoneExtruder quick{fast}, slow_one{slow(FluctuationCase::kB)};
  std::mt19937_64 random{3};
  double worst = 0.0;
  for (int i = 1; i <= 1000; ++i) {
    const double x_held = 0.05 + 0.2 * static_cast<double>(random() >> 11) * 0x1p-53;
    quick.set_feed_kg_per_s(fast.holding_feed_kg_per_s(x_held));
    slow_one.set_feed_kg_per_s(slow_one.parameters().holding_feed_kg_per_s(x_held));
    quick.advance_to(Instant{i * 10ms});
    slow_one.advance_to(Instant{i * 600ms});
    worst = std::max(worst, std::abs(quick.x_m() - slow_one.x_m()));
  }
  CHECK(worst < 1e-10);
}

TEST_CASE("Bizone extruder: a step into the past does nothing", "[model]") {
  BizoneExtruder extruder{slow(FluctuationCase::kA)};
  extruder.advance_to(Instant{2s});
  extruder.advance_to(Instant{1s});
  CHECK(extruder.now() == Instant{2s});
}

TEST_CASE("Bizone extruder: impossible constants are refused", "[model]") {
  BizoneParameters p;
  p.viscosity_Pa_s = 0.0;
  CHECK_THROWS_AS(BizoneExtruder{p}, std::invalid_argument);
}
