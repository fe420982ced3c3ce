#include "controller/law/delay_law.hpp"

#include <catch2/catch.hpp>
#include <cmath>
#include <limits>

#include "plant_emulator/model/bizone_extruder.hpp"
#include "tests/controller/law/delay_loop.hpp"

using namespace meltbench;
using namespace meltbench::law;
using plant::BizoneExtruder;
using plant::FluctuationCase;
using plant::Preset;

namespace {

/// The extruder under a law that sees what a controller on the bus sees: every 10 ms an encoder sample, the flow that
/// was delivered, and x with its age; its command starts `latency` later. Mass flow is held, as a feeder does.
struct SeamLoop {
  plant::BizoneParameters plant_parameters = plant::make_parameters(Preset::kSlow, FluctuationCase::kA);
  std::string_view law = "exact_predictor";
  Nanos latency = 2ms;
  Nanos age = 3ms;
  double encoder_step_m = 0.01 / 65536;
  double x_step_m = 1e-5;
  bool time_stamps = true;

  struct Result {
    double settling_s = 0.0, overshoot_m = 0.0, x_end_m = 0.0, worst_residual_m = 0.0;
    bool refused = false;
  };

  [[nodiscard]] Result run(Nanos duration) const {
    BizoneExtruder extruder{plant_parameters};
    DelayLawSettings settings;
    settings.model = delay_loop::matched_model(plant_parameters);
    const auto delay_law = make_delay_law(law, settings);
    MaterialClock clock{settings.model.speed_m_per_s};
    const auto round_to = [](double value, double step) { return step * std::round(value / step); };

    Result result;
    double x_seen = round_to(extruder.x_m(), x_step_m);
    Instant seen_at{};
    double commanded = plant_parameters.holding_feed_kg_per_s(plant_parameters.x0_m), delivered = commanded;
    for (Instant now{}; now < Instant{duration}; now += 10ms) {
      clock.add(now, round_to(extruder.encoder_m(), encoder_step_m));
      if (now == Instant{}) delay_law->start(now, settings.model.holding_ratio(x_seen), clock);
      if (now > Instant{}) {
        delay_law->add_feed({now - 10ms + latency, delivered}, clock);
        delay_law->add_feed({now, commanded}, clock);
        delivered = commanded;
      }
      const DelayLawOutput answer =
          delay_law->calc({time_stamps ? seen_at : now, x_seen, time_stamps ? now + latency : now, {}}, clock);
      if (answer.status == PredictionStatus::kInfeasible) result.refused = true;
      commanded = settings.model.feed_kg_per_s(answer.U, clock.speed_m_per_s());

      extruder.advance_to(now + latency);
      extruder.set_feed_kg_per_s(commanded);
      extruder.advance_to(now + 10ms - age);
      x_seen = round_to(extruder.x_m(), x_step_m);
      seen_at = extruder.now();
      extruder.advance_to(now + 10ms);
      const double x = extruder.x_m();
      result.overshoot_m = std::max(result.overshoot_m, x - 0.16);
      if (std::abs(x - 0.16) > 0.001 * 0.16) result.settling_s = to_s(now + 10ms);
    }
    result.x_end_m = extruder.x_m();
    result.worst_residual_m = std::abs(extruder.outputs().mass_residual_m);
    return result;
  }
};

}  // namespace

TEST_CASE("Delay law: the exact predictor meets the bench's figure through encoder, feeder and stamps", "[law]") {
  const SeamLoop::Result result = SeamLoop{}.run(40s);
  CHECK(result.settling_s > 12.2);  // 12.32 s in continuous time; sampling and latency cost a little.
  CHECK(result.settling_s < 12.9);
  CHECK(result.overshoot_m < 5e-5);
  CHECK(result.x_end_m == Approx(0.16).margin(2e-5));  // The feed ripples with c within 10 ms; x is read in 10 um.
  CHECK(result.worst_residual_m < 1e-8);
}

TEST_CASE("Delay law: without quantisation and latency it is the exact loop, but for the feeder's kg/s", "[law]") {
  SeamLoop loop;
  loop.latency = 0ms;
  loop.age = 0ms;
  loop.encoder_step_m = 1e-15;
  loop.x_step_m = 1e-15;
  const SeamLoop::Result result = loop.run(40s);
  CHECK(result.overshoot_m < 1e-6);
  CHECK(result.x_end_m == Approx(0.16).margin(1e-6).epsilon(0));
}

