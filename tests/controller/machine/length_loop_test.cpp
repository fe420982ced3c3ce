#include "controller/machine/length_loop.hpp"

#include <catch2/catch.hpp>
#include <cmath>

using namespace meltbench;
using namespace meltbench::machine;

namespace {

constexpr double kSpeed_m_per_s = 0.015;

ControllerSettings make_loop_settings() {
  ControllerSettings settings;
  settings.set_points = {{Instant{}, 0.16}};
  return settings;
}

/// Pressure that a filled length makes at a screw speed, in counts of 1 Pa.
std::int32_t calc_counts(const law::BizoneModel& model, double x_m, double c_m_per_s) {
  const double flow = model.feed_kg_per_s(model.holding_ratio(x_m), c_m_per_s);
  return static_cast<std::int32_t>(std::lround(flow * model.viscosity_Pa_s / model.nozzle_kg));
}

ScrewSample make_screw(Instant at, double c_m_per_s, std::uint32_t position_inc) {
  const double velocity = c_m_per_s / 0.01 * 65536.0;
  return {at, static_cast<std::int32_t>(position_inc), static_cast<std::int32_t>(std::lround(velocity))};
}

}  // namespace

TEST_CASE("Speed record: linear between samples, with the last slope for a moment beyond", "[machine]") {
  SampleRecord speeds{4};
  speeds.add(Instant{10ms}, 1.0);
  CHECK(speeds.at(Instant{}) == 1.0);
  speeds.add(Instant{20ms}, 2.0);
  speeds.add(Instant{30ms}, 4.0);
  CHECK(speeds.at(Instant{}) == 1.0);
  CHECK(speeds.at(Instant{15ms}) == Approx(1.5));
  CHECK(speeds.at(Instant{25ms}) == Approx(3.0));
  CHECK(speeds.at(Instant{40ms}) == Approx(6.0));
  CHECK(speeds.at(Instant{10s}) == Approx(14.0));  // 50 ms beyond, and no further.
  speeds.add(Instant{30ms}, 9.0);                  // Not newer.
  CHECK(speeds.at(Instant{30ms}) == Approx(4.0));
}

TEST_CASE("Length loop: pressure and speed of the same instant give the filled length, however old", "[machine]") {
  const ControllerSettings settings = make_loop_settings();
  LengthLoop loop{settings, BoardFacts{}};
  // The screw slows down by half between two SYNCs; the pressure is from the middle.
  loop.add(make_screw(Instant{}, kSpeed_m_per_s, 0));
  loop.add(make_screw(Instant{10ms}, 0.5 * kSpeed_m_per_s, 737));
  loop.add(PressureSample{Instant{10ms}, calc_counts(settings.model, 0.12, 0.75 * kSpeed_m_per_s), 5ms, true});
  CHECK(loop.x_m() == Approx(0.12).margin(1e-5));  // 1 Pa is 5 um.
  CHECK(loop.measured_at() == Instant{5ms});
}

TEST_CASE("Length loop: taken for one of now, an old pressure is matched with the wrong speed", "[machine]") {
  ControllerSettings settings = make_loop_settings();
  settings.time_stamped = false;
  LengthLoop loop{settings, BoardFacts{}};
  loop.add(make_screw(Instant{}, kSpeed_m_per_s, 0));
  loop.add(make_screw(Instant{10ms}, 0.9 * kSpeed_m_per_s, 934));
  loop.add(PressureSample{Instant{10ms}, calc_counts(settings.model, 0.12, kSpeed_m_per_s), 10ms, true});
  CHECK(std::abs(loop.x_m() - 0.12) > 0.005);
}

TEST_CASE("Length loop: an age that the wire cannot tell is the transmitter's latency", "[machine]") {
  BoardFacts facts;
  facts.pressure_latency = 300ms;
  facts.pressure_period = 2ms;
  const ControllerSettings settings = make_loop_settings();
  LengthLoop loop{settings, facts};
  loop.add(make_screw(Instant{1s}, kSpeed_m_per_s, 0));
  loop.add(PressureSample{Instant{1s}, calc_counts(settings.model, 0.12, kSpeed_m_per_s), {}, true});
  CHECK(loop.measured_at() == Instant{699ms});
}

