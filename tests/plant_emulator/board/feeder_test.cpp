#include "plant_emulator/board/feeder.hpp"

#include <catch2/catch.hpp>
#include <limits>

#include "tests/plant_emulator/board/board_bench.hpp"

using namespace meltbench;
using board::Feeder;
using board::field;
using board::kNode;

namespace {

constexpr std::uint32_t kSetPointId = 0x200 + kNode, kFlowId = 0x180 + kNode, kEmcyId = 0x080 + kNode;

board::FeederSettings make_settings() {
  board::FeederSettings settings;
  settings.sample_time = 1ms;
  settings.latency = 2ms;
  settings.max_flow_kg_per_h = 20;
  settings.loss_of_master_kg_per_h = 3.5;
  settings.start_flow_kg_per_h = 2.5;
  return settings;
}

can::CanFrame set_point(float kg_per_h) {
  can::CanFrame frame = can::make_frame(kSetPointId, {0, 0, 0, 0});
  canopen::store(std::span{frame.bytes}, 0, kg_per_h);
  return frame;
}

struct Report {
  float flow_kg_per_h;
  Nanos age;
  unsigned status, changes;
};

struct FeederBench : board::BoardBench<Feeder> {
  explicit FeederBench(const board::FeederSettings& settings = make_settings()) : BoardBench{"feeder", settings} {
    start_operational();
  }
  Report report() {
    sync();
    const can::CanFrame frame = last(kFlowId).value();
    REQUIRE(frame.length == 8);
    return {field<float>(frame, 0), field<std::uint16_t>(frame, 4) * 10us, frame.bytes[6], frame.bytes[7]};
  }
  std::pair<Instant, double> last_feed() const { return process.feeds_kg_per_s.back(); }
  /// A master that keeps the set point alive every 10 ms.
  void keep(float kg_per_h, Instant until) {
    for (; now < until; run_to(now + 10ms)) send(set_point(kg_per_h));
  }
};

}  // namespace

TEST_CASE("Feeder: delivers the start flow until the first set point", "[board][feeder]") {
  FeederBench bench;
  bench.run_to(Instant{5s});
  CHECK(bench.process.feeds_kg_per_s.front().second == Approx(2.5 / 3600).epsilon(1e-12));
  const Report report = bench.report();
  CHECK(report.flow_kg_per_h == 2.5F);
  CHECK(report.age == 0xFFFF * 10us);  // Older than can be told.
  CHECK(report.status == board::kDelivering);
  CHECK(bench.count(kEmcyId) == 0);  // Its watchdog waits for the first set point.
}

TEST_CASE("Feeder: a set point changes the flow one latency after the next control cycle, and the report dates it",
          "[board][feeder]") {
  FeederBench bench;
  bench.run_to(Instant{100ms});
  bench.send(set_point(4.0F));
  bench.run_to(Instant{110ms});
  const auto [changed_at, feed] = bench.last_feed();
  CHECK(feed == Approx(4.0 / 3600).epsilon(1e-12));
  CHECK(changed_at >= Instant{102ms});
  CHECK(changed_at < Instant{103ms});
  const Report report = bench.report();
  CHECK(report.flow_kg_per_h == 4.0F);
  CHECK(report.age == bench.now - changed_at);  // To the unit: phases and latency are multiples of 10 us.
}

TEST_CASE("Feeder: without cycle and latency a set point acts at the instant of its arrival", "[board][feeder]") {
  board::FeederSettings settings = make_settings();
  settings.sample_time = settings.latency = 0ns;
  FeederBench bench{settings};
  bench.run_to(Instant{12'345'678ns});
  bench.send(set_point(4.0F));
  CHECK(bench.last_feed().first == Instant{12'345'678ns});
}

TEST_CASE("Feeder: the report counts the changes that fell between two SYNCs", "[board][feeder]") {
  FeederBench bench;
  const unsigned before = bench.report().changes;
  bench.send(set_point(4.0F));
  bench.run_to(bench.now + 4ms);
  bench.send(set_point(5.0F));
  bench.run_to(bench.now + 4ms);
  bench.send(set_point(5.0F));  // Not a change.
  bench.run_to(bench.now + 4ms);
  CHECK(((bench.report().changes - before) & 0xFFU) == 2);
}

TEST_CASE("Feeder: of two set points in one control cycle the later one counts", "[board][feeder]") {
  board::FeederSettings settings = make_settings();
  settings.sample_time = 100ms;
  settings.watchdog_ms = 0;
  FeederBench bench{settings};
  bench.run_to(Instant{250ms});
  bench.send(set_point(4.0F));
  bench.send(set_point(5.0F));
  bench.run_to(Instant{400ms});
  CHECK(bench.process.feeds_kg_per_s.size() == 2);  // Power-up, and one change.
  CHECK(bench.board.flow_kg_per_h() == Approx(5.0));
}

