#include "plant_emulator/model/bizone_parameters.hpp"

#include <catch2/catch.hpp>
#include <cmath>
#include <limits>

using namespace meltbench::plant;

TEST_CASE("Bizone parameters: theta2 and the outflow ratio are those of the paper's constants", "[model]") {
  const BizoneParameters p;
  CHECK(p.theta2_per_m() == Approx(2.114292618098).epsilon(1e-12));
  CHECK(p.outflow_ratio(0.1) == Approx(0.174528772315).epsilon(1e-11));
  CHECK(p.outflow_ratio(0.16) == Approx(0.252776022389).epsilon(1e-11));
  CHECK(p.outflow_ratio(0.2) == Approx(0.297189437038).epsilon(1e-11));
}

TEST_CASE("Bizone parameters: the free section follows from B and a channel as wide as the pitch", "[model]") {
  const BizoneParameters p;
  const double W = p.pitch_m;
  const double H = std::cbrt(12.0 * p.pressure_flow_m4 / W);  // [D17] (114)
  CHECK(p.area_m2 == Approx(W * H).epsilon(1e-7));
  CHECK(p.holding_feed_kg_per_s(0.16) == Approx(1.05237e-3).epsilon(1e-5));
  CHECK(p.holding_feed_kg_per_s(0.1) == Approx(7.26608e-4).epsilon(1e-5));
}

TEST_CASE("Bizone parameters: every preset has both fluctuations of the paper in its own time scale", "[model]") {
  const auto paper = make_parameters(Preset::kPaper, FluctuationCase::kA);
  CHECK(paper.speed_m_per_s == 0.9);
  CHECK(paper.fluctuation == 0.1);
  CHECK(paper.fluctuation_rad_per_s == 4.0);
  CHECK(paper.delay_reading == DelayReading::kPaper);
  const auto slow = make_parameters(Preset::kSlow, FluctuationCase::kB);
  CHECK(slow.speed_m_per_s == Approx(paper.speed_m_per_s / 60.0));
  CHECK(slow.fluctuation == 0.4);
  CHECK(slow.fluctuation_rad_per_s == Approx(0.8 / 60.0));
  CHECK(slow.delay_reading == DelayReading::kTransport);
  CHECK(make_parameters(Preset::kPhys, FluctuationCase::kB).fluctuation_rad_per_s == 0.8);
  CHECK(make_parameters(Preset::kRad, FluctuationCase::kA).speed_m_per_s == Approx(0.0942478).epsilon(1e-6));
  CHECK(make_parameters(Preset::kSlow, FluctuationCase::kNone).fluctuation == 0.0);
}

TEST_CASE("Bizone parameters: presets and cases are found by the names that rigs use", "[model]") {
  CHECK(find_preset("slow") == Preset::kSlow);
  CHECK(find_preset("rad") == Preset::kRad);
  CHECK_FALSE(find_preset("Slow").has_value());
  CHECK(find_fluctuation_case("B") == FluctuationCase::kB);
  CHECK_FALSE(find_fluctuation_case("C").has_value());
}

TEST_CASE("Bizone parameters: a value out of range is named with its range", "[model]") {
  BizoneParameters p;
  CHECK_NOTHROW(p.check());
  p.fluctuation = 1.0;
  CHECK_THROWS_WITH(p.check(), Catch::Contains("fluctuation = 1") && Catch::Contains("[0, 1)"));
  p = {};
  p.x0_m = 0.3;
  CHECK_THROWS_WITH(p.check(), Catch::Contains("x0_m = 0.3") && Catch::Contains("0.2"));
  p = {};
  p.speed_m_per_s = std::numeric_limits<double>::quiet_NaN();
  CHECK_THROWS_WITH(p.check(), Catch::Contains("speed_m_per_s"));
  p = {};
  p.U_before_start = 1.0;
  CHECK_THROWS_WITH(p.check(), Catch::Contains("U_before_start"));
}
