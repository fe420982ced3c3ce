#include "plant_emulator/board/heater.hpp"

#include <catch2/catch.hpp>
#include <cmath>
#include <complex>

#include "tests/plant_emulator/board/board_bench.hpp"

using namespace meltbench;
using board::field;
using board::kNode;

namespace {

constexpr std::uint8_t kAll = 0x1F;

board::HeaterSettings make_settings() {
  board::HeaterSettings settings;
  settings.barrel_zones = 4;
  return settings;
}

struct HeaterBench : board::BoardBench<board::Heater> {
  explicit HeaterBench(const board::HeaterSettings& settings = make_settings(), double T_degC = 25.0)
      : BoardBench{"heater", settings} {
    process.barrel.emplace(plant::BarrelParameters::with_zones(4), T_degC);
    start_operational();
  }
  /// Set points for all, kept alive every 500 ms.
  void run(double set_degC, std::uint8_t release, Nanos span) {
    const auto count = static_cast<std::int16_t>(set_degC * 10);
    for (const Instant end = now + span; now < end;) {
      can::CanFrame zones = can::make_frame(0x200 + kNode, {0, 0, 0, 0, 0, 0, 0, 0});
      for (std::size_t i = 0; i < 4; ++i) canopen::store(std::span{zones.bytes}, 2 * i, count);
      send(zones);
      can::CanFrame nozzle = can::make_frame(0x300 + kNode, {0, 0, release});
      canopen::store(std::span{nozzle.bytes}, 0, count);
      send(nozzle);
      run_to(std::min(now + 500ms, end));
    }
  }
  [[nodiscard]] unsigned state(std::uint8_t channel) { return read<std::uint8_t>(0x2102, channel); }
  [[nodiscard]] std::uint16_t last_emcy() const { return field<std::uint16_t>(last(0x080 + kNode).value(), 0); }
};

/// Ultimate gain [%/K] and period [s] of a zone that touches no other: where the phase of its three lags, with half a
/// sample of delay for the sampled output, is -180 degrees.
std::pair<double, double> calc_ultimate(const plant::HeatedZone& zone, double sample_s) {
  const double lag_s = zone.heat_capacity_J_per_K / zone.to_ambient_W_per_K;
  const double gain_K = zone.max_power_W / zone.to_ambient_W_per_K;
  const auto response = [&](double w) {
    const std::complex<double> jw{0.0, w};
    return gain_K / ((1.0 + lag_s * jw) * (1.0 + zone.heater_lag_s * jw) * (1.0 + zone.thermocouple_lag_s * jw));
  };
  const auto phase = [&](double w) {
    return -std::atan(lag_s * w) - std::atan(zone.heater_lag_s * w) - std::atan(zone.thermocouple_lag_s * w) -
           0.5 * sample_s * w;
  };
  double low = 1e-3, high = 10.0;
  for (int i = 0; i < 100; ++i) {
    const double middle = 0.5 * (low + high);
    (phase(middle) > -M_PI ? low : high) = middle;
  }
  return {100.0 / std::abs(response(low)), 2.0 * M_PI / low};
}

}  // namespace

TEST_CASE("Heater: nothing is heated before it is released", "[board][heater]") {
  HeaterBench bench;
  bench.run(150, 0, 20s);
  for (std::size_t i = 0; i < 5; ++i) CHECK(bench.process.barrel->T_degC(i) == 25.0);
  CHECK((bench.state(1) & board::kZoneOn) == 0);
}

TEST_CASE("Heater: from cold every zone comes to its set point, without much overshoot, and stays", "[board][heater]") {
  board::HeaterSettings settings = make_settings();
  settings.proportional = GENERATE(false, true);
  HeaterBench bench{settings};
  double highest_degC = 0;
  for (int k = 0; k < 120; ++k) {
    bench.run(145, kAll, 10s);
    for (std::size_t i = 0; i < 5; ++i) highest_degC = std::max(highest_degC, bench.process.barrel->T_degC(i));
  }
  CHECK(highest_degC < 150.0);
  for (int k = 0; k < 30; ++k) {
    bench.run(145, kAll, 3s);
    for (std::size_t i = 0; i < 5; ++i) REQUIRE(bench.process.barrel->T_degC(i) == Approx(145.0).margin(0.3));
  }
  for (std::uint8_t n = 1; n <= 5; ++n) CHECK(bench.state(n) == (board::kZoneOn | board::kZoneWarm));
}

TEST_CASE("Heater: temperature, status and state of the zones are on the wire every tenth SYNC", "[board][heater]") {
  HeaterBench bench;
  bench.process.barrel->start_at(std::array{141.0, 142.0, 143.0, 144.0, 145.0}, std::array{0.0, 0.0, 0.0, 0.0, 0.0});
  bench.run_to(Instant{200ms});
  for (int k = 0; k < 10; ++k) bench.sync();
  REQUIRE(bench.count(0x180 + kNode) == 1);
  const can::CanFrame first = bench.last(0x180 + kNode).value();
  CHECK(field<std::int16_t>(first, 0) == 1410);
  CHECK(first.bytes[2] == 0);
  CHECK(field<std::int16_t>(first, 4) == 1420);
  CHECK(field<std::int16_t>(bench.last(0x280 + kNode).value(), 4) == 1440);
  CHECK(bench.last(0x380 + kNode).value().length == 8);
  CHECK(field<std::int16_t>(bench.last(0x480 + kNode).value(), 0) == 1450);
}

