#include "protocols/link/socketcan_link.hpp"
#include "tests/tools/socket_pair.hpp"

#include <sys/socket.h>

#include <array>
#include <catch2/catch.hpp>

using namespace meltbench;
using namespace meltbench::link;
using can::CanFrame;
using can::make_frame;

namespace {

/// A socket pair keeps datagrams whole, as a CAN socket does: one end is the link, the other one the bus.
struct FakeBus {
  FakeBus() {
    auto ends = test::make_socket_pair(SOCK_DGRAM | SOCK_NONBLOCK);
    link_end = std::move(ends[0]);
    bus_end = std::move(ends[1]);
    const int on = 1;
    ::setsockopt(link_end.get(), SOL_SOCKET, SO_TIMESTAMPNS, &on, sizeof(on));
  }
  UniqueFd link_end;
  UniqueFd bus_end;
};

CanFrame make_fd_frame() {
  CanFrame frame = make_frame(0x123, {1, 2, 3});
  frame.fd = frame.brs = true;
  frame.length = 12;
  return frame;
}

CanFrame make_error_frame() {
  CanFrame frame;
  frame.kind = can::FrameKind::kError;
  frame.id = 0x20;
  frame.length = 8;
  return frame;
}

CanFrame make_extended_remote() {
  CanFrame frame;
  frame.kind = can::FrameKind::kRemote;
  frame.extended = true;
  frame.id = 0x12345678;
  frame.length = 4;
  return frame;
}

}  // namespace

TEST_CASE("SocketCAN link: every kind of frame has the kernel's layout and comes back equal", "[link]") {
  const CanFrame frame = GENERATE(make_frame(0x7FF, {1, 2, 3, 4, 5, 6, 7, 8}), make_fd_frame(), make_error_frame(),
                                  make_extended_remote());
  FakeBus bus;
  SocketCanLink link{std::move(bus.link_end), "test0", true};
  CHECK(link.send(frame) == SendStatus::kSent);

  canfd_frame kernel{};
  const ssize_t size = ::recv(bus.bus_end.get(), &kernel, sizeof(kernel), 0);
  CHECK(size == static_cast<ssize_t>(frame.fd ? CANFD_MTU : CAN_MTU));
  REQUIRE(::send(bus.bus_end.get(), &kernel, static_cast<std::size_t>(size), 0) == size);
  const auto received = link.receive();
  REQUIRE(received.has_value());
  CHECK(received->frame == frame);
  CHECK(link.counters().errors == (frame.kind == can::FrameKind::kError ? 1U : 0U));
}

TEST_CASE("SocketCAN link: a frame carries the kernel's stamp on the monotonic clock, not the time of reading",
          "[link]") {
  FakeBus bus;
  SocketCanLink link{std::move(bus.link_end), "test0", false};
  canfd_frame kernel{};
  const std::size_t size = to_kernel_frame(make_frame(0x80, {}), kernel);
  REQUIRE(::send(bus.bus_end.get(), &kernel, size, 0) == static_cast<ssize_t>(size));
  timespec sent{};
  ::clock_gettime(CLOCK_MONOTONIC, &sent);
  timespec later{};
  do ::clock_gettime(CLOCK_MONOTONIC, &later);
  while (later.tv_sec == sent.tv_sec && later.tv_nsec - sent.tv_nsec < 5'000'000);
  const auto received = link.receive();
  REQUIRE(received.has_value());
  const Nanos sent_at{sent.tv_sec * 1'000'000'000LL + sent.tv_nsec};
  const Nanos read_at{later.tv_sec * 1'000'000'000LL + later.tv_nsec};
  // The stamp was taken before `sent`; the two clocks are compared at reading, which moves it by far less than 1 ms.
  CHECK(received->at_monotonic < sent_at + 1ms);
  CHECK(received->at_monotonic < read_at);
}

TEST_CASE("SocketCAN link: a full transmit queue is told, counted, and over once the bus takes frames again",
          "[link]") {
  FakeBus bus;
  SocketCanLink link{std::move(bus.link_end), "test0", false};
  int sent = 0;
  while (link.send(make_frame(1, {0})) == SendStatus::kSent) REQUIRE(++sent < 100'000);
  CHECK(link.send(make_frame(1, {0})) == SendStatus::kFull);
  CHECK(link.counters().full == 2);
  canfd_frame kernel{};
  while (::recv(bus.bus_end.get(), &kernel, sizeof(kernel), 0) > 0) {
  }
  CHECK(link.send(make_frame(1, {0})) == SendStatus::kSent);
}

TEST_CASE("SocketCAN link: an interface that is gone makes the link down, without an exception and counted once",
          "[link]") {
  FakeBus bus;
  SocketCanLink link{std::move(bus.link_end), "test0", false};
  bus.bus_end = UniqueFd{};
  CHECK(link.send(make_frame(1, {0})) == SendStatus::kDown);
  CHECK(link.send(make_frame(1, {0})) == SendStatus::kDown);
  CHECK_FALSE(link.receive().has_value());
  CHECK_FALSE(link.is_up());  // "test0" is not there to be opened again.
  CHECK(link.counters().downs == 1);
}

TEST_CASE("SocketCAN link: a classic interface refuses FD frames", "[link]") {
  FakeBus bus;
  SocketCanLink link{std::move(bus.link_end), "test0", false};
  CHECK(link.send(make_fd_frame()) == SendStatus::kUnsupported);
}

TEST_CASE("SocketCAN link: datagrams that are no frame are passed over", "[link]") {
  FakeBus bus;
  SocketCanLink link{std::move(bus.link_end), "test0", true};
  const std::array<char, 5> noise{};
  REQUIRE(::send(bus.bus_end.get(), noise.data(), noise.size(), 0) == 5);
  canfd_frame impossible{};
  impossible.len = 200;
  REQUIRE(::send(bus.bus_end.get(), &impossible, CANFD_MTU, 0) == static_cast<ssize_t>(CANFD_MTU));
  CHECK_FALSE(link.receive().has_value());
}

TEST_CASE("SocketCAN link: an interface that cannot be opened is a clear error with a hint", "[link]") {
  try {
    SocketCanLink link{"nosuchcan7"};
    FAIL("opened an interface that does not exist");
  } catch (const LinkError& error) {
    CHECK_THAT(error.what(), Catch::Contains("cannot open CAN interface \"nosuchcan7\""));
    CHECK_FALSE(error.hint().empty());
  }
}
