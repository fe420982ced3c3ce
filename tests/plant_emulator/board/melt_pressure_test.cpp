#include "plant_emulator/board/melt_pressure.hpp"

#include <catch2/catch.hpp>
#include <cmath>

#include "tests/plant_emulator/board/board_bench.hpp"

using namespace meltbench;
using board::field;
using board::kNode;

namespace {

constexpr double kRamp_Pa_per_s = 1e6;  // 1 Pa per us: the value tells when the sample was taken.

board::MeltPressureSettings make_settings() {
  board::MeltPressureSettings settings;
  settings.sample_time = 2ms;
  settings.latency = 1ms;
  settings.span_end_bar = 1000;
  return settings;
}

struct Report {
  std::int32_t pressure_Pa;
  unsigned status;
  Nanos age;
  bool operator==(const Report&) const = default;
};

struct PressureBench : board::BoardBench<board::MeltPressure> {
  explicit PressureBench(const board::MeltPressureSettings& settings = make_settings(), std::uint64_t seed = 1)
      : BoardBench{"melt_pressure", settings, seed} {
    process.pressure_at = [](double t_s) { return kRamp_Pa_per_s * t_s; };
    start_operational();
  }
  Report report() {
    sync();
    const can::CanFrame frame = last(0x180 + kNode).value();
    REQUIRE(frame.length == 7);
    return {field<std::int32_t>(frame, 0), frame.bytes[4], field<std::uint16_t>(frame, 5) * 1us};
  }
};

}  // namespace

TEST_CASE("Melt pressure: every report carries the value at SYNC minus its age", "[board][melt_pressure]") {
  PressureBench bench;
  for (int k = 1; k <= 200; ++k) {
    bench.run_to(Instant{k * 10ms + k * 7us});
    const Report report = bench.report();
    const Nanos taken_at = bench.now.since_start - report.age;
    REQUIRE(report.pressure_Pa == Approx(taken_at / 1us).margin(0.5));  // Rounded to whole pascals.
    REQUIRE(report.status == 0);
  }
}

TEST_CASE("Melt pressure: a sample is at least its latency and less than one cycle more old",
          "[board][melt_pressure]") {
  PressureBench bench;
  for (int k = 1; k <= 1000; ++k) {
    bench.run_to(Instant{k * 1370us});
    const Nanos age = bench.report().age;
    if (k < 4) continue;  // Power-up sample.
    REQUIRE(age >= 1ms);
    REQUIRE(age < 3ms);
  }
}

TEST_CASE("Melt pressure: how often the board is looked at does not change what it reports", "[board][melt_pressure]") {
  board::MeltPressureSettings settings = make_settings();
  settings.noise_Pa = 1000;
  settings.filter_samples = GENERATE(1, 8);
  PressureBench seldom{settings}, often{settings};
  for (int k = 1; k <= 50; ++k) {
    seldom.run_to(Instant{k * 10ms});
    for (Instant t = often.now; t < Instant{k * 10ms}; t += 130us) often.run_to(t);
    often.run_to(Instant{k * 10ms});
    REQUIRE(seldom.report() == often.report());
  }
}

TEST_CASE("Melt pressure: the seed moves the phase of the samples", "[board][melt_pressure]") {
  PressureBench one{make_settings(), 1}, other{make_settings(), 2};
  one.run_to(Instant{100ms});
  other.run_to(Instant{100ms});
  CHECK(one.report().age != other.report().age);
}

TEST_CASE("Melt pressure: noise has the deviation that the rig asks for", "[board][melt_pressure]") {
  board::MeltPressureSettings settings = make_settings();
  settings.noise_Pa = 1000;
  PressureBench bench{settings};
  bench.process.pressure_at = [](double) { return 1e6; };
  double sum_of_squares = 0;
  constexpr int kCount = 2000;
  for (int k = 1; k <= kCount; ++k) {
    bench.run_to(Instant{k * 10ms});
    sum_of_squares += std::pow(bench.report().pressure_Pa - 1e6, 2);
  }
  CHECK(std::sqrt(sum_of_squares / kCount) == Approx(1000).epsilon(0.07));  // 4 sigma of the estimate.
}

