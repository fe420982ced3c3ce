#include "plant_emulator/board/preconditioner.hpp"

#include <catch2/catch.hpp>
#include <limits>

#include "tests/plant_emulator/board/board_bench.hpp"

using namespace meltbench;
using board::field;
using board::kNode;

namespace {

board::PreconditionerSettings make_settings() {
  board::PreconditionerSettings settings;
  settings.sample_time = 2ms;
  settings.latency = 1ms;
  settings.resolution_K = 0;
  return settings;
}

struct InletBench : board::BoardBench<board::Preconditioner> {
  explicit InletBench(const board::PreconditionerSettings& settings = make_settings())
      : BoardBench{"preconditioner", settings} {
    process.T_inlet_at = [](double t_s) { return 100.0 + t_s; };  // The value tells when it was measured.
    start_operational();
  }
  void set_point(float T_degC, float feedforward) {
    can::CanFrame frame = can::make_frame(0x200 + kNode, {0, 0, 0, 0, 0, 0, 0, 0});
    canopen::store(std::span{frame.bytes}, 0, T_degC);
    canopen::store(std::span{frame.bytes}, 4, feedforward);
    send(frame);
  }
  void set_mode(float gain, board::InletMode mode) {
    can::CanFrame frame = can::make_frame(0x300 + kNode, {0, 0, 0, 0, static_cast<std::uint8_t>(mode)});
    canopen::store(std::span{frame.bytes}, 0, gain);
    send(frame);
  }
  [[nodiscard]] const plant::MeltInlet& inlet() const { return process.inlets.back().second; }
  [[nodiscard]] unsigned state() {
    sync();
    return last(0x180 + kNode).value().bytes[7];
  }
};

}  // namespace

TEST_CASE("Preconditioner: the loop's set point, feedforward and gain reach the process at the next control cycle",
          "[board][preconditioner]") {
  InletBench bench;
  bench.run_to(Instant{101ms});
  const std::size_t before = bench.process.inlets.size();
  bench.set_mode(1800.0F, board::InletMode::kLoop);
  bench.set_point(131.5F, -27.0F);
  CHECK(bench.process.inlets.size() == before);
  bench.run_to(Instant{103100us});
  REQUIRE(bench.process.inlets.size() == before + 1);
  CHECK(bench.process.inlets.back().first <= Instant{103ms});
  CHECK(bench.inlet().T_reference_degC == 131.5);
  CHECK(bench.inlet().feedforward_W_per_m2 == -27.0);
  CHECK(bench.inlet().gain_W_per_m2K == 1800.0);
  CHECK(bench.inlet().min_W_per_m2 == -5000.0);
}

TEST_CASE("Preconditioner: direct flux leaves the temperature out, and off is no flux", "[board][preconditioner]") {
  InletBench bench;
  bench.set_mode(1800.0F, board::InletMode::kFlux);
  bench.set_point(131.5F, 300.0F);
  bench.run_to(Instant{10ms});
  CHECK(bench.inlet().gain_W_per_m2K == 0.0);
  CHECK(bench.inlet().feedforward_W_per_m2 == 300.0);
  bench.set_mode(1800.0F, board::InletMode::kOff);
  bench.run_to(Instant{20ms});
  CHECK(bench.inlet().wanted_W_per_m2(50) == 0.0);
}

TEST_CASE("Preconditioner: every report carries the temperature at SYNC minus its age", "[board][preconditioner]") {
  InletBench bench;
  for (int k = 1; k <= 100; ++k) {
    bench.run_to(Instant{k * 10ms + k * 13us});
    bench.sync();
    const can::CanFrame frame = bench.last(0x180 + kNode).value();
    REQUIRE(frame.length == 8);
    const double taken_at_s = to_s(bench.now) - field<std::uint16_t>(frame, 4) * 1e-6;
    REQUIRE(static_cast<double>(field<float>(frame, 0)) == Approx(100.0 + taken_at_s).margin(1e-5));  // REAL32.
    REQUIRE(field<std::uint16_t>(frame, 4) >= 1000);
    REQUIRE(field<std::uint16_t>(frame, 4) < 3000);
    REQUIRE(frame.bytes[6] == 0);
  }
}