TEST_CASE("Heater: a relay output gives the mean power that the controller asks for", "[board][heater]") {
  board::HeaterSettings settings = make_settings();
  settings.integral_s = 0;
  settings.derivative_s = 0;
  settings.band_K = 1000;  // So slow a loop that the output hardly moves.
  settings.cycle_s = 2;
  settings.supervision_s = 3600;
  HeaterBench bench{settings};
  bench.run(275, 0x01, 10s);
  const double began_J = bench.process.barrel->heated_J();
  bench.run(275, 0x01, 20s);
  const double Y = (275 - bench.process.barrel->T_thermocouple_degC(0)) / 1000;
  // Ten cycles; over 30 s the zone has warmed by some kelvin of the 250.
  CHECK((bench.process.barrel->heated_J() - began_J) / 20 == Approx(500 * Y).epsilon(0.05));
}

TEST_CASE("Heater: an open thermocouple reads 03, takes the power away and stays off until acknowledged",
          "[board][heater]") {
  HeaterBench bench;
  bench.run(150, kAll, 20s);
  bench.process.thermocouple_is_open[2] = true;
  bench.run(150, kAll, 1s);
  CHECK(bench.read<std::uint8_t>(0x6150, 3) == 0x03);
  CHECK(bench.state(3) == (board::kZoneSensorOpen | board::kZoneAlarm));
  CHECK(bench.process.heater_share[2] == 0.0);
  CHECK(bench.last_emcy() == board::Heater::kEmcySensor);
  CHECK(bench.last(0x080 + kNode).value().bytes[3] == 3);
  CHECK(bench.process.heater_share[1] > 0.0);  // The others go on.
  CHECK(bench.write(0x2105, 0, std::uint8_t{0x04}) == 0);
  CHECK((bench.state(3) & board::kZoneAlarm) != 0);  // Its cause is still there.
  bench.process.thermocouple_is_open[2] = false;
  bench.run(150, kAll, 1s);
  CHECK((bench.state(3) & board::kZoneAlarm) != 0);
  CHECK(bench.write(0x2105, 0, std::uint8_t{0x04}) == 0);
  bench.run(150, kAll, 1s);
  CHECK((bench.state(3) & board::kZoneOn) != 0);
  CHECK(bench.last_emcy() == 0);
}

TEST_CASE("Heater: a zone above its limit is switched off", "[board][heater]") {
  board::HeaterSettings settings = make_settings();
  settings.max_degC = 60;
  HeaterBench bench{settings};
  bench.run(100, kAll, 120s);
  CHECK((bench.state(2) & board::kZoneTooHot) != 0);
  CHECK(bench.process.heater_share[1] == 0.0);
  CHECK(bench.last_emcy() == board::Heater::kEmcyTooHot);
}

TEST_CASE("Heater: a band that does not heat is found within its time", "[board][heater]") {
  HeaterBench bench;
  plant::BarrelParameters parameters = plant::BarrelParameters::with_zones(4);
  parameters.zones[1].max_power_W = 0;
  for (auto& zone : parameters.zones) zone.to_next_W_per_K = 0;
  bench.process.barrel.emplace(parameters, 25.0);
  bench.run(150, kAll, 119s);
  CHECK(bench.state(2) == board::kZoneOn);
  bench.run(150, kAll, 2s);
  CHECK((bench.state(2) & board::kZoneNoRise) != 0);
  CHECK((bench.state(1) & board::kZoneAlarm) == 0);
}

TEST_CASE("Heater: a zone that gets hotter without power is found", "[board][heater]") {
  HeaterBench bench;
  bench.process.barrel->start_at(std::array{150.0, 150.0, 150.0, 150.0, 150.0}, std::array{0.0, 0.0, 0.0, 0.0, 0.0});
  for (int k = 0; k < 125; ++k) {
    bench.process.barrel->set_to_polymer_W(1, -400.0);  // A welded relay in effect.
    bench.run(100, kAll, 1s);
  }
  CHECK((bench.state(2) & board::kZoneUnasked) != 0);
  CHECK(bench.last_emcy() == board::Heater::kEmcyUnasked);
}

TEST_CASE("Heater: without set points everything is off until they come again", "[board][heater]") {
  HeaterBench bench;
  bench.run(150, kAll, 20s);
  CHECK(bench.process.heater_share[0] == 1.0);
  bench.run_to(bench.now + 501ms);
  for (const double share : bench.process.heater_share) CHECK(share == 0.0);
  CHECK(bench.last_emcy() == board::Heater::kEmcySetPointsLost);
  CHECK((bench.read<std::uint8_t>(0x2001) & board::kHeaterMasterLost) != 0);
  bench.run_to(bench.now + 10s);
  for (const double share : bench.process.heater_share) CHECK(share == 0.0);
  bench.run(150, kAll, 1s);
  CHECK(bench.process.heater_share[0] == 1.0);
}

