#include "controller/machine/melt_loop.hpp"

#include <catch2/catch.hpp>
#include <cmath>

using namespace meltbench;
using namespace meltbench::machine;

namespace {

constexpr Nanos kSync = 10ms;
constexpr MeltFacts kFacts{.camera_period = 20ms, .camera_latency = 10ms, .inlet_period = 5ms, .inlet_latency = 1ms};

/// Feeds the loop with an extruder that does what the test says.
struct Bench {
  explicit Bench(const MeltSettings& settings = {}) : loop{settings, kFacts, kSync} {}

  MeltLoop loop;
  double b = 0.01, front_m = 0.03, T_inlet_degC = 125.0;
  double front_speed_m_per_s = 0.0;
  std::optional<double> flux = 0.0;
  bool camera = true, thermometer = true;
  Nanos image_age = 15ms;
  int cycle = 0;

  std::optional<MeltRequest> step() {
    const Instant at{kSync * cycle++};
    loop.note_speed(b);
    front_m += front_speed_m_per_s * to_s(kSync);
    if (camera) loop.add(FrontSample{at, front_m - front_speed_m_per_s * to_s(image_age), image_age, true});
    if (thermometer) loop.add(InletSample{at, T_inlet_degC, Nanos{1ms}, true, flux});
    if (!loop.is_running() && !loop.is_ready()) return {};
    return loop.calc(at);
  }
  void run_s(double seconds) {
    for (long i = std::lround(seconds / to_s(kSync)); i > 0; --i) REQUIRE(step());
  }
};

MeltSettings with_law(const std::string& law) {
  MeltSettings settings;
  settings.law = law;
  return settings;
}

}  // namespace

TEST_CASE("Melt loop: is ready when front and inlet were seen and the screw turns", "[machine]") {
  Bench bench;
  bench.b = 0.0;
  CHECK_FALSE(bench.step());
  bench.b = 0.01;
  bench.camera = false;
  CHECK(bench.step());  // The front of the cycle before stands.
  Bench blind;
  blind.camera = false;
  CHECK_FALSE(blind.step());
}

TEST_CASE("Melt loop: output feedback asks the board to close the loop with the published gain", "[machine]") {
  Bench bench;  // The published start: T(0) = 115 °C, 95 °C believed.
  bench.front_m = 0.02;
  bench.T_inlet_degC = 115.0;
  const MeltRequest request = bench.step().value();
  CHECK(request.gain_W_per_m2K == Approx(0.5 * 955.0 * 1895.0 * 0.01));  // γ k_s = ρ_s c_s b/2.
  CHECK(request.feedforward_W_per_m2 == Approx(-4.35623479));            // q_f* of the paper preset at 10 mm/s.
  CHECK(request.Z_W_per_m2 > 0.0);                                       // The front is to move towards the nozzle.
  CHECK(request.T_reference_degC == Approx(134.431948 - request.Z_W_per_m2 / request.gain_W_per_m2K));
}

TEST_CASE("Melt loop: the inlet is never asked to be above the melting point", "[machine]") {
  Bench bench;
  bench.front_m = 0.05;  // At the set point, but believed to be 20 K colder than it is: more heat, says the law.
  const MeltRequest request = bench.step().value();
  CHECK(request.Z_W_per_m2 < 0.0);
  CHECK(request.T_reference_degC == 135.0);
}

TEST_CASE("Melt loop: capped and direct law send the flux itself, of the newest inlet temperature", "[machine]") {
  const MeltRequest inner = Bench{}.step().value();
  const auto flux_for = [&](double gain) {
    return inner.feedforward_W_per_m2 - gain * (125.0 - inner.T_reference_degC);
  };
  const MeltRequest direct = Bench{with_law("output_feedback_direct")}.step().value();
  CHECK(direct.gain_W_per_m2K == 0.0);
  CHECK(direct.feedforward_W_per_m2 == Approx(flux_for(inner.gain_W_per_m2K)));
  const MeltRequest capped = Bench{with_law("output_feedback_capped")}.step().value();
  CHECK(capped.feedforward_W_per_m2 == Approx(flux_for(0.5 * 0.373 / (0.01 * 0.01))));  // k_s/(2 b Ts).
}

TEST_CASE("Melt loop: open loop and PI send their flux and no Z", "[machine]") {
  const MeltRequest open = Bench{with_law("open_loop")}.step().value();
  CHECK(open.feedforward_W_per_m2 == Approx(-4.35623479));
  CHECK(open.gain_W_per_m2K == 0.0);
  CHECK(open.Z_W_per_m2 == 0.0);
  const MeltRequest pi = Bench{with_law("pi")}.step().value();
  CHECK(pi.feedforward_W_per_m2 == Approx(-4.35623479 + 300.0 * (0.03 - 0.05)));
  CHECK_THROWS_AS(Bench{with_law("magic")}, std::invalid_argument);
}

TEST_CASE("Melt loop: the front is carried over the age of the image with the speed of the last images", "[machine]") {
  Bench bench;
  bench.front_speed_m_per_s = 0.004;
  bench.run_s(1.0);
  CHECK(bench.loop.front_m() == Approx(bench.front_m).margin(1e-9));
}

