#include "plant_emulator/model/frozen_delay_plant.hpp"

#include <catch2/catch.hpp>
#include <cmath>
#include <functional>

#include "plant_emulator/model/bizone_parameters.hpp"
#include "plant_emulator/model/parcel_plant.hpp"

using namespace meltbench::plant;

namespace {

ScrewClock make_clock(const BizoneParameters& p) {
  return {p.speed_m_per_s, p.fluctuation, p.fluctuation_rad_per_s, p.fluctuation_phase_rad};
}

class Rig {
 public:
  explicit Rig(const BizoneParameters& p)
      : clock_{make_clock(p)}, plant_{p.length_m, p.theta2_per_m(), p.x0_m, p.outflow_ratio(p.x0_m), clock_} {}

  double run_to(double t_s, const std::function<double(double)>& U, double sample_s) {
    while (t_ < t_s - 0.5 * sample_s) {
      const double U_now = U(t_);
      t_ = static_cast<double>(++samples_) * sample_s;
      plant_.advance(t_, U_now, clock_);
    }
    return plant_.x_m();
  }
  [[nodiscard]] const FrozenDelayPlant& plant() const { return plant_; }
  [[nodiscard]] const ScrewClock& clock() const { return clock_; }

 private:
  ScrewClock clock_;
  FrozenDelayPlant plant_;
  double t_ = 0.0;
  long samples_ = 0;
};

}  // namespace

TEST_CASE("Frozen-delay plant: at the open-loop rate it follows the paper's run", "[model]") {
  const BizoneParameters p = make_parameters(Preset::kPaper, FluctuationCase::kA);
  Rig rig{p};
  const auto hold = [&](double) { return p.outflow_ratio(0.16); };
  // 9 digits are given; RK4 in steps of 1 mm conveyed is good to 1e-11.
  CHECK(rig.run_to(1, hold, 0.01) == Approx(0.143734299).margin(1e-9).epsilon(0));
  CHECK(rig.run_to(2, hold, 0.01) == Approx(0.156384835).margin(1e-9).epsilon(0));
  CHECK(rig.run_to(5, hold, 0.01) == Approx(0.159949378).margin(1e-9).epsilon(0));
  CHECK(rig.run_to(10, hold, 0.01) == Approx(0.159999958).margin(1e-9).epsilon(0));
}

TEST_CASE("Frozen-delay plant: nothing changes before phi reaches the first new feed", "[model]") {
  const BizoneParameters p = make_parameters(Preset::kPaper, FluctuationCase::kA);
  FrozenDelayPlant plant = Rig{p}.plant();
  const ScrewClock clock = make_clock(p);
  plant.advance(0.101766065 - 1e-8, 0.9, clock);
  CHECK(plant.x_m() == Approx(0.1).margin(1e-13).epsilon(0));
  plant.advance(0.101766065 + 1e-8, 0.9, clock);
  CHECK(plant.x_m() > 0.1 + 1e-9);
}

TEST_CASE("Frozen-delay plant: jumps of the feed are located, so the sample grid does not matter", "[model]") {
  const BizoneParameters p = make_parameters(Preset::kPaper, FluctuationCase::kB);
  // Feed changes every 10 ms; integrated in calls of 10 ms and of 0.625 ms.
  const auto feed = [](double t) { return 0.25 + 0.2 * std::sin(0.7 * std::floor(t * 100.0 + 1e-6)); };
  Rig coarse{p}, fine{p};
  double worst = 0.0;
  for (int i = 1; i <= 200; ++i) {
    const double t = i * 0.01;
    worst = std::max(worst, std::abs(coarse.run_to(t, feed, 0.01) - fine.run_to(t, feed, 0.000625)));
  }
  CHECK(worst < 1e-10);  // Fourth order; without location it would be 1e-4.
}

TEST_CASE("Frozen-delay plant: equal to the transported one if the screw turns evenly", "[model]") {
  const BizoneParameters p = make_parameters(Preset::kPaper, FluctuationCase::kNone);
  Rig rig{p};
  ParcelPlant parcels{p.length_m, p.theta2_per_m(), p.x0_m, p.outflow_ratio(p.x0_m)};
  const auto feed = [](double t) { return 0.25 + 0.2 * std::sin(0.7 * std::floor(t * 100.0 + 1e-6)); };
  double worst = 0.0;
  for (int i = 1; i <= 200; ++i) {
    parcels.advance({i * 0.01, rig.clock().conveyed_m(i * 0.01)}, feed((i - 1) * 0.01));
    worst = std::max(worst, std::abs(rig.run_to(i * 0.01, feed, 0.01) - parcels.x_m()));
  }
  CHECK(worst < 1e-10);
  CHECK(rig.plant().mass_residual_m(rig.clock()) < 1e-6);  // Trapezoidal bookkeeping.
}

TEST_CASE("Frozen-delay plant: the delay as printed breaks the mass balance by about one percent", "[model]") {
  const BizoneParameters p = make_parameters(Preset::kPaper, FluctuationCase::kA);
  Rig rig{p};
  double worst = 0.0;
  const auto hold = [&](double) { return p.outflow_ratio(0.16); };
  for (int i = 100; i <= 400; ++i) {
    rig.run_to(i * 0.01, hold, 0.01);
    worst = std::max(worst, std::abs(rig.plant().mass_residual_m(rig.clock())));
  }
  // 2.3 % of (L - x) v(x*) is 2.3e-4 m while the barrel fills, 0.9 % of it is 0.9e-4 m at x*.
  CHECK(worst > 5e-5);
  CHECK(worst < 1e-3);
}

TEST_CASE("Frozen-delay plant: full feed floods it and it recovers", "[model]") {
  const BizoneParameters p = make_parameters(Preset::kPaper, FluctuationCase::kA);
  Rig rig{p};
  CHECK(rig.run_to(
            0.2, [](double) { return 0.9; }, 0.001) == 0.2);
  CHECK(rig.plant().flooded());
  CHECK(rig.plant().spill_m() > 0.0);
  CHECK(rig.run_to(
            0.3, [](double) { return 0.0; }, 0.001) < 0.2);
}

TEST_CASE("Frozen-delay plant: survives a screw so slow that material arrives out of order", "[model]") {
  BizoneParameters p = make_parameters(Preset::kPhys, GENERATE(FluctuationCase::kA, FluctuationCase::kB));
  Rig rig{p};
  for (int i = 1; i <= 6000; ++i) {
    const double x = rig.run_to(
        i * 0.01, [](double t) { return std::fmod(t, 3.0) < 1.0 ? 0.5 : 0.1; }, 0.01);
    REQUIRE(std::isfinite(x));
    REQUIRE(x >= 0.0);
    REQUIRE(x <= 0.2);
  }
}

TEST_CASE("Frozen-delay plant: a change of speed leaves what was fed before it as it was", "[model]") {
  const BizoneParameters p = make_parameters(Preset::kPaper, FluctuationCase::kNone);
  ScrewClock clock = make_clock(p);
  FrozenDelayPlant plant = Rig{p}.plant();
  plant.advance(1.0, p.outflow_ratio(0.1), clock);
  clock.set_speed(1.0, 0.45);
  // (16) now has twice the delay: the material under way is read at another place, but of one kind, so nothing changes.
  plant.advance(1.01, p.outflow_ratio(0.1), clock);
  CHECK(plant.x_m() == Approx(0.1).margin(1e-12).epsilon(0));
  // phi jumps back by 0.11 s, and what was fed then counts at the speed of then: 0.1 m twice.
  CHECK(plant.mass_residual_m(clock) == Approx(0.1 * p.outflow_ratio(0.1)).margin(2e-3));
}