TEST_CASE("Heater: release by bit and by 6422 are the same", "[board][heater]") {
  HeaterBench bench;
  CHECK(bench.write(0x6422, 3, std::uint8_t{1}) == 0);
  CHECK(bench.read<std::uint8_t>(0x2000) == 0x04);
  CHECK(bench.write(0x2000, 0, std::uint8_t{0x11}) == 0);
  CHECK(bench.read<std::uint8_t>(0x6422, 3) == 0);
  CHECK(bench.read<std::uint8_t>(0x6422, 5) == 1);
}

TEST_CASE("Heater: a channel that the plant has not is not fitted and not driven", "[board][heater]") {
  board::HeaterSettings settings = make_settings();
  settings.barrel_zones = 2;
  HeaterBench bench{settings};
  bench.run(150, kAll, 2s);
  CHECK(bench.read<std::uint16_t>(0x6110, 3) == 0);
  CHECK(bench.read<std::uint8_t>(0x6150, 3) == 0x01);
  CHECK((bench.state(3) & board::kZoneOn) == 0);
  CHECK(bench.process.heater_share[2] == 0.0);
  CHECK(bench.process.heater_share[1] == 1.0);
}

TEST_CASE("Heater: autotune finds the ultimate gain and period of the zone, and the loop is good with what follows",
          "[board][heater][autotune]") {
  board::HeaterSettings settings = make_settings();
  settings.autotune_hysteresis_K = 0.05;
  settings.proportional = true;
  HeaterBench bench{settings};
  plant::BarrelParameters parameters = plant::BarrelParameters::with_zones(4);
  parameters.zones[0].to_next_W_per_K = 0;
  bench.process.barrel.emplace(parameters, 120.0);
  CHECK(bench.write(0x2110, 1, std::uint8_t{1}) == 0x08000022);  // Not released yet.
  bench.run(145, 0x01, 1s);
  CHECK(bench.write(0x2110, 1, std::uint8_t{1}) == 0);
  bench.run(145, 0x01, 2s);
  CHECK(bench.read<std::uint8_t>(0x2111, 1) == 1);
  bench.run(145, 0x01, 1500s);
  REQUIRE(bench.read<std::uint8_t>(0x2111, 1) == 2);
  const auto [Ku, Pu_s] = calc_ultimate(parameters.zones[0], 0.1);
  const auto found_Ku = static_cast<double>(bench.read<float>(0x2112, 1));
  const auto found_Pu_s = static_cast<double>(bench.read<float>(0x2113, 1));
  // The describing function neglects the harmonics that three lags let through, and the hysteresis delays.
  CHECK(found_Ku == Approx(Ku).epsilon(0.15));
  CHECK(found_Pu_s == Approx(Pu_s).epsilon(0.10));
  CHECK(bench.read<std::int16_t>(0x7450, 1) == Approx(1000 / (0.45 * found_Ku)).margin(1));
  double highest_degC = 0;
  for (int k = 0; k < 60; ++k) {
    bench.run(160, 0x01, 10s);
    highest_degC = std::max(highest_degC, bench.process.barrel->T_degC(0));
  }
  CHECK(highest_degC < 163.0);
  CHECK(bench.process.barrel->T_degC(0) == Approx(160.0).margin(0.1));
}

TEST_CASE("Heater: autotune without oscillation gives up and says so", "[board][heater][autotune]") {
  board::RelayTuner tuner;
  tuner.start(0.0, 100.0, 0.5);
  for (int k = 0; k <= 72010 && tuner.state() == board::RelayTuner::State::kRunning; ++k) {
    static_cast<void>(tuner.step(0.1 * k, 20.0));
  }
  CHECK(tuner.state() == board::RelayTuner::State::kFailed);
  CHECK(tuner.step(8000.0, 20.0) == 0.0);
}

TEST_CASE("Heater: started warm it holds what is there before anybody speaks to it", "[board][heater]") {
  board::HeaterSettings settings = make_settings();
  settings.warm_start = true;
  plant::Barrel barrel{plant::BarrelParameters::with_zones(4), 25.0};
  barrel.start_at(std::array{140.0, 145.0, 145.0, 145.0, 150.0}, std::array{0.0, 0.0, 0.0, 0.0, 0.0});
  for (std::size_t i = 0; i < 5; ++i) {
    settings.start[i] = {barrel.T_degC(i), barrel.heater_W(i) / barrel.parameters().zones[i].max_power_W};
  }
  board::BoardBench<board::Heater> bench{"heater", settings};
  bench.process.barrel = barrel;
  bench.start();
  bench.run_to(Instant{60s});
  for (std::size_t i = 0; i < 5; ++i) {
    CHECK(bench.process.barrel->T_degC(i) == Approx(barrel.T_degC(i)).margin(0.3));
  }
}