TEST_CASE("Delay law: case B and the stress preset settle too", "[law]") {
  SeamLoop loop;
  loop.plant_parameters = plant::make_parameters(GENERATE(Preset::kSlow, Preset::kPhys),
                                                 GENERATE(FluctuationCase::kA, FluctuationCase::kB));
  const SeamLoop::Result result = loop.run(60s);
  CHECK(result.settling_s < 20.0);
  CHECK(result.overshoot_m < 1e-4);
}

TEST_CASE("Delay law: open loop is slow, uncompensated never settles", "[law]") {
  SeamLoop loop;
  loop.law = "open_loop";
  CHECK(loop.run(40s).x_end_m == Approx(0.134632976).margin(2e-4).epsilon(0));  // Held kg/s uses the old speed: 0.1 %.
  CHECK(loop.run(40s).overshoot_m == 0.0);
  loop.law = "uncompensated";
  const SeamLoop::Result result = loop.run(60s);
  CHECK(result.overshoot_m > 0.03);
  CHECK(result.settling_s > 55.0);
}

TEST_CASE("Delay law: the state-only and the paper's predictor are swapped in by name", "[law]") {
  SeamLoop loop;
  loop.law = "state_only_predictor";
  CHECK(loop.run(40s).x_end_m == Approx(0.16).margin(1e-4));
  loop.law = "paper_predictor";
  loop.plant_parameters.delay_reading = plant::DelayReading::kPaper;
  const SeamLoop::Result paper = loop.run(40s);
  CHECK_FALSE(paper.refused);
  CHECK(paper.x_end_m == Approx(0.16).margin(1e-4));
}

TEST_CASE("Delay law: the paper's predictor refuses the stress preset and falls back to the open-loop rate", "[law]") {
  SeamLoop loop;
  loop.law = "paper_predictor";
  loop.plant_parameters = plant::make_parameters(Preset::kPhys, FluctuationCase::kA);
  CHECK(loop.run(20s).refused);

  DelayLawSettings settings;
  settings.model = delay_loop::matched_model(loop.plant_parameters);
  const auto law = make_delay_law("paper_predictor", settings);
  MaterialClock clock{0.015};
  law->start(Instant{37s}, 0.3, clock);
  const DelayLawOutput answer = law->calc({Instant{37s}, 0.12, Instant{37s}}, clock);
  CHECK(answer.status == PredictionStatus::kInfeasible);
  CHECK(answer.U == Approx(settings.model.holding_ratio(0.16)));
}

TEST_CASE("Delay law: a measurement half a second old overshoots only if its stamp is ignored", "[law]") {
  // x is frozen while it moves: the sensor stops at 6.5 s for 1 s. "age" in the seam is up to a period, so do it by
  // hand.
  const auto run = [](bool stamped) {
    const auto p = plant::make_parameters(Preset::kSlow, FluctuationCase::kA);
    BizoneExtruder extruder{p};
    DelayLawSettings settings;
    settings.model = delay_loop::matched_model(p);
    const auto law = make_delay_law("exact_predictor", settings);
    MaterialClock clock{0.015};
    double commanded = 0.0, x_seen = 0.1, over = 0.0;
    Instant seen_at{};
    for (Instant now{}; now < Instant{30s}; now += 10ms) {
      clock.add(now, extruder.encoder_m());
      if (now == Instant{}) law->start(now, settings.model.holding_ratio(0.1), clock);
      if (now > Instant{}) law->add_feed({now, commanded}, clock);
      if (now < Instant{6500ms} || now >= Instant{7500ms}) {
        x_seen = extruder.x_m();
        seen_at = now;
      }
      commanded = settings.model.feed_kg_per_s(law->calc({stamped ? seen_at : now, x_seen, now}, clock).U,
                                               clock.speed_m_per_s());
      extruder.set_feed_kg_per_s(commanded);
      extruder.advance_to(now + 10ms);
      over = std::max(over, extruder.x_m() - 0.16);
    }
    return over;
  };
  CHECK(run(true) < 1e-6);
  CHECK(run(false) > 1e-4);
}

