#include "bench/tap/kernel_mirror.hpp"

#include <catch2/catch.hpp>

#include "bench/tap/tap.hpp"
#include "tests/tools/fake_can_link.hpp"

using namespace meltbench;
using tap::KernelMirror;
using test::FakeCanLink;

namespace {

can::StampedFrame make_shown(std::uint32_t id) {
  return {Instant{1s}, can::make_frame(id, {0xAB})};
}

can::StampedFrame make_error_frame() {
  can::CanFrame frame = can::make_frame(0x40, {0, 0, 0, 0, 0, 0, 0, 0});
  frame.kind = can::FrameKind::kError;
  return {Instant{1s}, frame};
}

/// A mirror, and the interface that it is on.
struct Mirrored {
  explicit Mirrored(bool is_virtual = true, bool read_only = false)
      : mirror{std::make_unique<KernelMirror>(std::unique_ptr<link::CanLink>{link}, "vcan0", is_virtual, read_only)} {}

  std::vector<can::CanFrame> read(std::size_t room) const {
    std::vector<can::CanFrame> taken;
    mirror->read(room, taken);
    return taken;
  }

  FakeCanLink* link = new FakeCanLink;  // The mirror's.
  std::unique_ptr<KernelMirror> mirror;
};

}  // namespace

TEST_CASE("Kernel mirror: frames and error frames go out at once, in order", "[tap]") {
  const Mirrored on;
  on.mirror->show(make_shown(0x181));
  on.mirror->show(make_error_frame());
  on.mirror->show(make_shown(0x80));
  REQUIRE(on.link->sent_ids() == std::vector<std::uint32_t>{0x181, 0x40, 0x80});
  CHECK(on.link->sent[1].kind == can::FrameKind::kError);
  CHECK(on.mirror->complaint().empty());
}

TEST_CASE("Kernel mirror: no error frame goes to an interface with a wire", "[tap]") {
  const Mirrored on{false};
  on.mirror->show(make_error_frame());
  on.mirror->show(make_shown(0x80));
  CHECK(on.link->sent_ids() == std::vector<std::uint32_t>{0x80});
}

TEST_CASE("Kernel mirror: what a full interface does not take waits, and what does not fit is told of at the end",
          "[tap]") {
  const Mirrored on;
  on.link->room = 1;
  for (std::size_t i = 0; i < bus::Gateway::kMaxWaiting + 3; ++i) on.mirror->show(make_shown(0x181));
  CHECK(on.mirror->has_backlog());
  on.link->room = 100'000;
  CHECK(on.read(0).empty());
  CHECK_FALSE(on.mirror->has_backlog());
  CHECK(on.link->sent.size() == bus::Gateway::kMaxWaiting + 1);
  CHECK(on.mirror->complaint() == "vcan0 was full or away, frames lost: 2");
}

TEST_CASE("Kernel mirror: what others send waits for room on the bus, error frames excepted", "[tap]") {
  const Mirrored on;
  on.link->received = {can::make_frame(1, {}), make_error_frame().frame, can::make_frame(2, {}),
                       can::make_frame(3, {})};
  CHECK(on.read(0).empty());
  REQUIRE(on.read(2).size() == 2);
  const auto last = on.read(2);
  REQUIRE(last.size() == 1);
  CHECK(last[0].id == 3);
  for (std::size_t i = 0; i < KernelMirror::kMaxWaiting + 5; ++i) on.link->received.push_back(can::make_frame(4, {}));
  CHECK(on.read(0).empty());
  CHECK(on.mirror->complaint() == "frames from vcan0 that came faster than the bus takes them, and are lost: 5");
}

TEST_CASE("Kernel mirror: nothing comes in if others may look only", "[tap]") {
  const Mirrored on{true, true};
  on.link->received = {can::make_frame(1, {})};
  CHECK(on.read(5).empty());
  CHECK(on.link->received.empty());  // It does not pile up.
  CHECK(on.mirror->complaint().empty());
}

TEST_CASE("Kernel mirror: a tap shows it everything but what came from it", "[tap]") {
  Mirrored on;
  tap::Tap bus{{}};
  bus.admit(std::move(on.mirror));
  on.link->received = {can::make_frame(0x605, {1})};
  std::vector<can::CanFrame> taken;
  bus.exchange(10, taken);
  REQUIRE(taken.size() == 1);
  bus.show({Instant{1s}, taken[0]}, bus::kTapSender);
  bus.show(make_shown(0x585), 1);
  CHECK(on.link->sent_ids() == std::vector<std::uint32_t>{0x585});
  on.link->up = false;
  bus.show(make_shown(0x181), 1);
  bus.drain(1ms);
  CHECK(bus.complaints() == std::vector<std::string>{"vcan0 was full or away, frames lost: 1"});
}
