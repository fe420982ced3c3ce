#include "bench/record/bus_statistics.hpp"

#include <catch2/catch.hpp>

namespace meltbench::record {
namespace {

Recording make_recording() {
  Recording recording;
  recording.info.nodes = {{5, "feeder"}};
  recording.info.bit_rate_bit_per_s = 500'000;
  recording.ending.at = Instant{1s};
  recording.ending.lost_frames = 2;
  const std::vector<std::uint8_t> eight(8, 0x55);
  for (int i = 0; i < 100; ++i) {
    const Instant sync{i * 10ms};
    recording.frames.push_back(sync, can::make_frame(0x80, {}), 1);
    // Every second answer is 0.5 ms late: periods alternate between 9.5 and 10.5 ms.
    recording.frames.push_back(sync + (i % 2 == 0 ? 0us : 500us), can::make_frame(0x185, eight), 0);
  }
  can::CanFrame error;
  error.kind = can::FrameKind::kError;
  error.length = 8;
  recording.frames.push_back(Instant{999ms}, error, kUnknownSender);
  return recording;
}

}  // namespace

TEST_CASE("Bus statistics: count, period and load per identifier", "[record]") {
  const BusStatistics bus = calc_bus_statistics(make_recording());
  CHECK(bus.frames == 200);
  CHECK(bus.error_frames == 1);
  CHECK(bus.lost_frames == 2);
  CHECK(bus.data_bytes == 800);
  REQUIRE(bus.ids.size() == 2);
  CHECK(bus.ids[0].name == "SYNC");
  CHECK(bus.ids[0].mean_period_s == Approx(0.01));
  CHECK(bus.ids[1].name == "TPDO1 feeder");
  CHECK(bus.ids[1].min_period_s == Approx(0.0095));
  CHECK(bus.ids[1].max_period_s == Approx(0.0105));
  // 100 frames of 47 bits and 100 of 47 + 64 bits in one second at 500 kbit/s.
  REQUIRE(bus.load);
  CHECK(*bus.load == Approx((100 * 47 + 100 * 111) / 500e3));
  CHECK(*bus.ids[1].load == Approx(100 * 111 / 500e3));
}

TEST_CASE("Bus statistics: load is unknown on a bus without a bit rate", "[record]") {
  Recording recording = make_recording();
  recording.info.bit_rate_bit_per_s.reset();
  const BusStatistics bus = calc_bus_statistics(recording);
  CHECK_FALSE(bus.load);
  CHECK_FALSE(bus.ids[0].load);
}

TEST_CASE("Bus statistics: equal numbers of both identifier widths are kept apart", "[record]") {
  Recording recording;
  can::CanFrame extended = can::make_frame(0x185, {});
  extended.extended = true;
  recording.frames.push_back(Instant{1ms}, extended, 0);
  recording.frames.push_back(Instant{2ms}, can::make_frame(0x185, {}), 0);
  recording.frames.push_back(Instant{4ms}, extended, 0);
  const BusStatistics bus = calc_bus_statistics(recording);
  REQUIRE(bus.ids.size() == 2);
  CHECK_FALSE(bus.ids[0].extended);
  CHECK(bus.ids[1].name.empty());
  CHECK(calc_periods_s(recording.frames, 0x185, true) == std::vector<double>{0.003});
  CHECK(calc_periods_s(recording.frames, 0x185, false).empty());
}

TEST_CASE("CANopen identifiers: named by service and node", "[record]") {
  const std::vector<NodeName> nodes{{5, "feeder"}};
  CHECK(name_cob_id(0x000, nodes) == "NMT");
  CHECK(name_cob_id(0x080, nodes) == "SYNC");
  CHECK(name_cob_id(0x085, nodes) == "EMCY feeder");
  CHECK(name_cob_id(0x205, nodes) == "RPDO1 feeder");
  CHECK(name_cob_id(0x489, nodes) == "TPDO4 9");
  CHECK(name_cob_id(0x585, nodes) == "SDO answer feeder");
  CHECK(name_cob_id(0x605, nodes) == "SDO request feeder");
  CHECK(name_cob_id(0x77F, nodes) == "heartbeat 127");
  CHECK(name_cob_id(0x7E4, nodes).empty());
  CHECK(name_cob_id(0x180, nodes).empty());
}

TEST_CASE("Bus statistics: a boot-up is no heartbeat, and no period begins or ends with it", "[record]") {
  Recording recording;
  const auto heartbeat = [&recording](Nanos at, std::uint8_t state) {
    recording.frames.push_back(Instant{at}, can::make_frame(0x705, {state}), 0);
  };
  heartbeat(0ms, 0x00);
  heartbeat(470ms, 0x05);  // The first after the master has set the heartbeat time.
  heartbeat(570ms, 0x05);
  heartbeat(670ms, 0x05);
  heartbeat(700ms, 0x00);  // Boots again.
  heartbeat(900ms, 0x7F);
  heartbeat(1000ms, 0x7F);
  const BusStatistics bus = calc_bus_statistics(recording);
  REQUIRE(bus.ids.size() == 1);
  CHECK(bus.ids[0].frames == 7);
  CHECK(bus.ids[0].min_period_s == Approx(0.1));
  CHECK(bus.ids[0].mean_period_s == Approx(0.1));
  CHECK(bus.ids[0].max_period_s == Approx(0.1));
  CHECK(calc_periods_s(recording.frames, 0x705, false).size() == 3);
}

}  // namespace meltbench::record