TEST_CASE("Front tracker: extrapolates within what the front can do", "[machine]") {
  FrontTracker tracker;
  tracker.add(Instant{0ms}, 0.050, 0.01);
  CHECK(tracker.at(Instant{10ms}, 0.01) == 0.050);  // One image has no speed.
  tracker.add(Instant{20ms}, 0.052, 0.01);          // 100 mm/s: no front of a 10 mm/s screw.
  CHECK(tracker.at(Instant{40ms}, 0.01) == Approx(0.052 + 0.95 * 0.01 * 0.02));
  tracker.add(Instant{20ms}, 0.9, 0.01);  // Not newer.
  CHECK(tracker.newest_at() == Instant{20ms});
  CHECK(tracker.at(Instant{20ms}, 0.01) == 0.052);
}

TEST_CASE("Melt loop: a lost camera is replaced by the model, and counted in screw travel", "[machine]") {
  Bench bench;
  bench.run_s(1.0);
  CHECK(bench.loop.observe().front_coasted_m == 0.0);
  bench.camera = false;
  bench.run_s(1.0);
  // An image of up to 2 mm of travel may be extrapolated; what is over that is the model's.
  CHECK(bench.loop.observe().front_coasted_m == Approx(0.01 - 0.002).margin(4e-4));
  CHECK(bench.loop.front_m() > 0.0);
  bench.camera = true;
  bench.run_s(0.01);
  CHECK(bench.loop.observe().front_coasted_m == 0.0);
}

TEST_CASE("Melt loop: half a flush without camera or thermometer trips the interlock", "[machine]") {
  for (const bool camera : {true, false}) {
    Bench bench;
    bench.run_s(1.0);
    (camera ? bench.camera : bench.thermometer) = false;
    bench.flux.reset();
    bench.run_s(1.0);
    CHECK(safety::judge({}, bench.loop.observe()) == safety::MeltTrip::kNone);
    double waited_s = 1.0;
    while (safety::judge({}, bench.loop.observe()) == safety::MeltTrip::kNone && waited_s < 5.0) {
      bench.run_s(0.01);
      waited_s += 0.01;
    }
    const auto expected = camera ? safety::MeltTrip::kFrontStale : safety::MeltTrip::kInletStale;
    CHECK(safety::judge({}, bench.loop.observe()) == expected);
    CHECK(waited_s < 2.5);  // 0.5 s/b = 1.5 s, what may be extrapolated, and the way that the estimate goes.
  }
}

TEST_CASE("Melt loop: without the board's report the inlet follows what the board was asked for", "[machine]") {
  Bench bench;
  bench.run_s(0.5);
  bench.thermometer = false;
  bench.run_s(0.5);
  // 2 α/b² = 4 ms: the board's loop has long brought the inlet to the reference.
  CHECK(bench.loop.profile_degC()[0] == Approx(bench.loop.request().T_reference_degC).margin(0.5));
}

TEST_CASE("Melt loop: gains follow the measured speed no faster than the ramp, the estimate at once", "[machine]") {
  MeltSettings settings;
  settings.max_gain_ramp_m_per_s2 = 0.002;
  Bench bench{settings};
  bench.run_s(0.1);
  bench.b = 0.015;
  bench.run_s(1.0);
  CHECK(bench.loop.gain_speed_m_per_s() == Approx(0.012));
  bench.run_s(2.0);
  CHECK(bench.loop.gain_speed_m_per_s() == Approx(0.015));
  CHECK(bench.loop.request().gain_W_per_m2K == Approx(0.5 * 955.0 * 1895.0 * 0.015));
}

TEST_CASE("Melt loop: the reference follows the measured barrel", "[machine]") {
  Bench bench;
  bench.run_s(0.1);
  const double before = bench.loop.reference_flux_W_per_m2();
  bench.loop.note_barrel(150.0);
  bench.run_s(0.01);
  CHECK(bench.loop.reference_flux_W_per_m2() == Approx(1.5 * before).epsilon(0.01));  // r = 15 instead of 10 K.
}

TEST_CASE("Melt loop: a stop forgets estimate and trim, and a new start needs new measurements", "[machine]") {
  Bench bench;
  bench.run_s(0.5);
  bench.loop.stop();
  CHECK_FALSE(bench.loop.is_running());
  CHECK_FALSE(bench.loop.is_ready());
  CHECK(bench.loop.request().gain_W_per_m2K == 0.0);
  bench.run_s(0.01);
  CHECK(bench.loop.is_running());
  CHECK(bench.loop.profile_degC()[0] == Approx(105.0));  // 20 K below the measured inlet again.
}

TEST_CASE("Melt loop: the estimate is the melting point from the front on", "[machine]") {
  Bench bench;
  bench.run_s(0.1);  // Front at 30 mm, points every 2.5 mm.
  CHECK(bench.loop.profile_degC()[12] == 135.0);
  CHECK(bench.loop.profile_degC()[40] == 135.0);
  CHECK(bench.loop.profile_degC()[11] < 135.0);
  CHECK(bench.loop.solid_margin_K() == 0.0);
}

TEST_CASE("Melt loop: the trim is off by default and takes an offset away when it is on", "[machine]") {
  Bench off;
  off.front_m = 0.0505;
  off.run_s(2.0);
  CHECK(off.loop.trim_K() == 0.0);
  MeltSettings settings;
  settings.backstepping.trim_rate_K_per_m2 = 6000.0;
  Bench on{settings};
  on.front_m = 0.0505;
  on.run_s(2.0);
  CHECK(on.loop.trim_K() == Approx(6000.0 * 0.01 * 0.0005 * 2.0).epsilon(0.02));
}
