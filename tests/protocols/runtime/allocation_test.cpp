#include <sys/socket.h>

#include <array>
#include <catch2/catch.hpp>
#include <cstdlib>
#include <new>
#include <optional>
#include <thread>

#include "protocols/link/socketcan_link.hpp"
#include "protocols/runtime/real_time_driver.hpp"
#include "tests/bench/bus/toy_participants.hpp"

namespace {

thread_local std::uint64_t allocation_count = 0;

}  // namespace

// Replace the program's, every form, so that each block is freed as it was made: every allocation is counted.
void* operator new(std::size_t size, const std::nothrow_t&) noexcept {
  ++allocation_count;
  return std::malloc(size);
}
void* operator new(std::size_t size) {
  if (void* memory = operator new(size, std::nothrow)) return memory;
  throw std::bad_alloc{};
}
void* operator new[](std::size_t size) {
  return operator new(size);
}
void* operator new[](std::size_t size, const std::nothrow_t&) noexcept {
  return operator new(size, std::nothrow);
}
void operator delete(void* memory) noexcept {
  std::free(memory);
}
void operator delete(void* memory, std::size_t) noexcept {
  std::free(memory);
}
void operator delete(void* memory, const std::nothrow_t&) noexcept {
  std::free(memory);
}
void operator delete[](void* memory) noexcept {
  std::free(memory);
}
void operator delete[](void* memory, std::size_t) noexcept {
  std::free(memory);
}
void operator delete[](void* memory, const std::nothrow_t&) noexcept {
  std::free(memory);
}

using namespace meltbench;
using namespace meltbench::runtime;

namespace {

std::array<link::UniqueFd, 2> make_pair(int type) {
  std::array<int, 2> ends{};
  REQUIRE(::socketpair(AF_UNIX, type, 0, ends.data()) == 0);
  return {link::UniqueFd{ends[0]}, link::UniqueFd{ends[1]}};
}

/// A metronome that reads how often its thread has allocated, early in the run and late.
class CountingMetronome final : public Participant {
 public:
  static constexpr Nanos kPeriod = 1ms;
  static constexpr Instant kWarm{100ms};
  static constexpr Instant kDone{1100ms};  // Beyond the first report of the lateness, after a second.

  [[nodiscard]] std::string_view name() const override { return metronome_.name(); }
  [[nodiscard]] std::span<const SignalInfo> signals() const override { return metronome_.signals(); }
  void read_signals(std::span<double> values) const override { metronome_.read_signals(values); }
  void wake(const Wakeup& in, Outbox& out) override {
    if (in.now < kWarm) warm_ = allocation_count;
    if (in.now >= kDone && !done_) done_ = allocation_count;
    metronome_.wake(in, out);
  }
  [[nodiscard]] bool has_run_long_enough() const { return done_.has_value(); }
  [[nodiscard]] std::uint64_t allocated() const { return *done_ - warm_; }

 private:
  test::Metronome metronome_{"metronome", 0x123, kPeriod};
  std::uint64_t warm_ = 0;
  std::optional<std::uint64_t> done_;
};

}  // namespace

TEST_CASE("Real-time driver: in the steady state the loop allocates nothing", "[runtime]") {
  auto can = make_pair(SOCK_DGRAM);
  auto bench = make_pair(SOCK_SEQPACKET);
  CountingMetronome metronome;
  std::thread loop{[&metronome, can_end = std::move(can[0]), bench_end = std::move(bench[0])]() mutable {
    link::SocketCanLink link{std::move(can_end), "test0", false};
    BenchClient client{link::BenchSocket{std::move(bench_end)}};
    CHECK(RealTimeDriver{metronome, link, &client, {link::Pace::kWallClock, 1.0, read_monotonic(), 2ms}}.run() ==
          DriverEnd::kStopped);
  }};
  // Every frame that it sends is answered by one, so that arrivals are part of the loop.
  link::BenchSocket bench_side{std::move(bench[1])};
  std::span<const std::uint8_t> report;
  for (int frames = 0; frames < CountingMetronome::kDone.since_start / CountingMetronome::kPeriod + 50; ++frames) {
    canfd_frame frame{};
    const ssize_t size = ::recv(can[1].get(), &frame, sizeof(frame), 0);
    if (size <= 0 || ::send(can[1].get(), &frame, static_cast<std::size_t>(size), 0) != size) break;
    while (bench_side.try_receive(report) == link::ReceiveStatus::kMessage) {
    }
  }
  link::MessageWriter writer;
  writer.begin(link::MessageType::kStop);
  REQUIRE(bench_side.send(writer.bytes()));
  loop.join();
  REQUIRE(metronome.has_run_long_enough());
  CHECK(metronome.allocated() == 0);
}
