#include "bench/bus/gateway.hpp"

#include <catch2/catch.hpp>

using namespace meltbench;
using namespace meltbench::bus;

namespace {

/// An adapter whose queue and plug are the test's.
class FakeAdapter final : public link::CanLink {
 public:
  link::SendStatus send(const can::CanFrame& frame) noexcept override {
    if (!up) return link::SendStatus::kDown;
    if (frame.fd) return link::SendStatus::kUnsupported;
    if (room == 0) return link::SendStatus::kFull;
    --room;
    sent.push_back(frame.id);
    return link::SendStatus::kSent;
  }
  std::optional<link::ReceivedFrame> receive() noexcept override {
    if (received.empty()) return std::nullopt;
    const link::ReceivedFrame frame{{}, can::make_frame(received.front(), {})};
    received.pop_front();
    return frame;
  }
  bool is_up() noexcept override {
    ++looks;
    return up;
  }
  [[nodiscard]] int fd() const noexcept override { return -1; }
  [[nodiscard]] const link::LinkCounters& counters() const noexcept override { return counted; }

  bool up = true;
  int looks = 0;
  std::size_t room = 100;
  std::vector<std::uint32_t> sent;
  std::deque<std::uint32_t> received;
  link::LinkCounters counted;
};

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
  FakeAdapter adapter;
  Gateway gateway{adapter};
  adapter.room = 2;
  for (std::uint32_t id = 1; id <= 4; ++id) gateway.send(can::make_frame(id, {}));
  adapter.received = {7, 8};
  const auto arrived = exchange(gateway, Instant{1ms}).arrived;
  REQUIRE(arrived.size() == 2);
  CHECK(arrived[0].frame.id == 7);
  CHECK(adapter.sent == std::vector<std::uint32_t>{1, 2});
  CHECK(gateway.has_waiting());
  adapter.room = 100;
  static_cast<void>(exchange(gateway, Instant{2ms}));
  CHECK(adapter.sent == std::vector<std::uint32_t>{1, 2, 3, 4});
  CHECK_FALSE(gateway.has_waiting());
  CHECK(gateway.lost_frames() == 0);
}

TEST_CASE("Gateway: what does not fit, cannot be said, or is refused is counted", "[bus]") {
  FakeAdapter adapter;
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
  CHECK(adapter.sent.back() == 3);
  CHECK(gateway.lost_frames() == 4);
  adapter.counted.refused = 2;
  adapter.counted.dropped = 1;
  CHECK(gateway.lost_frames() == 7);
}

TEST_CASE("Gateway: an adapter that goes and comes back leaves two events, and is looked for every 100 ms", "[bus]") {
  FakeAdapter adapter;
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
  CHECK(adapter.sent == std::vector<std::uint32_t>{3});
}
