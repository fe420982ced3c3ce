#include "plant_emulator/model/parcel_plant.hpp"

#include <catch2/catch.hpp>
#include <cmath>
#include <functional>
#include <random>

#include "plant_emulator/model/bizone_parameters.hpp"
#include "plant_emulator/model/screw_clock.hpp"

using namespace meltbench::plant;

namespace {

// Two independent integrators (a delay ODE by brute force, characteristics) agree on these vectors to 1e-11 m.
constexpr double kVector_m = 1e-11;

/// A parcel plant on its screw clock, driven with a filling ratio given over time.
class Rig {
 public:
  explicit Rig(const BizoneParameters& p, double U_before)
      : clock_{p.speed_m_per_s, p.fluctuation, p.fluctuation_rad_per_s, p.fluctuation_phase_rad},
        plant_{p.length_m, p.theta2_per_m(), p.x0_m, U_before} {}
  explicit Rig(const BizoneParameters& p) : Rig(p, p.outflow_ratio(p.x0_m)) {}

  /// Samples of 10 ms (or as given), counted from t = 0.
  double run_to(double t_s, const std::function<double(double)>& U, double sample_s = 0.01) {
    while (t_ < t_s - 0.5 * sample_s) {
      const double U_now = U(t_);
      t_ = static_cast<double>(++samples_) * sample_s;
      plant_.advance({t_, clock_.conveyed_m(t_)}, U_now);
    }
    return plant_.x_m();
  }

  [[nodiscard]] const ParcelPlant& plant() const { return plant_; }
  [[nodiscard]] const ScrewClock& clock() const { return clock_; }
  [[nodiscard]] double t() const { return t_; }

 private:
  ScrewClock clock_;
  ParcelPlant plant_;
  double t_ = 0.0;
  long samples_ = 0;
};

BizoneParameters slow_A() {
  return make_parameters(Preset::kSlow, FluctuationCase::kA);
}

double steps_then_hold(double t) {
  if (t < 2.0 - 1e-9) return 0.6;
  if (t < 5.0 - 1e-9) return 0.1;
  if (t < 9.0 - 1e-9) return 0.35;
  return slow_A().outflow_ratio(0.16);
}

}  // namespace

TEST_CASE("Parcel plant: a feed of four levels gives the reference trajectory", "[model]") {
  Rig rig{slow_A()};
  const std::pair<double, double> reference[] = {{7, 0.115663389930},  {8, 0.115131418937},  {9, 0.113421907979},
                                                 {10, 0.111760083395}, {12, 0.116952458697}, {15, 0.124532739044},
                                                 {20, 0.128854954742}, {40, 0.140616678415}, {60, 0.147538056517}};
  for (const auto& [t, x] : reference) {
    CHECK(rig.run_to(t, steps_then_hold) == Approx(x).margin(kVector_m).epsilon(0));
  }
  CHECK(rig.plant().calc_content_m() == Approx(0.160799177917).margin(kVector_m).epsilon(0));
  CHECK(rig.plant().content_m() == Approx(rig.plant().calc_content_m()).margin(1e-13).epsilon(0));
}

TEST_CASE("Parcel plant: the answer does not depend on how the feed is cut into steps", "[model]") {
  const auto hold = [](double) { return slow_A().outflow_ratio(0.16); };
  Rig fine{slow_A()}, coarse{slow_A()};
  CHECK(fine.run_to(40.0, hold, 0.001) == Approx(coarse.run_to(40.0, hold, 40.0)).margin(1e-12).epsilon(0));
  CHECK(coarse.plant().mass_residual_m() == Approx(0.0).margin(1e-10));  // Simpson's pieces: 0.05^5/2880 each.
}

TEST_CASE("Parcel plant: without feed the barrel drains as the reference says and is never negative", "[model]") {
  Rig rig{slow_A()};
  const std::pair<double, double> reference[] = {{5, 0.1},
                                                 {7, 0.097389230345},
                                                 {10, 0.089349601608},
                                                 {20, 0.067067758664},
                                                 {40, 0.038701331893},
                                                 {60, 0.022501734510}};
  for (const auto& [t, x] : reference) {
    CHECK(rig.run_to(t, [](double) { return 0.0; }) == Approx(x).margin(kVector_m).epsilon(0));
  }
  CHECK(rig.plant().spill_m() == 0.0);
  CHECK(rig.run_to(
            5000.0, [](double) { return 0.0; }, 1.0) >= 0.0);
}

