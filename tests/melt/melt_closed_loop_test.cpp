// The published loop, its comparisons and its theorem, against references of another integrator.

#include <array>
#include <catch2/catch.hpp>
#include <cmath>
#include <fstream>
#include <sstream>
#include <string>

#include "tests/melt/melt_loop.hpp"

namespace meltbench::melt_loop {
namespace {

constexpr std::array kSpeeds_m_per_s{2e-3, 10e-3, 50e-3};

struct Reference {
  std::string preset;
  double speed_m_per_s;
  std::array<double, 6> t_s, front_m;
  double settle_s, iae_m_s, T_inlet_min_degC;
};

std::vector<Reference> read_references() {
  std::ifstream file{std::string{MELTBENCH_SOURCE_DIR} + "/fixtures/reference/melt_closed_loop.csv"};
  std::vector<Reference> rows;
  for (std::string line; std::getline(file, line);) {
    if (line.empty() || line[0] == '#' || line.rfind("preset", 0) == 0) continue;
    std::istringstream fields{line};
    Reference row;
    char comma = 0;
    std::getline(fields, row.preset, ',');
    fields >> row.speed_m_per_s;
    for (std::size_t i = 0; i < 6; ++i) fields >> comma >> row.t_s[i] >> comma >> row.front_m[i];
    fields >> comma >> row.settle_s >> comma >> row.iae_m_s >> comma >> row.T_inlet_min_degC;
    rows.push_back(row);
  }
  return rows;
}

/// Published start, law and observer every 0.1 mm of travel, local loop in the preconditioner.
Settings published(const Preset& preset, double b, double travel_m = 0.3) {
  Settings settings;
  settings.preset = preset;
  settings.speed_m_per_s = b;
  settings.sample_s = 0.1e-3 / b;
  settings.duration_s = travel_m / b;
  return settings;
}

TEST_CASE("Output feedback: front, settling and inlet agree with CVODE's loop, both presets, three speeds",
          "[melt][closed-loop]") {
  const auto references = read_references();
  REQUIRE(references.size() == 6);
  for (const Reference& reference : references) {
    CAPTURE(reference.preset, reference.speed_m_per_s);
    auto settings = published(preset_named(reference.preset), reference.speed_m_per_s, 0.5);
    settings.max_travel_m = 5e-5;
    settings.sample_s *= 0.5;
    const auto result = run(settings);
    REQUIRE(result.status == plant::MeltStatus::kRunning);
    for (std::size_t i = 0; i < 6; ++i) {
      CHECK(result.front_at_m(reference.t_s[i]) == Approx(reference.front_m[i]).margin(0.1e-3));
    }
    CHECK(result.settle_s() == Approx(reference.settle_s).epsilon(0.03));
    CHECK(result.integral_of_error_mm_s() == Approx(1e3 * reference.iae_m_s).epsilon(0.01));
    CHECK(result.smallest(&Sample::T_inlet_degC) == Approx(reference.T_inlet_min_degC).margin(1.0));
    CHECK(result.samples.back().front_m == Approx(50e-3).margin(0.01e-3));
    CHECK(result.largest(&Sample::front_m) < 50.1e-3);
    CHECK(result.largest(&Sample::T_inlet_degC) < 135.0);
    CHECK(result.worst_solid_margin_K > -0.05);   // (6)
    CHECK(result.worst_liquid_margin_K > -0.05);  // (7)
  }
}

TEST_CASE("Output feedback: it settles in 54.1, 10.1 and 1.99 s sampled at 10 ms, the slower time being no solution",
          "[melt][closed-loop]") {
  const std::array expected_s{54.06, 10.114, 1.992};
  for (std::size_t k = 0; k < 3; ++k) {
    CAPTURE(kSpeeds_m_per_s[k]);
    auto settings = published(paper_preset(), kSpeeds_m_per_s[k]);
    settings.sample_s = 10e-3;
    const auto result = run(settings);
    CHECK(result.settle_s() == Approx(expected_s[k]).epsilon(0.05));
    CHECK(result.largest(&Sample::T_inlet_degC) < 135.0);
    CHECK(result.largest(&Sample::front_m) < 50.1e-3);
  }
}

TEST_CASE("Output feedback: halving cells and steps moves settling by less than 3 %", "[melt][closed-loop]") {
  for (const char* preset : {"paper", "bench"}) {
    for (const double b : kSpeeds_m_per_s) {
      CAPTURE(preset, b);
      const auto coarse = published(preset_named(preset), b, 0.15);
      auto fine = coarse;
      fine.plant_cells = fine.observer_cells = 200;
      fine.sample_s *= 0.5;
      fine.max_travel_m *= 0.5;
      CHECK(run(coarse).settle_s() == Approx(run(fine).settle_s()).epsilon(0.03));
    }
  }
}

TEST_CASE("Output feedback: the heat through the settled front is that of (18)", "[melt][closed-loop]") {
  const std::array K_paper{15.7282591, 3.14680506, .629370245};
  for (std::size_t k = 0; k < 3; ++k) {
    CAPTURE(kSpeeds_m_per_s[k]);
    const auto result = run(published(paper_preset(), kSpeeds_m_per_s[k], 0.8));
    CHECK(result.front_flux_W_per_m2 == Approx(K_paper[k]).epsilon(1e-3));
  }
}

TEST_CASE("Full state feedback: faster than with the observer, at the price of a colder inlet", "[melt][closed-loop]") {
  const std::array settle_s{50.26, 8.874, 1.709};
  const std::array T_min_degC{86.6, 92.4, 93.2};
  for (std::size_t k = 0; k < 3; ++k) {
    CAPTURE(kSpeeds_m_per_s[k]);
    auto settings = published(paper_preset(), kSpeeds_m_per_s[k]);
    settings.full_state = true;
    const auto result = run(settings);
    CHECK(result.settle_s() == Approx(settle_s[k]).epsilon(0.05));
    CHECK(result.smallest(&Sample::T_inlet_degC) == Approx(T_min_degC[k]).margin(1.0));
  }
}

TEST_CASE("Observer: within half a kelvin of the granules after one flush, never sooner", "[melt][observer]") {
  const std::array exact_s{18.7, 3.37, 0.632};
  const std::array late_share{0.08, 0.22, 0.32};  // Smear sqrt(b dx t) of 100 cells.
  for (std::size_t k = 0; k < 3; ++k) {
    CAPTURE(kSpeeds_m_per_s[k]);
    const auto result = run(published(paper_preset(), kSpeeds_m_per_s[k]));
    double within_s = 0.0;
    for (const Sample& sample : result.samples) {
      if (sample.observer_error_K < 0.5) {
        within_s = sample.t_s;
        break;
      }
    }
    CHECK(within_s > 0.98 * exact_s[k]);
    CHECK(within_s < (1.0 + late_share[k]) * exact_s[k]);
  }
}

TEST_CASE(
    "Theorem 2: with T_b = T_m and q_m = 0 the front only advances, never past the set point, and Z decays no "
    "faster than e^{-ct}",
    "[melt][theorem]") {
  const std::array settle_s{55.32, 10.151, 1.993};
  for (std::size_t k = 0; k < 3; ++k) {
    const double b = kSpeeds_m_per_s[k];
    CAPTURE(b);
    auto settings = published(paper_preset(), b, 0.2);
    settings.T_barrel_degC = 135.0;
    settings.preset.plant.nozzle_flux_W_per_m2 = settings.preset.model.nozzle_flux_W_per_m2 = 0.0;
    settings.plant_cells = settings.observer_cells = 200;
    settings.sample_s = 0.02e-3 / b;
    const auto result = run(settings);
    CHECK(result.settle_s() == Approx(settle_s[k]).epsilon(0.01));
    CHECK(result.largest(&Sample::front_m) < 50e-3 + 1e-7);
    CHECK(result.worst_solid_margin_K > -1e-4);
    const double Z0 = result.samples.front().Z_W_per_m2;
    double last = settings.front_start_m;
    for (const Sample& sample : result.samples) {
      REQUIRE(sample.front_m > last - 1e-9);
      last = sample.front_m;
      // Below a hundredth of its start Z is the difference of integrals that agree to the cells' accuracy only.
      if (sample.Z_W_per_m2 < 0.01 * Z0) continue;
      REQUIRE(sample.Z_W_per_m2 * std::exp(100.0 * b * (sample.t_s - settings.sample_s)) > 0.995 * Z0);
    }
    CHECK(result.largest(&Sample::flux_W_per_m2) > 500.0);  // "Freezing controller" or not: it must heat on the way.
  }
}

TEST_CASE("PI at 2 mm/s: the inlet passes the melting point at 2.9 min and the front is lost", "[melt][pi]") {
  auto settings = published(paper_preset(), 2e-3);
  settings.duration_s = 400.0;
  law::PiMeltLaw pi{{.proportional_W_per_m3 = 300.0, .integral_W_per_m3s = 4.5}};
  const auto result = run(settings, pi);
  double crossed_s = 0.0;
  for (const Sample& sample : result.samples) {
    if (sample.T_inlet_degC > 135.0) {
      crossed_s = sample.t_s;
      break;
    }
  }
  CHECK(crossed_s == Approx(2.88 * 60.0).epsilon(0.01));
  CHECK(result.largest(&Sample::front_m) == Approx(92e-3).margin(1e-3));
  CHECK(result.status == plant::MeltStatus::kSolidLost);
  CHECK(result.ended_s == Approx(308.0).epsilon(0.01));
}

TEST_CASE("PI at 2 mm/s: without the integral part it does converge, in more than ten minutes", "[melt][pi]") {
  auto settings = published(paper_preset(), 2e-3);
  settings.duration_s = 1200.0;
  law::PiMeltLaw pi{{.proportional_W_per_m3 = 300.0, .integral_W_per_m3s = 0.0}};
  const auto result = run(settings, pi);
  CHECK(result.settle_s() > 600.0);
  CHECK(result.settle_s() < 900.0);
  CHECK(result.samples.back().front_m == Approx(50e-3).margin(0.6e-3));
}

TEST_CASE("Open loop and PI from cold granules push the melt out at 10 and 50 mm/s", "[melt][open-loop][pi]") {
  law::OpenLoopMeltLaw open_loop;
  law::PiMeltLaw pi{{.proportional_W_per_m3 = 300.0, .integral_W_per_m3s = 4.5}};
  const std::array lost_s{18.0, 3.4};
  for (std::size_t k = 0; k < 2; ++k) {
    for (law::MeltLaw* law : {static_cast<law::MeltLaw*>(&open_loop), static_cast<law::MeltLaw*>(&pi)}) {
      law->reset();
      auto settings = published(paper_preset(), kSpeeds_m_per_s[k + 1], 0.5);
      const auto result = run(settings, *law);
      CAPTURE(settings.speed_m_per_s);
      CHECK(result.status == plant::MeltStatus::kMeltLost);
      CHECK(result.ended_s == Approx(lost_s[k]).epsilon(0.03));
    }
  }
}

TEST_CASE("Open loop at 2 mm/s: the front swings to 91 mm and is not back after six minutes", "[melt][open-loop]") {
  auto settings = published(paper_preset(), 2e-3);
  settings.duration_s = 360.0;
  law::OpenLoopMeltLaw open_loop;
  const auto result = run(settings, open_loop);
  CHECK(result.largest(&Sample::front_m) == Approx(91.4e-3).margin(0.5e-3));
  CHECK(result.samples.back().front_m == Approx(76.7e-3).margin(0.5e-3));
}

// The coarse grid explains the published six minutes; that it is no solution shows in its settling time being
// proportional to the cell width.
TEST_CASE("Coarse two-point grid: three speeds settle alike in six minutes, and half the cell halves that",
          "[melt][coarse]") {
  for (const double b : kSpeeds_m_per_s) {
    CAPTURE(b);
    auto settings = published(paper_preset(), b);
    settings.sample_s = b < 5e-3 ? 50e-3 : b < 20e-3 ? 20e-3 : 10e-3;
    settings.max_travel_m = 0.5e-3;
    settings.duration_s = 450.0;
    settings.solid = plant::MeltDiscretisation::kCoarseTwoPointSlope;
    settings.plant_cells = 120;
    const double published_grid_s = run(settings).settle_s();
    CHECK(published_grid_s > 330.0);
    CHECK(published_grid_s < 400.0);
    settings.plant_cells = 240;
    CHECK(run(settings).settle_s() < 0.6 * published_grid_s);
  }
}

}  // namespace
}  // namespace meltbench::melt_loop
