#include "plant_emulator/board/rtu_feeder.hpp"

#include <catch2/catch.hpp>
#include <limits>

#include "tests/plant_emulator/board/rtu_bench.hpp"

using namespace meltbench;
using board::RtuFeeder;
using modbus::Function;
namespace reg = board::feeder_register;
namespace coil = board::feeder_coil;

namespace {

constexpr std::uint16_t kReport = reg::kReport;

board::FeederSettings make_settings() {
  board::FeederSettings settings;
  settings.max_flow_kg_per_h = 20;
  settings.loss_of_master_kg_per_h = 3.5;
  settings.start_flow_kg_per_h = 2.5;
  settings.watchdog_ms = 200;
  settings.hopper_kg = 10;
  settings.refill_high_kg = 10;
  return settings;
}

/// 3.6 kg/h = 1 g/s; refilled with 100 g/s between 1 kg and 2 kg; 4 % more from a full hopper.
board::FeederSettings make_refilled() {
  board::FeederSettings settings = make_settings();
  settings.start_flow_kg_per_h = 3.6;
  settings.watchdog_ms = 0;
  settings.hopper_kg = 1.005;
  settings.refill_low_kg = 1;
  settings.refill_high_kg = 2;
  settings.refill_kg_per_h = 363.6;
  settings.refill_settle = 2s;
  settings.fill_effect = 0.04;
  return settings;
}

struct FeederBench : board::RtuBench<RtuFeeder> {
  explicit FeederBench(const board::FeederSettings& settings = make_settings()) : RtuBench{settings} {}
  double last_feed_kg_per_h() const { return process.feeds_kg_per_s.back().second * 3600; }
  float reported(std::uint16_t at) { return read_float(static_cast<std::uint16_t>(kReport + at)); }
  unsigned status() { return read(kReport + reg::kStatus); }
  std::vector<std::string> events() {
    std::vector<std::string> codes;
    for (const Event& event : board.take_events()) codes.push_back(event.code);
    return codes;
  }
};

}  // namespace

TEST_CASE("RTU feeder: a set point is delivered one latency after the next control cycle, and dated",
          "[board][modbus]") {
  FeederBench bench;
  bench.run_to(Instant{50ms});
  REQUIRE(bench.write(reg::kSetPoint, 4.0F) == 0);  // The answer takes 10 ms here.
  CHECK(bench.last_feed_kg_per_h() == Approx(4));
  const auto [changed_at, feed] = bench.process.feeds_kg_per_s.back();
  CHECK(changed_at >= Instant{52ms});  // Latency 2 ms, control cycle 1 ms.
  CHECK(changed_at < Instant{53ms});
  const Nanos age = bench.read(kReport + reg::kFlowAge) * 10us;
  CHECK(to_s(age) == Approx(to_s(Instant{60ms} - changed_at)).margin(5e-6));  // Whole 10 us.
  CHECK(bench.reported(reg::kFlow) == 4.0F);
  CHECK(bench.status() == board::kDelivering);
}

TEST_CASE("RTU feeder: one request writes the set point and reads the report", "[board][modbus]") {
  FeederBench bench;
  const auto answer = bench.ask(modbus::make_read_write(kReport, reg::kReportSize, reg::kSetPoint,
                                                        modbus::to_words(5.0F, modbus::WordOrder::kHighFirst)));
  std::array<std::uint16_t, reg::kReportSize> words{};
  REQUIRE(modbus::read_registers(answer, words));
  const auto value = [&](std::uint16_t at) {
    return modbus::to_float(std::span{words}.subspan(at, 2), modbus::WordOrder::kHighFirst);
  };
  CHECK(value(reg::kSetPointInForce) == 5.0F);  // Written before it was read,
  CHECK(value(reg::kFlow) == 2.5F);             // but not delivered yet.
  CHECK(value(reg::kMaxFlow) == 20.0F);
  CHECK(modbus::to_u32(std::span{words}.subspan(reg::kLatency, 2), modbus::WordOrder::kHighFirst) == 2000);
  CHECK(modbus::to_u32(std::span{words}.subspan(reg::kControlCycle, 2), modbus::WordOrder::kHighFirst) == 1000);
  const auto same = bench.ask(modbus::make_read(Function::kReadInputRegisters, 0, reg::kReportSize));
  CHECK(same.size() == answer.size());
}