TEST_CASE("Parcel plant: full feed floods the barrel at 7.01 s, and what does not fit is spilled", "[model]") {
  Rig rig{slow_A()};
  const auto full = [](double) { return 0.9; };
  CHECK(rig.run_to(5.0, full) == Approx(0.1).margin(kVector_m).epsilon(0));
  CHECK(rig.run_to(7.0, full) == Approx(0.199685541351).margin(kVector_m).epsilon(0));
  CHECK_FALSE(rig.plant().flooded());
  CHECK(rig.run_to(7.01, full) == 0.2);
  CHECK(rig.plant().flooded());
  CHECK(rig.run_to(60.0, full) == 0.2);
  // Spilling starts when (D10) reaches L: that material entered at s = 0 + d, and arrives where it enters.
  const BizoneParameters p = slow_A();
  const double r = p.theta2_per_m() * 0.1;
  const double d = std::log((0.9 / r - p.x0_m) / (0.9 / r - p.length_m)) / r;
  const double spill = (0.9 - p.outflow_ratio(p.length_m)) * (rig.clock().conveyed_m(60.0) - d);
  CHECK(rig.plant().spill_m() == Approx(spill).margin(1e-10).epsilon(0));
  CHECK(std::abs(rig.plant().mass_residual_m()) < 1e-8);
}

TEST_CASE("Parcel plant: a flooded barrel leaves the end of the screw as soon as feed stops", "[model]") {
  Rig rig{slow_A()};
  rig.run_to(10.0, [](double) { return 0.9; });
  const double s0 = rig.clock().conveyed_m(rig.t());
  const double x = rig.run_to(12.0, [](double) { return 0.0; });
  // No feed, no delay: dx/ds = -v(x), which integrates to x + ln(x)/theta2 = const - s.
  const double theta2 = slow_A().theta2_per_m();
  const double conveyed = rig.clock().conveyed_m(rig.t()) - s0;
  CHECK(x + std::log(x) / theta2 == Approx(0.2 + std::log(0.2) / theta2 - conveyed).margin(1e-12).epsilon(0));
  CHECK_FALSE(rig.plant().flooded());
}

TEST_CASE("Parcel plant: nothing changes before the first new feed has travelled to the filled zone", "[model]") {
  const auto [preset, dead_s] = GENERATE(table<Preset, double>(
      {{Preset::kSlow, 6.075584779}, {Preset::kPhys, 6.641897335}, {Preset::kPaper, 0.101259746}}));
  Rig rig{make_parameters(preset, FluctuationCase::kA)};
  const auto full = [](double) { return 0.9; };
  const double h = dead_s / 1000.0;
  rig.run_to(dead_s - 0.5 * h, full, h);
  CHECK(rig.plant().x_m() == Approx(0.1).margin(1e-14).epsilon(0));
  const double t_before = dead_s - 1e-8, t_after = dead_s + 1e-8;  // The times are given to 9 digits.
  Rig fresh{make_parameters(preset, FluctuationCase::kA)};
  ParcelPlant plant = fresh.plant();
  plant.advance({t_before, fresh.clock().conveyed_m(t_before)}, 0.9);
  CHECK(plant.x_m() == Approx(0.1).margin(1e-13).epsilon(0));
  plant.advance({t_after, fresh.clock().conveyed_m(t_after)}, 0.9);
  CHECK(plant.x_m() > 0.1 + 1e-11);
}

TEST_CASE("Parcel plant: held at the open-loop rate it follows the reference", "[model]") {
  const BizoneParameters slow = slow_A();
  const auto hold = [&](double) { return slow.outflow_ratio(0.16); };
  Rig rig{slow};
  CHECK(rig.run_to(10, hold) == Approx(0.106299704).margin(1e-9).epsilon(0));  // 9 digits are given.
  CHECK(rig.run_to(20, hold) == Approx(0.118989644).margin(1e-9).epsilon(0));
  CHECK(rig.run_to(40, hold) == Approx(0.134632976).margin(1e-9).epsilon(0));
}

TEST_CASE("Parcel plant: mass is conserved to 1e-8 m under a random feed", "[model]") {
  const auto fluctuation = GENERATE(FluctuationCase::kA, FluctuationCase::kB);
  const auto preset = GENERATE(Preset::kSlow, Preset::kPhys);
  const BizoneParameters p = make_parameters(preset, fluctuation);
  Rig rig{p};
  std::mt19937_64 random{7};
  // Outflow measured from outside, by the trapezoidal rule on v(x(s)) every 2.5 ms: error about h^2 v''/12 = 1e-9.
  double outflow = 0.0, inflow = 0.0, s = 0.0, v = p.outflow_ratio(p.x0_m);
  const double content0 = rig.plant().calc_content_m();
  double U = 0.2;
  for (int i = 1; i <= 40000; ++i) {
    if (i % 40 == 0) U = 0.45 * static_cast<double>(random() >> 11) * 0x1p-53;
    rig.run_to(
        i * 0.0025, [&](double) { return U; }, 0.0025);
    const double s_now = rig.clock().conveyed_m(rig.t()), v_now = p.outflow_ratio(rig.plant().x_m());
    outflow += 0.5 * (v + v_now) * (s_now - s);
    inflow += U * (s_now - s);
    s = s_now;
    v = v_now;
    REQUIRE_FALSE(rig.plant().flooded());
  }
  CHECK(rig.plant().calc_content_m() - content0 - (inflow - outflow) == Approx(0.0).margin(1e-8));
  CHECK(rig.plant().mass_residual_m() == Approx(0.0).margin(1e-8));
  CHECK(rig.plant().outflow_m() == Approx(outflow).margin(1e-8));
}

