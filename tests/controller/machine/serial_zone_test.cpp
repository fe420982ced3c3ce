#include "controller/machine/serial_zone.hpp"

#include <array>
#include <catch2/catch.hpp>

#include "protocols/modbus/pdu.hpp"
#include "tests/controller/machine/fake_rig.hpp"

using namespace meltbench;
using namespace meltbench::machine;
using modbus::ClientResult;

namespace {

ControllerSettings make_line_settings() {
  ControllerSettings settings = testing::make_coupled_settings();
  for (BoardSettings& board : settings.boards) {
    if (board.kind != config::BoardKind::kHeater) continue;
    board.line = "zones";
    board.unit = 11;
  }
  settings.lines = {{"zones", {}}};
  return settings;
}

/// A zone controller with 13 registers, asked directly.
struct Desk {
  ControllerSettings settings = make_line_settings();
  SerialZone zone{settings, 2};
  std::array<std::uint16_t, 13> registers{0, 250, 300};
  bool answers = true;
  Instant now{};
  int requests = 0;

  void run_to(Instant end) {
    for (; zone.next_request_at() <= end; answer()) now = std::max(now, zone.next_request_at());
    now = end;
  }
  void answer() {
    const modbus::Pdu request = zone.make_request(now);
    ++requests;
    ClientResult result;
    result.request_end = now;
    result.at = now + 20ms;
    now += 20ms;
    if (!answers) return zone.on_result(now, result);
    const modbus::Pdu answer = respond(request.bytes());
    result.outcome = ClientResult::Outcome::kAnswer;
    result.answer = answer.bytes();
    zone.on_result(now, result);
  }
  modbus::Pdu respond(std::span<const std::uint8_t> request) {
    if (request[0] == 43) return {43, 14, 1, 0x82, 0, 0, 1, 1, 4, 'T', 'C', '-', '1'};
    const std::uint16_t at = modbus::load_word(request, 1);
    if (request[0] == 6) {
      registers.at(at) = modbus::load_word(request, 3);
      if (at == zone_register::kHighAlarm) registers[zone_register::kState] = zone_register::kConfigured;
      return modbus::make_write_register(at, registers.at(at));
    }
    modbus::Pdu words{3, static_cast<std::uint8_t>(2 * modbus::load_word(request, 3))};
    for (unsigned i = 0; i < modbus::load_word(request, 3); ++i) words.push_word(registers.at(at + i));
    return words;
  }
};

}  // namespace

TEST_CASE("Serial zone: is the unit of its channel, told its high alarm, then reported", "[machine]") {
  Desk desk;
  CHECK(desk.zone.unit() == 12);
  desk.run_to(Instant{1s});
  CHECK(desk.zone.is_configured());
  CHECK(desk.registers[10] == 1850);
  CHECK(desk.registers[0] == 0);  // Nobody has said what it is to do.
  const auto report = desk.zone.take_report();
  REQUIRE(report);
  CHECK(report->zone.T_degC == Approx(25.0));
  CHECK(report->zone.output == Approx(0.3));
  CHECK(report->zone.sensor_good);
  CHECK_FALSE(desk.zone.take_report());
}

TEST_CASE("Serial zone: set point and release are written once, and again if it has forgotten them", "[machine]") {
  Desk desk;
  desk.zone.want(desk.now, 145.0, true);
  desk.run_to(Instant{1s});
  CHECK(desk.registers[0] == 1450);
  CHECK(desk.registers[5] == 1);
  const int before = desk.requests;
  desk.run_to(Instant{3s});
  CHECK(desk.requests - before == 10);  // Polls, every 200 ms.
  desk.registers = {0, 250, 0};         // It has lost power.
  desk.run_to(Instant{3500ms});
  CHECK(desk.registers[0] == 1450);
  CHECK(desk.registers[5] == 1);
}

TEST_CASE("Serial zone: is not told again what it has just been told, though it waits for the line", "[machine]") {
  Desk desk;
  desk.run_to(Instant{1s});
  desk.zone.want(desk.now, 145.0, true);
  desk.answer();
  CHECK(desk.registers[0] == 1450);
  desk.zone.want(desk.now, 145.0, true);
  desk.answer();
  CHECK(desk.registers[5] == 1);
  desk.zone.want(desk.now, 145.0, true);
  static_cast<void>(desk.zone.take_report());
  desk.answer();
  CHECK(desk.zone.take_report());
}

TEST_CASE("Serial zone: is switched off without waiting for the next poll", "[machine]") {
  Desk desk;
  desk.zone.want(desk.now, 145.0, true);
  desk.run_to(Instant{1s});
  desk.zone.want(desk.now, 100.0, false);
  CHECK(desk.zone.next_request_at() == desk.now);
  desk.answer();
  CHECK(desk.registers[5] == 0);  // Before the set point.
  desk.run_to(desk.now + 100ms);
  CHECK(desk.registers[0] == 1000);
}

TEST_CASE("Serial zone: an open thermocouple is reported", "[machine]") {
  Desk desk;
  desk.registers[4] = 3;
  desk.run_to(Instant{1s});
  CHECK_FALSE(desk.zone.take_report()->zone.sensor_good);
}

TEST_CASE("Serial zone: silence is told once, and its end", "[machine]") {
  Desk desk;
  desk.run_to(Instant{1s});
  desk.answers = false;
  desk.run_to(Instant{2s});
  CHECK(desk.zone.take_trouble()->code == "device-lost");
  CHECK_FALSE(desk.zone.take_trouble());
  desk.registers[10] = 0;
  desk.answers = true;
  desk.run_to(Instant{3s});
  CHECK(desk.zone.take_news());
  CHECK(desk.registers[10] == 1850);
}

TEST_CASE("Serial zone: one that was reset between two polls is told, and configured anew", "[machine]") {
  Desk desk;
  desk.run_to(Instant{1s});
  desk.registers = {0, 250, 300};
  desk.run_to(Instant{2s});
  const auto trouble = desk.zone.take_trouble();
  REQUIRE(trouble);
  CHECK(trouble->code == "device-reset");
  CHECK(desk.registers[10] == 1850);
  CHECK_FALSE(desk.zone.take_trouble());
}