TEST_CASE("RTU feeder: when nobody polls, the flow falls to its safe value, and comes back with the next set point",
          "[board][modbus]") {
  FeederBench bench;
  REQUIRE(bench.write(reg::kSetPoint, 10.0F) == 0);
  bench.run_to(Instant{199ms});
  CHECK(bench.board.flow_kg_per_h() == 10.0);
  bench.run_to(Instant{205ms});
  CHECK(bench.board.flow_kg_per_h() == 3.5);
  CHECK((bench.status() & board::kMasterLost) != 0);
  CHECK(bench.read(kReport + reg::kAlarms) == board::kMasterLost);
  CHECK(bench.events() == std::vector<std::string>{"master-lost"});
  REQUIRE(bench.write(reg::kSetPoint, 10.0F) == 0);
  CHECK(bench.board.flow_kg_per_h() == 10.0);
  CHECK((bench.status() & board::kMasterLost) == 0);
  CHECK(bench.events() == std::vector<std::string>{"master-back"});
}

TEST_CASE("RTU feeder: reading alone does not feed the watchdog", "[board][modbus]") {
  FeederBench bench;
  REQUIRE(bench.write(reg::kSetPoint, 10.0F) == 0);
  for (int i = 0; i < 30; ++i) static_cast<void>(bench.status());  // 10 ms each.
  CHECK(bench.board.flow_kg_per_h() == 3.5);
}

TEST_CASE("RTU feeder: refuses what cannot be, and does nothing of it", "[board][modbus]") {
  constexpr float kNaN = std::numeric_limits<float>::quiet_NaN();
  FeederBench bench;
  CHECK(bench.write(reg::kSetPoint, kNaN) == 3);
  CHECK((bench.status() & board::kNotANumber) != 0);
  CHECK(bench.write(reg::kMode, std::uint16_t{2}) == 3);
  CHECK(bench.write(reg::kWordOrder, std::uint16_t{2}) == 3);
  CHECK(bench.write(reg::kLossOfMaster, 21.0F) == 3);
  CHECK(bench.write(reg::kRefillLow, -1.0F) == 3);
  CHECK(bench.write(reg::kRefillLow, 11.0F) == 3);                 // Above the high limit.
  CHECK(bench.write(reg::kSetPoint, std::uint16_t{0x4080}) == 2);  // Half a number.
  CHECK(bench.write(reg::kSetPoint + 1, 1.0F) == 2);
  CHECK(bench.write(kReport, 1.0F) == 2);  // Read only.
  CHECK(bench.order(modbus::make_read(Function::kReadHoldingRegisters, 10, 2)) == 2);
  CHECK(bench.order(modbus::make_read(Function::kReadInputRegisters, 25, 2)) == 2);
  CHECK(bench.order(modbus::make_read(Function::kReadCoils, 0, 6)) == 2);
  CHECK(bench.order(modbus::make_read(Function::kReadDiscreteInputs, 8, 1)) == 2);
  CHECK(bench.order(modbus::make_write_coil(coil::kRefill, true)) == 4);  // No refill is fitted.
  CHECK(bench.order(modbus::Pdu{0x11}) == 1);
  CHECK(bench.board.flow_kg_per_h() == 2.5);
  CHECK(bench.read_float(reg::kLossOfMaster) == 3.5F);
}

TEST_CASE("RTU feeder: the word order can be changed, for reading and for writing", "[board][modbus]") {
  constexpr auto kLow = modbus::WordOrder::kLowFirst;
  FeederBench bench;
  REQUIRE(bench.write(reg::kWordOrder, std::uint16_t{1}) == 0);
  REQUIRE(bench.write(reg::kSetPoint, 6.25F, kLow) == 0);
  CHECK(bench.board.flow_kg_per_h() == 6.25);
  CHECK(bench.read_float(kReport + reg::kFlow, kLow) == 6.25F);
  board::FeederSettings settings = make_settings();
  settings.low_word_first = true;
  FeederBench other{settings};
  CHECK(other.read(reg::kWordOrder) == 1);
  CHECK(other.read_float(kReport + reg::kFlow, kLow) == 2.5F);
}