TEST_CASE("Parcel plant: seen over metres conveyed, all screws and fluctuations are the same", "[model]") {
  // (D8) and (D9) know neither theta1 nor eps nor omega.
  const BizoneParameters slow = slow_A();
  ParcelPlant reference{slow.length_m, slow.theta2_per_m(), slow.x0_m, slow.outflow_ratio(slow.x0_m)};
  std::vector<std::pair<double, double>> orbit;
  for (int i = 1; i <= 3000; ++i) {
    const double s = i * 1e-4;
    reference.advance({0.0, s}, 0.16 + ((i / 200) % 2 == 1 ? 0.2 : 0.0));
    orbit.emplace_back(s, reference.x_m());
  }
  for (const Preset preset : {Preset::kSlow, Preset::kPhys, Preset::kPaper, Preset::kRad}) {
    for (const FluctuationCase fluctuation : {FluctuationCase::kNone, FluctuationCase::kA, FluctuationCase::kB}) {
      const BizoneParameters p = make_parameters(preset, fluctuation);
      const ScrewClock clock{p.speed_m_per_s, p.fluctuation, p.fluctuation_rad_per_s, 0.0};
      ParcelPlant plant{p.length_m, p.theta2_per_m(), p.x0_m, p.outflow_ratio(p.x0_m)};
      double worst = 0.0;
      for (std::size_t i = 0; i < orbit.size(); ++i) {
        const double g = orbit[i].first / p.speed_m_per_s;
        const double t = clock.calc_time_s(clock.stretched_time_s(0.0) + g, g);
        plant.advance({t, clock.conveyed_m(t)}, 0.16 + (((i + 1) / 200) % 2 == 1 ? 0.2 : 0.0));
        worst = std::max(worst, std::abs(plant.x_m() - orbit[i].second));
      }
      CHECK(worst < 1e-12);  // Rounding of the clock's inverse.
    }
  }
}

TEST_CASE("Parcel plant: a full channel does not make it stiff", "[model]") {
  const BizoneParameters p = slow_A();
  ParcelPlant plant{p.length_m, p.theta2_per_m(), 0.05, 0.1};
  double s = 0.0;
  for (int i = 0; i < 400; ++i) plant.advance({0.0, s += 1e-4}, kMaxFillRatio);
  for (int i = 0; i < 5000; ++i) plant.advance({0.0, s += 1e-4}, 0.05);
  CHECK(plant.mass_residual_m() == Approx(0.0).margin(1e-10));
  CHECK(plant.spill_m() == 0.0);
  CHECK(plant.x_m() > 0.0);
}

TEST_CASE("Parcel plant: with too many parcels the newest are merged and mass is kept", "[model]") {
  const BizoneParameters p = slow_A();
  ParcelPlant plant{p.length_m, p.theta2_per_m(), p.x0_m, p.outflow_ratio(p.x0_m), 64};
  ParcelPlant roomy{p.length_m, p.theta2_per_m(), p.x0_m, p.outflow_ratio(p.x0_m)};
  double s = 0.0;
  for (int i = 0; i < 4000; ++i) {
    s += 1e-4;
    const double U = 0.25 + 0.1 * std::sin(0.05 * i);
    plant.advance({0.0, s}, U);
    roomy.advance({0.0, s}, U);
  }
  CHECK(plant.merged_parcels() > 0);
  CHECK(roomy.merged_parcels() == 0);
  CHECK(plant.mass_residual_m() == Approx(0.0).margin(1e-10));
  // A parcel is at most (L - x)/64 + one sample: the feed is misplaced by less than 2 mm, x by 0.1 of that.
  CHECK(plant.x_m() == Approx(roomy.x_m()).margin(2e-4).epsilon(0));
}

TEST_CASE("Parcel plant: a standing screw moves nothing", "[model]") {
  const BizoneParameters p = slow_A();
  ParcelPlant plant{p.length_m, p.theta2_per_m(), p.x0_m, 0.3};
  plant.advance({1.0, 0.15}, 0.3);
  const double x = plant.x_m();
  plant.advance({5.0, 0.15}, 0.9);
  CHECK(plant.x_m() == x);
  CHECK(plant.inflow_m() == Approx(0.045).margin(1e-15));
}