TEST_CASE("Feeder: what it reports is to the last bit what the screw gets", "[board][feeder]") {
  board::FeederSettings settings = make_settings();
  settings.flow_resolution_kg_per_h = 0.3;
  FeederBench bench{settings};
  bench.keep(4.0F, Instant{20ms});
  const Report report = bench.report();
  CHECK(report.flow_kg_per_h == Approx(3.9F).epsilon(1e-7));  // 13 steps of 0.3.
  CHECK(bench.last_feed().second == static_cast<double>(report.flow_kg_per_h) / 3600);
}

TEST_CASE("Feeder: a set point outside its range is cut, and the status says so", "[board][feeder]") {
  FeederBench bench;
  bench.keep(25.0F, Instant{20ms});
  CHECK(bench.report().flow_kg_per_h == 20.0F);
  CHECK((bench.report().status & board::kSetPointCut) != 0);
  bench.keep(-1.0F, bench.now + 20ms);
  CHECK(bench.report().flow_kg_per_h == 0.0F);
  CHECK((bench.report().status & board::kSetPointCut) != 0);
  bench.keep(4.0F, bench.now + 20ms);
  CHECK((bench.report().status & board::kSetPointCut) == 0);
}

TEST_CASE("Feeder: a set point that is not a number is refused and does not feed the watchdog", "[board][feeder]") {
  constexpr float kNaN = std::numeric_limits<float>::quiet_NaN();
  FeederBench bench;
  CHECK(bench.write(0x2000, 0, kNaN) == 0x0609'0030);
  bench.keep(4.0F, Instant{20ms});
  bench.keep(kNaN, bench.now + 30ms);
  CHECK(bench.report().flow_kg_per_h == 4.0F);
  CHECK((bench.report().status & board::kNotANumber) != 0);
  bench.keep(kNaN, bench.now + 100ms);
  CHECK(bench.count(kEmcyId) == 1);
  CHECK(bench.report().flow_kg_per_h == 3.5F);
}

TEST_CASE("Feeder: when set points stop, the flow falls to its safe value after the watchdog time, with an EMCY",
          "[board][feeder]") {
  FeederBench bench;
  bench.keep(10.0F, Instant{100ms});  // Last one at 90 ms.
  bench.run_to(Instant{139ms});
  CHECK(bench.count(kEmcyId) == 0);
  bench.run_to(Instant{140ms});
  const can::CanFrame emcy = bench.last(kEmcyId).value();
  CHECK(emcy.bytes[0] == 0x01);
  CHECK(emcy.bytes[1] == 0xFF);
  CHECK(emcy.bytes[2] == 0x81);
  CHECK(bench.read<std::uint8_t>(0x1001) == 0x81);
  CHECK((bench.read<std::uint32_t>(0x1003, 1) & 0xFFFFU) == Feeder::kEmcySetPointsLost);
  bench.run_to(Instant{150ms});
  CHECK(bench.last_feed().second == Approx(3.5 / 3600).epsilon(1e-12));
  CHECK(bench.last_feed().first >= Instant{142ms});
  CHECK(bench.last_feed().first < Instant{143ms});
  CHECK((bench.report().status & board::kMasterLost) != 0);

  SECTION("and comes back with the next set point") {
    bench.sent.clear();
    bench.keep(6.0F, bench.now + 20ms);
    const can::CanFrame reset = bench.last(kEmcyId).value();
    CHECK(field<std::uint16_t>(reset, 0) == 0);
    CHECK(reset.bytes[2] == 0);
    CHECK(bench.report().flow_kg_per_h == 6.0F);
    CHECK((bench.report().status & board::kMasterLost) == 0);
  }
}

TEST_CASE("Feeder: an RPDO without set point does not feed the watchdog", "[board][feeder]") {
  FeederBench bench;
  bench.send(set_point(10.0F));
  REQUIRE(bench.write(0x1601, 1, std::uint32_t{0x0005'0008}) == 0);  // RPDO 2: one gap of 8 bits.
  REQUIRE(bench.write(0x1601, 0, std::uint8_t{1}) == 0);
  REQUIRE(bench.write(0x1401, 1, std::uint32_t{0x300 + kNode}) == 0);
  for (; bench.now < Instant{100ms}; bench.run_to(bench.now + 10ms)) bench.send(0x300 + kNode, {0});
  CHECK(bench.report().flow_kg_per_h == 3.5F);
}

TEST_CASE("Feeder: the watchdog can be switched off, and its safe flow changed, by SDO", "[board][feeder]") {
  FeederBench bench;
  REQUIRE(bench.write(0x2006, 0, std::uint16_t{0}) == 0);
  bench.send(set_point(10.0F));
  bench.run_to(Instant{10s});
  CHECK(bench.report().flow_kg_per_h == 10.0F);
  REQUIRE(bench.write(0x2006, 0, std::uint16_t{20}) == 0);
  REQUIRE(bench.write(0x2005, 0, 1.25F) == 0);
  bench.keep(9.0F, bench.now + 10ms);
  bench.run_to(bench.now + 40ms);
  CHECK(bench.report().flow_kg_per_h == 1.25F);
}

TEST_CASE("Feeder: a lost heartbeat takes the flow to its safe value, and set points alone do not bring it back",
          "[board][feeder]") {
  FeederBench bench;
  REQUIRE(bench.write(0x1016, 1, std::uint32_t{0x007F'0064}) == 0);  // Node 127, 100 ms.
  bench.send(0x77F, {0x05});
  bench.keep(10.0F, Instant{200ms});
  const can::CanFrame emcy = bench.last(kEmcyId).value();
  CHECK(field<std::uint16_t>(emcy, 0) == 0x8130);
  CHECK(bench.report().flow_kg_per_h == 3.5F);
  CHECK(bench.board.node().state() == canopen::NmtState::kOperational);  // 1029:1 = 1: it guards its own output.

  bench.send(0x77F, {0x05});
  bench.keep(10.0F, bench.now + 20ms);
  CHECK(bench.report().flow_kg_per_h == 10.0F);
}

TEST_CASE("Feeder: the hopper runs empty at the instant that the balance gives", "[board][feeder]") {
  board::FeederSettings settings = make_settings();
  settings.hopper_kg = 0.001;
  settings.start_flow_kg_per_h = 3.6;  // 1 g/s.
  FeederBench bench{settings};
  bench.run_to(Instant{900ms});
  CHECK(bench.count(kEmcyId) == 0);
  bench.run_to(Instant{2s});
  const auto [empty_at, feed] = bench.last_feed();
  CHECK(feed == 0.0);
  CHECK(to_s(empty_at) == Approx(1.0).epsilon(1e-6));  // 3.6 is a REAL32.
  CHECK(field<std::uint16_t>(bench.last(kEmcyId).value(), 0) == Feeder::kEmcyHopperEmpty);
  CHECK(bench.report().status == board::kHopperEmpty);
  CHECK(bench.read<float>(0x2008) == Approx(0.001F));
}

TEST_CASE("Feeder: weight and measured flow follow what is delivered", "[board][feeder]") {
  board::FeederSettings settings = make_settings();
  settings.hopper_kg = 10;
  settings.start_flow_kg_per_h = 3.6;
  settings.weight_resolution_kg = 0.001;
  FeederBench bench{settings};
  bench.run_to(Instant{100s});  // 0.1 kg.
  // The scale's last sample is up to 20 ms old, its step is 1 g.
  CHECK(bench.read<float>(0x6130, 1) == Approx(9.9).margin(0.001));
  CHECK(bench.read<std::int32_t>(0x9130, 1) == Approx(99'000).margin(10));
  CHECK(bench.read<float>(0x6130, 2) == Approx(3.6).epsilon(1e-6));
  CHECK(bench.read<float>(0x2008) == Approx(0.1).epsilon(1e-5));

  CHECK(bench.write(0x6139, 1, std::uint32_t{1}) == 0x0609'0030);
  REQUIRE(bench.write(0x6139, 1, std::uint32_t{0x6172'6174}) == 0);
  CHECK(bench.read<float>(0x6140, 1) == 0.0F);
  bench.run_to(Instant{200s});
  CHECK(bench.read<float>(0x6140, 1) == Approx(-0.1).margin(0.0011));
}

TEST_CASE("Feeder: NMT reset node is a power-up, reset communication leaves the flow alone", "[board][feeder]") {
  FeederBench bench;
  bench.keep(10.0F, Instant{50ms});
  bench.send(0x000, {0x82, kNode});
  CHECK(bench.board.flow_kg_per_h() == 10.0);
  bench.send(0x000, {0x81, kNode});
  CHECK(bench.board.flow_kg_per_h() == 2.5);
  bench.run_to(Instant{1s});
  CHECK(bench.board.flow_kg_per_h() == 2.5);
}

TEST_CASE("Feeder: set points stopped by NMT end in the watchdog", "[board][feeder]") {
  FeederBench bench;
  bench.keep(10.0F, Instant{50ms});
  bench.send(0x000, {0x80, kNode});  // Pre-operational: no PDOs.
  bench.keep(10.0F, Instant{150ms});
  CHECK(bench.board.flow_kg_per_h() == 3.5);
}