TEST_CASE("RTU feeder: stops and runs by its coil, with the set point that it has", "[board][modbus]") {
  FeederBench bench;
  REQUIRE(bench.write(reg::kWatchdog, std::uint16_t{0}) == 0);
  REQUIRE(bench.write(reg::kSetPoint, 8.0F) == 0);
  REQUIRE(bench.order(modbus::make_write_coil(coil::kRun, false)) == 0);
  CHECK(bench.board.flow_kg_per_h() == 0);
  REQUIRE(bench.write(reg::kSetPoint, 9.0F) == 0);
  CHECK(bench.board.flow_kg_per_h() == 0);
  REQUIRE(bench.order(modbus::make_write_coil(coil::kRun, true)) == 0);
  CHECK(bench.board.flow_kg_per_h() == 9.0);
}

TEST_CASE("RTU feeder: totalizer and tare are set to zero by their coils", "[board][modbus]") {
  FeederBench bench;
  bench.run_to(Instant{100s});
  CHECK(bench.reported(reg::kTotalizer) == Approx(2.5 / 36).epsilon(1e-4));
  CHECK(bench.reported(reg::kNetWeight) == Approx(10 - 2.5 / 36).margin(2e-4));  // A step and a sample of the scale.
  REQUIRE(bench.order(modbus::make_write_coils(coil::kClearTotalizer, std::array{true, true})) == 0);
  CHECK(bench.reported(reg::kTotalizer) == Approx(0).margin(2e-5));
  CHECK(bench.reported(reg::kNetWeight) == Approx(0).margin(2e-4));
  CHECK(bench.ask(modbus::make_read(Function::kReadCoils, 0, coil::kCount)) == std::vector<std::uint8_t>{1, 1, 1});
}

TEST_CASE("RTU feeder: says who it is", "[board][modbus]") {
  FeederBench bench;
  const auto answer = bench.ask(modbus::make_read_identification(2, 0));
  CHECK(modbus::find_identification(answer, 0) == "Meltbench");
  CHECK(modbus::find_identification(answer, 1) == "LIW-1");
}

