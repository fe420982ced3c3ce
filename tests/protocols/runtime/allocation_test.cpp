#include <catch2/catch.hpp>
#include <optional>
#include <thread>

#include "protocols/link/socketcan_link.hpp"
#include "protocols/runtime/real_time_driver.hpp"
#include "tests/bench/bus/toy_participants.hpp"
#include "tests/tools/allocation_counter.hpp"
#include "tests/tools/socket_pair.hpp"

using namespace meltbench;
using namespace meltbench::runtime;

namespace {

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
    if (in.now < kWarm) warm_ = test::count_allocations();
    if (in.now >= kDone && !done_) done_ = test::count_allocations();
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
  auto can = test::make_socket_pair(SOCK_DGRAM);
  auto bench = test::make_socket_pair(SOCK_SEQPACKET);
  CountingMetronome metronome;
  DriverEnd end{};  // Checked when the loop has ended: Catch's checks belong to one thread.
  std::thread loop{[&metronome, &end, can_end = std::move(can[0]), bench_end = std::move(bench[0])]() mutable {
    link::SocketCanLink link{std::move(can_end), "test0", false};
    BenchClient client{link::BenchSocket{std::move(bench_end)}};
    end = RealTimeDriver{metronome, link, &client, {link::Pace::kWallClock, 1.0, read_monotonic(), 2ms}}.run();
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
  CHECK(end == DriverEnd::kStopped);
  REQUIRE(metronome.has_run_long_enough());
  CHECK(metronome.allocated() == 0);
}
