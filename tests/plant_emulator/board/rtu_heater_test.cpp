#include "plant_emulator/board/rtu_heater.hpp"

#include <catch2/catch.hpp>

#include "tests/plant_emulator/board/rtu_bench.hpp"

using namespace meltbench;
using board::RtuHeater;
using modbus::Function;
namespace reg = board::zone_register;
namespace coil = board::zone_coil;

namespace {

constexpr std::uint8_t kZone1 = 1, kNozzle = 5;

board::HeaterSettings make_settings() {
  board::HeaterSettings settings;
  settings.watchdog_ms = 0;
  settings.proportional = true;
  return settings;
}

/// Heated by a barrel of the default extruder, 20 °C at the start.
struct HeaterBench : board::RtuBench<RtuHeater> {
  explicit HeaterBench(const board::HeaterSettings& settings = make_settings()) : RtuBench{settings} {}
  int set(std::uint16_t at, std::uint16_t value, std::uint8_t unit = kZone1) {
    return order(modbus::make_write_register(at, value), unit);
  }
  void heat(std::uint8_t unit) {
    REQUIRE(set(reg::kSetPoint, 1000, unit) == 0);
    REQUIRE(set(reg::kRun, 1, unit) == 0);
    run_to(now + 200ms);  // Two cycles of the controllers.
  }
  double share(std::size_t channel) const { return process.heater_share[channel]; }
};

struct WarmBarrel : HeaterBench {
  explicit WarmBarrel(const board::HeaterSettings& settings = make_settings()) : HeaterBench{settings} {
    process.barrel.emplace(plant::BarrelParameters::with_zones(4), 25.0);
    run_to(Instant{60s});  // It came after power-up: the derivative has to forget that.
  }
};

}  // namespace

TEST_CASE("RTU heater: each zone is a unit of its own, temperatures in tenths, output per mille", "[board][modbus]") {
  WarmBarrel bench;
  const double T_degC = bench.process.T_zone_degC(0);
  CHECK(bench.read(reg::kTemperature) == Approx(10 * T_degC).margin(0.7));  // Its own step of 0.02 K, and rounding.
  CHECK(bench.read(reg::kOutput) == 0);
  bench.heat(kZone1);
  CHECK(bench.read(reg::kSetPoint) == 1000);
  CHECK(bench.read(reg::kOutput) == 1000);
  CHECK(bench.share(0) == 1.0);
  CHECK(bench.share(4) == 0.0);
  bench.heat(kNozzle);
  CHECK(bench.share(4) == 1.0);
  CHECK((bench.read(reg::kState, kNozzle) & board::kZoneOn) != 0);
}

TEST_CASE("RTU heater: without requests a zone stops heating, the others go on", "[board][modbus]") {
  board::HeaterSettings settings = make_settings();
  settings.watchdog_ms = 500;
  WarmBarrel bench{settings};
  bench.heat(kZone1);
  bench.heat(kNozzle);
  for (int i = 0; i < 10; ++i) {
    CHECK(bench.read(reg::kSetPoint, kNozzle) == 1000);
    bench.run_to(bench.now + 100ms);
  }
  CHECK(bench.share(0) == 0.0);
  CHECK(bench.share(4) == 1.0);
  const auto events = bench.board.take_events();
  REQUIRE(events.size() == 1);
  CHECK(events[0].code == "master-lost");
  CHECK(bench.read(reg::kRun) == 1);  // Polled again: it heats on.
  bench.run_to(bench.now + 200ms);
  CHECK(bench.share(0) == 1.0);
}

TEST_CASE("RTU heater: one that heats from its start and is never asked stops, too", "[board][modbus]") {
  board::HeaterSettings settings = make_settings();
  settings.watchdog_ms = 500;
  settings.warm_start = true;
  HeaterBench bench{settings};
  CHECK(bench.process.heater_supply);
  bench.run_to(Instant{499ms});
  CHECK(bench.process.heater_supply);
  bench.run_to(Instant{500ms});
  CHECK_FALSE(bench.process.heater_supply);
}