TEST_CASE("Feeder: the refill valve opens at the low limit and closes at the high one", "[board][modbus]") {
  FeederBench bench{make_refilled()};
  bench.run_to(Instant{4990ms});
  CHECK((bench.status() & (board::kRefilling | board::kVolumetric)) == 0);
  bench.run_to(Instant{5010ms});  // 5 g at 1 g/s.
  CHECK((bench.status() & board::kRefilling) != 0);
  CHECK(bench.read(kReport + reg::kActingMode) == 2);
  CHECK(bench.order(modbus::make_write_coil(coil::kTare, true)) == 6);  // Nobody can weigh now.
  bench.run_to(Instant{14'900ms});                                      // 1 kg at 100 g/s net, or 99.96 g/s at its end.
  CHECK((bench.status() & board::kRefilling) != 0);
  bench.run_to(Instant{15'050ms});
  CHECK((bench.status() & board::kRefilling) == 0);
  CHECK(bench.reported(reg::kNetWeight) == Approx(2.0).margin(0.005));  // Closes at a sample of the scale.
  CHECK(bench.events() == std::vector<std::string>{"refill-begins", "refill-ends"});
}

TEST_CASE("Feeder: while it is refilled it feeds by drive command, off by what a fuller hopper adds",
          "[board][modbus]") {
  FeederBench bench{make_refilled()};
  bench.run_to(Instant{10s});  // Half full.
  CHECK(bench.last_feed_kg_per_h() == Approx(3.6 * 1.02).epsilon(1e-3));
  CHECK(bench.reported(reg::kFlow) == 3.6F);  // It cannot know.
  CHECK(bench.reported(reg::kDriveCommand) == Approx(18));
  CHECK(bench.reported(reg::kFeedFactor) == 20.0F);
  bench.run_to(Instant{16s});  // Full, and the scale not yet calm.
  CHECK(bench.read(kReport + reg::kActingMode) == 1);
  CHECK(bench.last_feed_kg_per_h() == Approx(3.6 * 1.04).epsilon(1e-3));
  bench.run_to(Instant{17'100ms});
  CHECK(bench.read(kReport + reg::kActingMode) == 0);
  CHECK(bench.last_feed_kg_per_h() == Approx(3.6).epsilon(1e-6));
  CHECK(bench.reported(reg::kFeedFactor) == Approx(20.8).epsilon(1e-3));
  CHECK(bench.reported(reg::kDriveCommand) == Approx(18 / 1.04).epsilon(1e-3));
}

TEST_CASE("Feeder: what leaves the hopper and what is refilled add up to its weight", "[board][modbus]") {
  FeederBench bench{make_refilled()};
  double delivered_kg = 0;
  bench.run_to(Instant{40s});
  const auto& feeds = bench.process.feeds_kg_per_s;
  for (std::size_t i = 0; i < feeds.size(); ++i) {
    const Instant until = i + 1 < feeds.size() ? feeds[i + 1].first : bench.now;
    delivered_kg += feeds[i].second * to_s(until - feeds[i].first);
  }
  // The valve closes with the first sample of the scale, 20 ms, at which the hopper is full.
  const double refilled_kg = bench.reported(reg::kNetWeight) + delivered_kg - 1.005;
  CHECK(refilled_kg / 0.101 == Approx(10.01).margin(0.03));
  CHECK(bench.reported(reg::kTotalizer) == Approx(delivered_kg).epsilon(0.04));  // By set point while volumetric.
}

TEST_CASE("Feeder: a refill can be asked for, and is refused by a full hopper", "[board][modbus]") {
  board::FeederSettings settings = make_refilled();
  settings.hopper_kg = 1.5;
  FeederBench bench{settings};
  REQUIRE(bench.order(modbus::make_write_coil(coil::kRefill, true)) == 0);
  CHECK(bench.ask(modbus::make_read(Function::kReadCoils, coil::kRefill, 1)) == std::vector<std::uint8_t>{1, 1, 1});
  bench.run_to(Instant{5100ms});
  CHECK(bench.ask(modbus::make_read(Function::kReadDiscreteInputs, 5, 1)) == std::vector<std::uint8_t>{2, 1, 0});
  settings.hopper_kg = 2;
  FeederBench full{settings};
  CHECK(full.order(modbus::make_write_coil(coil::kRefill, true)) == 4);
}

TEST_CASE("Feeder: told to be volumetric it holds its drive command", "[board][modbus]") {
  board::FeederSettings settings = make_refilled();
  settings.hopper_kg = 2;
  FeederBench bench{settings};
  REQUIRE(bench.write(reg::kMode, std::uint16_t{1}) == 0);
  bench.run_to(Instant{500s});  // From 2 kg to 1.5 kg.
  CHECK(bench.read(kReport + reg::kActingMode) == 1);
  CHECK(bench.last_feed_kg_per_h() == Approx(3.6 * 1.02 / 1.04).epsilon(1e-3));
  REQUIRE(bench.order(modbus::make_write_coil(coil::kVolumetricMode, false)) == 0);
  CHECK(bench.last_feed_kg_per_h() == Approx(3.6).epsilon(1e-6));
}

TEST_CASE("RTU feeder: powered up again it has forgotten what was written, and says so", "[board][modbus]") {
  FeederBench bench;
  CHECK((bench.status() & board::kFeederConfigured) == 0);
  CHECK(bench.write(reg::kLossOfMaster, 1.5F) == 0);
  CHECK(bench.write(reg::kWatchdog, std::uint16_t{400}) == 0);
  CHECK((bench.status() & board::kFeederConfigured) != 0);
  bench.board.start(bench.now);
  CHECK((bench.status() & board::kFeederConfigured) == 0);
  CHECK(bench.read_float(reg::kLossOfMaster) == 3.5F);
  CHECK(bench.read(reg::kWatchdog) == 200);
}