TEST_CASE("Melt pressure: the moving average lags a ramp by half its length", "[board][melt_pressure]") {
  board::MeltPressureSettings settings = make_settings();
  settings.filter_samples = 11;
  PressureBench bench{settings};
  bench.run_to(Instant{1s});
  const Report report = bench.report();
  const double newest_Pa = kRamp_Pa_per_s * to_s(bench.now - report.age);
  CHECK(report.pressure_Pa == Approx(newest_Pa - 5 * 2e-3 * kRamp_Pa_per_s).margin(0.5));
  CHECK(bench.read<std::uint8_t>(0x61A0, 1) == 1);

  REQUIRE(bench.write(0x61A0, 1, std::uint8_t{0}) == 0);
  bench.run_to(Instant{2s});
  const Report unfiltered = bench.report();
  CHECK(unfiltered.pressure_Pa == Approx(kRamp_Pa_per_s * to_s(bench.now - unfiltered.age)).margin(0.5));
}

TEST_CASE("Melt pressure: out of span the value is cut and marked not valid", "[board][melt_pressure]") {
  board::MeltPressureSettings settings = make_settings();
  settings.span_start_bar = 0;
  settings.span_end_bar = 10;
  PressureBench bench{settings};
  bench.process.pressure_at = [](double t_s) { return t_s < 1 ? -5000.0 : t_s < 2 ? 9.9e5 : 11e5; };
  bench.run_to(Instant{500ms});
  CHECK(bench.report().status == (board::kNotValid | board::kNegativeOverload));
  CHECK(bench.report().pressure_Pa == 0);
  bench.run_to(Instant{1500ms});
  CHECK(bench.report().status == 0);
  CHECK(bench.report().pressure_Pa == 990'000);
  bench.run_to(Instant{2500ms});
  CHECK(bench.report().status == (board::kNotValid | board::kPositiveOverload));
  CHECK(bench.report().pressure_Pa == 1'000'000);
  CHECK(bench.read<float>(0x6130, 1) == 10.0F);
}

TEST_CASE("Melt pressure: the value is a multiple of the resolution", "[board][melt_pressure]") {
  board::MeltPressureSettings settings = make_settings();
  settings.resolution_Pa = 250;
  PressureBench bench{settings};
  bench.process.pressure_at = [](double) { return 43'130.0; };
  bench.run_to(Instant{100ms});
  CHECK(bench.report().pressure_Pa == 43'250);
}

TEST_CASE("Melt pressure: the zero command makes the pressure of now the zero", "[board][melt_pressure]") {
  board::MeltPressureSettings settings = make_settings();
  settings.span_start_bar = -1;
  PressureBench bench{settings};
  bench.process.pressure_at = [](double t_s) { return t_s < 1 ? 500.0 : 40'500.0; };
  bench.run_to(Instant{500ms});
  CHECK(bench.write(0x6125, 1, std::uint32_t{0}) == 0x0609'0030);
  REQUIRE(bench.write(0x6125, 1, std::uint32_t{0x6F72'657A}) == 0);
  CHECK(bench.report().pressure_Pa == 0);
  bench.run_to(Instant{1500ms});
  CHECK(bench.report().pressure_Pa == 40'000);
}

TEST_CASE("Melt pressure: needs no wake-up of its own", "[board][melt_pressure]") {
  PressureBench bench;
  CHECK(bench.board.next_deadline() == Instant::never());
}

TEST_CASE("Melt pressure: the melt temperature goes with it once TPDO 3 is switched on", "[board][melt_pressure]") {
  PressureBench bench;
  bench.process.T_melt_at = [](double) { return 143.26; };
  bench.run_to(Instant{100ms});
  bench.sync();
  CHECK_FALSE(bench.last(0x380 + kNode));
  CHECK(bench.write(0x1802, 1, std::uint32_t{0x40000380U + kNode}) == 0);
  bench.run_to(Instant{110ms});
  bench.sync();
  const can::CanFrame frame = bench.last(0x380 + kNode).value();
  CHECK(field<std::int32_t>(frame, 0) == 1433);
  CHECK(frame.bytes[4] == 0);
  bench.process.T_melt_at = [](double) { return board::Process::kNothing; };
  bench.run_to(Instant{120ms});
  bench.sync();
  CHECK(bench.last(0x380 + kNode).value().bytes[4] == board::kNotValid);
}