TEST_CASE("Length loop: a pressure that cannot be used leaves the last estimate, and tells since when", "[machine]") {
  const ControllerSettings settings = make_loop_settings();
  LengthLoop loop{settings, BoardFacts{}};
  loop.add(make_screw(Instant{}, kSpeed_m_per_s, 0));
  loop.add(PressureSample{Instant{}, calc_counts(settings.model, 0.12, kSpeed_m_per_s), 0ns, true});
  CHECK_FALSE(loop.implausible_since().has_value());
  loop.add(PressureSample{Instant{10ms}, 1, 0ns, false});         // Not good by its status.
  loop.add(PressureSample{Instant{20ms}, 1'000'000, 0ns, true});  // Good, but more than the screw can make.
  CHECK(loop.implausible_since() == Instant{10ms});
  CHECK(loop.x_m() == Approx(0.12).margin(1e-5));
  CHECK(loop.measured_at() == Instant{});
  loop.add(PressureSample{Instant{30ms}, calc_counts(settings.model, 0.13, kSpeed_m_per_s), 0ns, true});
  CHECK_FALSE(loop.implausible_since().has_value());
}

TEST_CASE("Length loop: the encoder's wrap does not disturb the prediction", "[machine]") {
  const ControllerSettings settings = make_loop_settings();
  const auto run = [&](std::uint32_t first_position) {
    LengthLoop loop{settings, BoardFacts{}};
    double P = 0.0;
    for (int k = 0; k < 100; ++k) {
      const Instant at{10ms * k};
      loop.add(make_screw(at, kSpeed_m_per_s, first_position + static_cast<std::uint32_t>(k) * 983U));
      loop.add(FeedSample{at, 1e-3, {}, 0});
      loop.add(PressureSample{at, calc_counts(settings.model, 0.12, kSpeed_m_per_s), 1ms, true});
      REQUIRE(loop.is_ready());
      P = loop.calc(at, at).P_m;
    }
    return P;
  };
  const double P = run(0);
  CHECK(P > 0.1);
  CHECK(run(0xFFFF'8000U) == P);  // Wraps in the middle.
  CHECK(run(0x7FFF'8000U) == P);  // Sign changes in the middle.
}

TEST_CASE("Length loop: the command is U rho0 S_eff c with the speed expected while it is held", "[machine]") {
  ControllerSettings settings = make_loop_settings();
  settings.law = "open_loop";
  BoardFacts facts;
  facts.feeder_latency = 5ms;
  LengthLoop loop{settings, facts};
  // 1 % faster at every SYNC: takes effect 5 ms later, and is held for 10 ms around 10 ms later.
  loop.add(make_screw(Instant{}, kSpeed_m_per_s, 0));
  loop.add(make_screw(Instant{10ms}, 1.01 * kSpeed_m_per_s, 988));
  loop.add(FeedSample{Instant{10ms}, 1e-3, {}, 0});
  loop.add(PressureSample{Instant{10ms}, calc_counts(settings.model, 0.12, kSpeed_m_per_s), 5ms, true});
  const LengthCommand command = loop.calc(Instant{10ms}, Instant{10ms});
  CHECK(command.U == Approx(settings.model.holding_ratio(0.16)));
  CHECK(command.P_m == Approx(0.16));
  // The speeds on the wire are rounded to 1e-5.
  CHECK(command.flow_kg_per_s == Approx(settings.model.feed_kg_per_s(command.U, 1.02 * kSpeed_m_per_s)).epsilon(3e-5));
}

TEST_CASE("Length loop: is not ready before all three boards have been heard", "[machine]") {
  const ControllerSettings settings = make_loop_settings();
  LengthLoop loop{settings, BoardFacts{}};
  loop.add(PressureSample{Instant{}, 30'000, 0ns, true});  // Without a speed it says nothing.
  loop.add(FeedSample{Instant{}, 1e-3, {}, 0});
  CHECK_FALSE(loop.is_ready());
  loop.add(make_screw(Instant{10ms}, kSpeed_m_per_s, 0));
  CHECK_FALSE(loop.is_ready());
  loop.add(PressureSample{Instant{10ms}, 30'000, 0ns, true});
  CHECK(loop.is_ready());
}