TEST_CASE("Delay law: commands in flight count, each for its time", "[law]") {
  DelayLawSettings settings;
  MaterialClock clock{0.015};
  clock.add(Instant{0s}, 0.0);
  clock.add(Instant{1s}, 0.015);
  for (const std::string_view name : {"exact_predictor", "state_only_predictor", "paper_predictor"}) {
    settings.model.fluctuation = 0.0;
    const auto reports = make_delay_law(name, settings), in_flight = make_delay_law(name, settings);
    reports->start(Instant{0s}, 0.2, clock);
    in_flight->start(Instant{0s}, 0.2, clock);
    reports->add_feed({Instant{1s}, 2e-3}, clock);
    in_flight->add_feed({Instant{1s}, 2e-3}, clock);
    reports->add_feed({Instant{1010ms}, 3e-3}, clock);
    reports->add_feed({Instant{1020ms}, 1e-3}, clock);
    const FeedInterval sent[] = {{Instant{1010ms}, 3e-3}, {Instant{1030ms}, 1e-3}};
    const auto told = reports->calc({Instant{1s}, 0.12, Instant{1020ms}}, clock);
    const auto sends = in_flight->calc({Instant{1s}, 0.12, Instant{1020ms}, sent}, clock);
    CHECK(sends.P_m == Approx(told.P_m).margin(1e-12).epsilon(0));
    CHECK(sends.U == Approx(told.U).margin(1e-9).epsilon(0));
    // Without a list the last feed is taken to go on.
    const auto goes_on = in_flight->calc({Instant{1s}, 0.12, Instant{1020ms}}, clock);
    CHECK(goes_on.P_m != Approx(told.P_m).margin(1e-9).epsilon(0));
  }
}

TEST_CASE("Delay law: feed onto a standing screw enters with the next motion", "[law]") {
  DelayLawSettings settings;
  const auto law = make_delay_law("exact_predictor", settings);
  const auto steady = make_delay_law("exact_predictor", settings);
  MaterialClock stops{0.015}, runs{0.015};
  stops.add(Instant{0s}, 0.0);
  runs.add(Instant{0s}, 0.0);
  law->start(Instant{0s}, 0.2, stops);
  steady->start(Instant{0s}, 0.2, runs);
  stops.add(Instant{1s}, 0.0);
  law->add_feed({Instant{1s}, 1e-3}, stops);
  stops.add(Instant{2s}, 0.015);
  law->add_feed({Instant{2s}, 1e-3}, stops);
  runs.add(Instant{2s}, 0.015);
  steady->add_feed({Instant{2s}, 1e-3}, runs);
  CHECK(law->calc({Instant{2s}, 0.12, Instant{2s}}, stops).P_m ==
        Approx(steady->calc({Instant{2s}, 0.12, Instant{2s}}, runs).P_m).margin(1e-14).epsilon(0));
}

TEST_CASE("Delay law: a missing measurement gives the open-loop rate and says so", "[law]") {
  MaterialClock clock{0.015};
  for (const std::string_view name : {"uncompensated", "exact_predictor", "state_only_predictor", "paper_predictor"}) {
    const auto law = make_delay_law(name, {});
    law->start(Instant{0s}, 0.2, clock);
    const auto answer = law->calc({Instant{0s}, std::numeric_limits<double>::quiet_NaN(), Instant{0s}}, clock);
    CHECK(answer.status == PredictionStatus::kBadInput);
    CHECK(answer.U == Approx(BizoneModel{}.holding_ratio(0.16)));
  }
}

TEST_CASE("Delay law: each name makes its law, an unknown one lists them", "[law]") {
  for (const std::string_view name : delay_law_names()) CHECK(make_delay_law(name, {})->name() == name);
  CHECK_THROWS_WITH(make_delay_law("smith", {}),
                    Catch::Contains("\"smith\"") && Catch::Contains("open_loop, uncompensated, exact_predictor"));
  DelayLawSettings bad;
  bad.bang_bang.x_set_m = 0.25;
  CHECK_THROWS_WITH(make_delay_law("open_loop", bad), Catch::Contains("x_set_m = 0.25"));
  bad = {};
  bad.min_sample_time_s = 0.0;
  CHECK_THROWS_WITH(make_delay_law("exact_predictor", bad), Catch::Contains("min_sample_time_s = 0"));
}