TEST_CASE("Preconditioner: the mean flux is that between the last two SYNCs", "[board][preconditioner]") {
  InletBench bench;
  bench.run_to(Instant{100ms});
  bench.sync();
  bench.process.flux.now_W_per_m2 = 200;
  bench.run_to(Instant{106ms});
  bench.process.flux.now_W_per_m2 = -50;
  bench.run_to(Instant{110ms});
  bench.sync();
  const can::CanFrame frame = bench.last(0x280 + kNode).value();
  CHECK(static_cast<double>(field<float>(frame, 0)) == Approx(0.6 * 200 - 0.4 * 50));
  CHECK(static_cast<double>(field<float>(frame, 4)) == Approx(-50));
}

TEST_CASE("Preconditioner: cutting shows in the report of that SYNC period only", "[board][preconditioner]") {
  InletBench bench;
  bench.set_mode(0.0F, board::InletMode::kFlux);
  bench.set_point(0.0F, 1.0F);
  bench.run_to(Instant{5ms});
  CHECK(bench.state() == board::kInletOn);
  bench.process.flux.at_min_s += 0.001;
  CHECK(bench.state() == (board::kInletOn | board::kInletAtMin));
  bench.process.flux.at_max_s += 0.001;
  CHECK(bench.state() == (board::kInletOn | board::kInletAtMax));
  CHECK(bench.state() == board::kInletOn);
}

TEST_CASE("Preconditioner: without set points the flux is 0 until they come again", "[board][preconditioner]") {
  InletBench bench;
  bench.set_mode(1800.0F, board::InletMode::kLoop);
  bench.set_point(131.5F, -27.0F);
  bench.run_to(Instant{49ms});
  CHECK(bench.inlet().gain_W_per_m2K == 1800.0);
  bench.run_to(Instant{53ms});
  CHECK(bench.inlet().wanted_W_per_m2(50) == 0.0);
  CHECK(field<std::uint16_t>(bench.last(0x080 + kNode).value(), 0) == board::Preconditioner::kEmcySetPointsLost);
  CHECK((bench.state() & board::kInletMasterLost) != 0);
  bench.set_mode(1800.0F, board::InletMode::kLoop);  // No set point: does not count.
  bench.run_to(Instant{60ms});
  CHECK(bench.inlet().gain_W_per_m2K == 0.0);
  bench.set_point(131.5F, -27.0F);
  bench.run_to(Instant{70ms});
  CHECK(bench.inlet().gain_W_per_m2K == 1800.0);
  CHECK((bench.state() & board::kInletMasterLost) == 0);
}

TEST_CASE("Preconditioner: a lost heartbeat of the master ends the flux as well", "[board][preconditioner]") {
  InletBench bench;
  CHECK(bench.write(0x1016, 1, std::uint32_t{0x007F0064}) == 0);
  bench.send(0x77F, {0x05});
  bench.set_mode(1800.0F, board::InletMode::kLoop);
  for (int k = 1; k <= 20; ++k) {
    bench.run_to(Instant{k * 10ms});
    bench.set_point(131.5F, -27.0F);
  }
  bench.run_to(Instant{205ms});
  CHECK(bench.inlet().wanted_W_per_m2(50) == 0.0);
}

TEST_CASE("Preconditioner: what is no number is refused and the last order stands", "[board][preconditioner]") {
  InletBench bench;
  bench.set_mode(1800.0F, board::InletMode::kLoop);
  bench.set_point(131.5F, -27.0F);
  bench.run_to(Instant{10ms});
  bench.set_point(std::numeric_limits<float>::quiet_NaN(), -27.0F);
  bench.run_to(Instant{20ms});
  CHECK(bench.inlet().T_reference_degC == 131.5);
  CHECK((bench.state() & board::kInletNotANumber) != 0);
  CHECK(bench.write(0x2000, 0, std::numeric_limits<float>::infinity()) == 0x06090030);
}

TEST_CASE("Preconditioner: a biased thermometer misleads the reading and the loop alike", "[board][preconditioner]") {
  board::PreconditionerSettings settings = make_settings();
  settings.bias_K = 0.5;
  InletBench bench{settings};
  bench.process.T_inlet_at = [](double) { return 120.0; };
  bench.set_mode(1800.0F, board::InletMode::kLoop);
  bench.set_point(120.5F, 0.0F);
  bench.run_to(Instant{10ms});
  bench.sync();
  CHECK(static_cast<double>(field<float>(bench.last(0x180 + kNode).value(), 0)) == Approx(120.5));
  CHECK(bench.inlet().wanted_W_per_m2(120.0) == Approx(0.0).margin(1e-9));  // It believes to be where it should be.
}