TEST_CASE("RTU heater: an open thermocouple is an alarm until it is acknowledged", "[board][modbus]") {
  WarmBarrel bench;
  bench.heat(kZone1);
  bench.process.thermocouple_is_open[0] = true;
  bench.run_to(bench.now + 200ms);
  CHECK(bench.share(0) == 0.0);
  CHECK(bench.read(reg::kSensor) == 3);
  CHECK((bench.read(reg::kState) & board::kZoneSensorOpen) != 0);
  bench.process.thermocouple_is_open[0] = false;
  bench.run_to(bench.now + 200ms);
  CHECK(bench.share(0) == 0.0);
  REQUIRE(bench.order(modbus::make_write_coil(coil::kAcknowledge, true)) == 0);
  bench.run_to(bench.now + 200ms);
  CHECK(bench.share(0) == 1.0);
}

TEST_CASE("RTU heater: refuses what a temperature controller refuses", "[board][modbus]") {
  WarmBarrel bench;
  CHECK(bench.order(modbus::make_read(Function::kReadInputRegisters, 0, 1)) == 1);
  CHECK(bench.order(modbus::make_read(Function::kReadDiscreteInputs, 0, 1)) == 1);
  CHECK(bench.order(modbus::make_read(Function::kReadHoldingRegisters, 0, 14)) == 2);
  CHECK(bench.set(reg::kTemperature, 1) == 2);
  CHECK(bench.set(reg::kAutotune, 1) == 2);
  CHECK(bench.set(reg::kSetPoint, 4001) == 3);
  CHECK(bench.set(reg::kBand, 0) == 3);
  CHECK(bench.set(reg::kRun, 2) == 3);
  CHECK(bench.order(modbus::make_write_coil(coil::kAutotune, true)) == 4);  // It does not heat.
  CHECK(bench.ask(modbus::make_read(Function::kReadHoldingRegisters, 0, 1), 6).empty());
}

TEST_CASE("RTU heater: a broadcast sets all zones", "[board][modbus]") {
  WarmBarrel bench;
  CHECK(bench.ask(modbus::make_write_register(reg::kSetPoint, 1500), modbus::kBroadcast).empty());
  for (std::uint8_t unit = 1; unit <= 5; ++unit) CHECK(bench.read(reg::kSetPoint, unit) == 1500);
}

TEST_CASE("RTU heater: holds its zones as the one on CAN does", "[board][modbus]") {
  WarmBarrel bench;
  for (std::uint8_t unit = 1; unit <= 5; ++unit) bench.heat(unit);
  bench.run_to(Instant{1200s});
  for (std::uint8_t unit = 1; unit <= 5; ++unit) {
    CHECK(bench.read(reg::kTemperature, unit) == Approx(1000).margin(10));  // 1 K.
    CHECK((bench.read(reg::kState, unit) & board::kZoneWarm) != 0);
  }
}

TEST_CASE("RTU heater: its contactor is closed only while a zone may heat, and open when one is too hot",
          "[board][modbus]") {
  board::HeaterSettings settings = make_settings();
  settings.watchdog_ms = 500;
  WarmBarrel bench{settings};
  CHECK_FALSE(bench.process.heater_supply);
  bench.heat(kZone1);
  CHECK(bench.process.heater_supply);
  bench.run_to(bench.now + 1s);  // Nobody asks any more.
  CHECK_FALSE(bench.process.heater_supply);
  bench.heat(kNozzle);
  CHECK(bench.process.heater_supply);
  CHECK(bench.set(reg::kHighAlarm, 100, kNozzle) == 0);  // 10 degC: it is hotter.
  bench.run_to(bench.now + 200ms);
  CHECK_FALSE(bench.process.heater_supply);
}

TEST_CASE("RTU heater: powered up again it has forgotten what was written, does not heat, and says so",
          "[board][modbus]") {
  board::HeaterSettings settings = make_settings();
  settings.warm_start = true;
  HeaterBench bench{settings};
  CHECK(bench.read(reg::kRun) == 1);  // It begins in control of warm zones.
  CHECK((bench.read(reg::kState) & board::kZoneConfigured) == 0);
  CHECK(bench.set(reg::kHighAlarm, 2000) == 0);
  CHECK((bench.read(reg::kState) & board::kZoneConfigured) != 0);
  bench.board.start(bench.now);
  CHECK(bench.read(reg::kRun) == 0);
  CHECK(bench.read(reg::kHighAlarm) == 3000);
  CHECK((bench.read(reg::kState) & board::kZoneConfigured) == 0);
  CHECK_FALSE(bench.process.heater_supply);
}
