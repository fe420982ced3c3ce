#include "bench/bus/gateway.hpp"

#include <catch2/catch.hpp>

#include "tests/tools/fake_can_link.hpp"

using namespace meltbench;
using namespace meltbench::bus;
using test::FakeCanLink;

namespace {

struct Exchanged {
  std::vector<link::ReceivedFrame> arrived;
  std::vector<Event> events;
};

Exchanged exchange(Gateway& gateway, Instant now) {
  Exchanged result;
  gateway.exchange(now, result.arrived, result.events);
  return result;
}

}  // namespace

TEST_CASE("Gateway: frames go both ways in order, and wait while the adapter is full", "[bus]") {
  FakeCanLink adapter;
  Gateway gateway{adapter};
  adapter.room = 2;
  for (std::uint32_t id = 1; id <= 4; ++id) gateway.send(can::make_frame(id, {}));
  adapter.received = {can::make_frame(7, {}), can::make_frame(8, {})};
  const auto arrived = exchange(gateway, Instant{1ms}).arrived;
  REQUIRE(arrived.size() == 2);
  CHECK(arrived[0].frame.id == 7);
  CHECK(adapter.sent_ids() == std::vector<std::uint32_t>{1, 2});
  CHECK(gateway.has_waiting());
  adapter.room = 100;
  static_cast<void>(exchange(gateway, Instant{2ms}));
  CHECK(adapter.sent_ids() == std::vector<std::uint32_t>{1, 2, 3, 4});
  CHECK_FALSE(gateway.has_waiting());
  CHECK(gateway.lost_frames() == 0);
}

TEST_CASE("Gateway: what does not fit, cannot be said, or is refused is counted", "[bus]") {
  FakeCanLink adapter;
  Gateway gateway{adapter};
  adapter.room = 0;
  for (std::size_t i = 0; i < Gateway::kMaxWaiting + 3; ++i) gateway.send(can::make_frame(1, {}));
  CHECK(gateway.lost_frames() == 3);
  adapter.room = Gateway::kMaxWaiting + 1;
  static_cast<void>(exchange(gateway, Instant{1ms}));
  can::CanFrame fd = can::make_frame(2, {});
  fd.fd = true;
  gateway.send(fd);
  gateway.send(can::make_frame(3, {}));
  static_cast<void>(exchange(gateway, Instant{2ms}));
  CHECK(adapter.sent.back().id == 3);
  CHECK(gateway.lost_frames() == 4);
  adapter.counted.refused = 2;
  adapter.counted.dropped = 1;
  CHECK(gateway.lost_frames() == 7);
}

TEST_CASE("Gateway: an adapter that goes and comes back leaves two events, and is looked for every 100 ms", "[bus]") {
  FakeCanLink adapter;
  Gateway gateway{adapter};
  adapter.room = 0;
  gateway.send(can::make_frame(1, {}));
  adapter.up = false;
  const auto gone = exchange(gateway, Instant{1s}).events;
  REQUIRE(gone.size() == 1);
  CHECK(gone[0].code == "link-down");
  CHECK(gone[0].severity == Severity::kWarning);
  gateway.send(can::make_frame(2, {}));
  CHECK(gateway.lost_frames() == 2);  // The one that waited, too.
  const int looks = adapter.looks;
  static_cast<void>(exchange(gateway, Instant{1s + 50ms}));
  CHECK(adapter.looks == looks);
  adapter.up = true;
  adapter.room = 10;
  const auto back = exchange(gateway, Instant{1s + 100ms}).events;
  REQUIRE(back.size() == 1);
  CHECK(back[0].code == "link-up");
  gateway.send(can::make_frame(3, {}));
  static_cast<void>(exchange(gateway, Instant{1s + 101ms}));
  CHECK(adapter.sent_ids() == std::vector<std::uint32_t>{3});
}
