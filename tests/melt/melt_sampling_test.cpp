// What sampling, saturation, resolution and lost sensors do to the melt loop.

#include <array>
#include <catch2/catch.hpp>
#include <cmath>

#include "tests/melt/melt_loop.hpp"

namespace meltbench::melt_loop {
namespace {

constexpr std::array kSpeeds_m_per_s{2e-3, 10e-3, 50e-3};
constexpr std::array kIdeal_s{54.06, 10.114, 1.992};

Settings at_speed(double b, double travel_m = 0.3) {
  Settings settings;
  settings.speed_m_per_s = b;
  settings.duration_s = travel_m / b;
  return settings;
}

TEST_CASE("Sampled at 10 ms, the board's loop and the capped law settle as in continuous time", "[melt][sampling]") {
  for (const auto placement : {Placement::kBoard, Placement::kCapped}) {
    for (std::size_t k = 0; k < 3; ++k) {
      auto settings = at_speed(kSpeeds_m_per_s[k]);
      settings.placement = placement;
      CAPTURE(static_cast<int>(placement), settings.speed_m_per_s);
      const auto result = run(settings);
      CHECK(result.settle_s() == Approx(kIdeal_s[k]).epsilon(0.06));
      CHECK(result.largest(&Sample::T_inlet_degC) < 135.0);
    }
  }
}

TEST_CASE("The published law sampled at 10 ms holds at 2 mm/s and diverges at 10 and 50 mm/s", "[melt][sampling]") {
  for (const double b : kSpeeds_m_per_s) {
    CAPTURE(b);
    auto settings = at_speed(b);
    settings.placement = Placement::kDirect;
    const auto result = run(settings);
    if (b < 5e-3) {
      CHECK(result.settle_s() == Approx(kIdeal_s[0]).epsilon(0.05));
    } else {
      CHECK(result.status != plant::MeltStatus::kRunning);
      CHECK(result.ended_s < 0.2);
    }
  }
}

TEST_CASE("The sampled gamma loop is stable up to 1.2 times 2α/b²", "[melt][sampling]") {
  for (const double b : {10e-3, 50e-3}) {
    const double limit_s = 1.2 * 2.0 * 0.373 / (955.0 * 1895.0) / (b * b);
    for (const double share : {0.8, 1.25}) {
      CAPTURE(b, share);
      auto settings = at_speed(b);
      settings.placement = Placement::kDirect;
      settings.sample_s = share * limit_s;
      settings.duration_s = 400.0 * settings.sample_s;
      const auto result = run(settings);
      CHECK((result.status == plant::MeltStatus::kRunning) == (share < 1.0));
    }
  }
}

TEST_CASE("At 100 ms the board's loop still settles at 50 mm/s, the capped law with a stale sample does not",
          "[melt][sampling]") {
  auto settings = at_speed(50e-3);
  settings.sample_s = 0.1;
  const auto board = run(settings);
  CHECK(board.settle_s() < 3.1);
  CHECK(board.largest(&Sample::T_inlet_degC) < 135.0);
  settings.placement = Placement::kCapped;
  settings.delay_samples = 1;
  const auto capped = run(settings);
  CHECK(capped.worst_solid_margin_K < -5.0);
  CHECK(capped.settle_s() == Approx(capped.ended_s));
}

// At 50 mm/s and 500 W/m² the converged change is 1.2 % (steps of 20 um); one sample is 0.5 %.
TEST_CASE("Symmetric saturation down to 500 W/m² changes settling by less than 1.5 %", "[melt][saturation]") {
  for (const double b : kSpeeds_m_per_s) {
    const auto free = run(at_speed(b));
    for (const double limit : {5000.0, 1000.0, 500.0}) {
      CAPTURE(b, limit);
      auto settings = at_speed(b);
      settings.flux_min_W_per_m2 = -limit;
      settings.flux_max_W_per_m2 = limit;
      const auto result = run(settings);
      CHECK(result.settle_s() == Approx(free.settle_s()).epsilon(0.015));
      CHECK(result.largest(&Sample::flux_W_per_m2) <= limit);
      CHECK(result.smallest(&Sample::flux_W_per_m2) >= -limit);
    }
  }
}

TEST_CASE("An inlet that can only cool loses the melt under full state feedback, at every speed",
          "[melt][saturation]") {
  for (const double b : kSpeeds_m_per_s) {
    CAPTURE(b);
    auto settings = at_speed(b);
    settings.full_state = true;
    settings.flux_max_W_per_m2 = 0.0;
    CHECK(run(settings).status == plant::MeltStatus::kMeltLost);
  }
}

// At 2 mm/s CVODE's front does the same (melt_referee_test.cpp).
TEST_CASE("An inlet that can only cool loses the melt under output feedback, or validity at 2 mm/s",
          "[melt][saturation]") {
  for (const double b : kSpeeds_m_per_s) {
    CAPTURE(b);
    auto settings = at_speed(b, 1.0);
    settings.flux_max_W_per_m2 = 0.0;
    const auto result = run(settings);
    CHECK(result.largest(&Sample::front_m) > 90e-3);
    if (b < 5e-3) {
      CHECK(result.worst_solid_margin_K < -5.0);  // It comes back from 92 mm, through granules above T_m.
    } else {
      CHECK(result.status == plant::MeltStatus::kMeltLost);
    }
  }
}

TEST_CASE("0.1 K and 10 um of sensor resolution cost less than 0.15 mm", "[melt][sampling]") {
  for (std::size_t k = 0; k < 3; ++k) {
    auto settings = at_speed(kSpeeds_m_per_s[k]);
    settings.T_quantum_K = 0.1;
    settings.front_quantum_m = 10e-6;
    CAPTURE(settings.speed_m_per_s);
    const auto result = run(settings);
    CHECK(result.settle_s() == Approx(kIdeal_s[k]).epsilon(0.06));
    // A resting thermocouple reads up to half its step wrong, which is a bias: 2.9 mm/K.
    CHECK(std::abs(result.samples.back().front_m - 50e-3) < 0.15e-3);
    CHECK(result.largest(&Sample::T_inlet_degC) < 135.0);
  }
}

TEST_CASE("Silent sensors: the observer's model carries the loop through 1 s in mid-transient at every speed",
          "[melt][stale]") {
  for (const double b : kSpeeds_m_per_s) {
    for (const auto placement : {Placement::kBoard, Placement::kCapped}) {
      for (const int which : {1, 2, 3}) {
        CAPTURE(b, static_cast<int>(placement), which);
        auto settings = at_speed(b);
        settings.placement = placement;
        const Silence silence{50e-3 / b, 50e-3 / b + 1.0};
        if ((which & 1) != 0) settings.inlet_silent = silence;
        if ((which & 2) != 0) settings.front_silent = silence;
        const auto result = run(settings);
        CHECK(result.status == plant::MeltStatus::kRunning);
        CHECK(result.largest(&Sample::front_m) < 50.2e-3);
        CHECK(result.largest(&Sample::T_inlet_degC) < 135.05);
        CHECK(result.observer_tripped == (b > 20e-3));  // 1 s is longer than half a flush at 50 mm/s only.
      }
    }
  }
}

TEST_CASE("Silent sensors: holding the last value instead ruins the fast screw", "[melt][stale]") {
  auto settings = at_speed(50e-3);
  settings.on_silence = OnSilence::kHold;
  settings.placement = Placement::kCapped;
  settings.inlet_silent = {1.0, 2.0};
  CHECK(run(settings).status == plant::MeltStatus::kSuperheated);
}

TEST_CASE("A thermocouple bias of 0.1 K is an offset of the front, and the trim takes it away", "[melt][trim]") {
  const std::array offset_mm{0.20, 0.27, 0.29};
  for (std::size_t k = 0; k < 3; ++k) {
    auto settings = at_speed(kSpeeds_m_per_s[k], 1.2);
    settings.T_bias_K = 0.1;
    CAPTURE(settings.speed_m_per_s);
    CHECK(run(settings).samples.back().front_m - 50e-3 == Approx(1e-3 * offset_mm[k]).margin(0.02e-3));
    law::BacksteppingMeltLaw trimmed{{.trim_rate_K_per_m2 = 6000.0}};
    CHECK(std::abs(run(settings, trimmed).samples.back().front_m - 50e-3) < 0.03e-3);
  }
}

TEST_CASE("A wrong model is an offset too: hbar and speed as far off as a rig may be", "[melt][mismatch]") {
  const std::array hbar_offset_mm{1.50, 0.32, 0.06};
  for (std::size_t k = 0; k < 3; ++k) {
    auto settings = at_speed(kSpeeds_m_per_s[k], 0.8);
    settings.preset.model = law::hdpe_melt_model(2.4e4);
    CAPTURE(settings.speed_m_per_s);
    const double offset = run(settings).samples.back().front_m - 50e-3;
    CHECK(offset == Approx(1e-3 * hbar_offset_mm[k]).epsilon(0.1));
  }
}

}  // namespace
}  // namespace meltbench::melt_loop
