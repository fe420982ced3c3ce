#include "protocols/runtime/real_time_driver.hpp"

#include <sys/socket.h>

#include <array>
#include <catch2/catch.hpp>
#include <thread>

#include "protocols/link/no_can_link.hpp"
#include "protocols/link/socketcan_link.hpp"
#include "tests/bench/bus/toy_participants.hpp"
#include "tests/protocols/link/pseudo_terminal.hpp"
#include "tests/tools/socket_pair.hpp"
#include "tests/tools/temporary_folder.hpp"

using namespace meltbench;
using namespace meltbench::runtime;

namespace {

/// A metronome of 1 ms under the real-time driver, in a thread of its own; the test holds the other ends.
class DrivenMetronome {
 public:
  DrivenMetronome() {
    auto can = test::make_socket_pair(SOCK_DGRAM);
    auto bench = test::make_socket_pair(SOCK_SEQPACKET);
    bus_ = std::move(can[1]);
    bench_ = std::make_unique<link::BenchSocket>(std::move(bench[1]));
    thread_ = std::thread{[this, can_end = std::move(can[0]), bench_end = std::move(bench[0])]() mutable {
      test::Metronome metronome{"metronome", 0x123, 1ms};
      link::SocketCanLink link{std::move(can_end), "test0", false};
      BenchClient client{link::BenchSocket{std::move(bench_end)}};
      end_ = RealTimeDriver{metronome, link, &client, {link::Pace::kWallClock, 1.0, read_monotonic(), 2ms}}.run();
    }};
  }
  ~DrivenMetronome() { stop(); }

  [[nodiscard]] can::CanFrame receive_frame() const {
    canfd_frame kernel{};
    const ssize_t size = ::recv(bus_.get(), &kernel, sizeof(kernel), 0);
    return link::from_kernel_frame(kernel, static_cast<std::size_t>(size)).value();
  }
  void send_frame(const can::CanFrame& frame) const {
    canfd_frame kernel{};
    const std::size_t size = link::to_kernel_frame(frame, kernel);
    REQUIRE(::send(bus_.get(), &kernel, size, 0) == static_cast<ssize_t>(size));
  }
  void unplug() { bus_ = link::UniqueFd{}; }

  /// How late the wake-ups were, as told last of all. @pre stop()
  [[nodiscard]] LogHistogram receive_last_timing() {
    LogHistogram lateness;
    LogHistogram read;
    std::span<const std::uint8_t> message;
    while (bench_->receive(message) == link::ReceiveStatus::kMessage) {
      if (read_timing(message, read)) lateness = read;
    }
    return lateness;
  }

  /// The next report: sent, received, deadline misses, frames lost, worst lateness, sends refused by a full queue.
  [[nodiscard]] std::array<double, 6> receive_report(std::vector<Event>& events) {
    std::span<const std::uint8_t> message;
    REQUIRE(bench_->receive(message) == link::ReceiveStatus::kMessage);
    std::array<double, 6> values{};
    REQUIRE(read_report(message, events, values).has_value());
    return values;
  }

  DriverEnd stop() {
    if (thread_.joinable()) {
      link::MessageWriter writer;
      writer.begin(link::MessageType::kStop);
      static_cast<void>(bench_->send(writer.bytes()));
      thread_.join();
    }
    return end_;
  }

 private:
  link::UniqueFd bus_;
  std::unique_ptr<link::BenchSocket> bench_;
  DriverEnd end_ = DriverEnd::kBenchLost;
  std::thread thread_;
};

}  // namespace

TEST_CASE("Real-time driver: frames go out in order, arrive, and are reported until the bench says stop", "[runtime]") {
  DrivenMetronome driven;
  for (std::uint8_t count = 1; count <= 20; ++count) CHECK(driven.receive_frame() == can::make_frame(0x123, {count}));
  driven.send_frame(can::make_frame(0x80, {}));
  std::vector<Event> events;
  while (driven.receive_report(events)[1] < 1) CHECK(events.empty());
  CHECK(driven.stop() == DriverEnd::kStopped);
}

TEST_CASE("Real-time driver: the participant is woken for each report, so that it shows the report's own instant",
          "[runtime]") {
  test::WakeCounter counter;
  auto can = test::make_socket_pair(SOCK_DGRAM);
  auto bench = test::make_socket_pair(SOCK_SEQPACKET);
  std::thread thread{[&] {
    link::SocketCanLink link{std::move(can[0]), "test0", false};
    BenchClient client{link::BenchSocket{std::move(bench[0])}};
    static_cast<void>(
        RealTimeDriver{counter, link, &client, {link::Pace::kWallClock, 1.0, read_monotonic(), 1ms}}.run());
  }};
  link::BenchSocket reader{std::move(bench[1])};
  std::span<const std::uint8_t> message;
  std::vector<Event> events;
  std::array<double, 5> values{};
  for (int reports = 1; reports <= 5; ++reports) {
    REQUIRE(reader.receive(message) == link::ReceiveStatus::kMessage);
    REQUIRE(read_report(message, events, values).has_value());
    CHECK(values[0] >= reports);  // It asked for no wake-up but the first.
  }
  link::MessageWriter writer;
  writer.begin(link::MessageType::kStop);
  CHECK(reader.send(writer.bytes()));
  thread.join();
}

TEST_CASE("Real-time driver: an unplugged link is told to the bench, and what cannot be sent is counted", "[runtime]") {
  DrivenMetronome driven;
  static_cast<void>(driven.receive_frame());
  driven.unplug();
  std::vector<Event> events;
  while (events.empty()) static_cast<void>(driven.receive_report(events));
  CHECK(events.front().code == "link-down");
  while (driven.receive_report(events)[3] < 5) CHECK(events.empty());
  CHECK(driven.stop() == DriverEnd::kStopped);
}

TEST_CASE("Real-time driver: at its end it tells how late each wake-up at a deadline was", "[runtime]") {
  DrivenMetronome driven;
  for (int count = 0; count < 50; ++count) static_cast<void>(driven.receive_frame());
  CHECK(driven.stop() == DriverEnd::kStopped);
  const LogHistogram lateness = driven.receive_last_timing();
  CHECK(lateness.count() > 0);  // One per frame but the first, unless the machine is so slow that frames go together.
  CHECK(lateness.max() > 0ns);
  CHECK(lateness.max_at() > Instant{});
}

TEST_CASE("Real-time driver: bytes go out over a serial port, arrive, and the participant is told when it is unplugged",
          "[runtime]") {
  const test::TemporaryFolder folder;
  const std::string name = folder / "by-id";
  test::Device device;
  std::filesystem::create_symlink(device.name(), name);
  link::SerialPort port{name, {19'200, serial::Parity::kNone, 1}};
  link::NoCanLink can;
  auto ends = test::make_socket_pair(SOCK_SEQPACKET);
  link::BenchSocket bench{std::move(ends[1])};
  DriverEnd end{};  // Checked when the loop has ended: Catch's checks belong to one thread.
  std::thread loop{[&, bench_end = std::move(ends[0])]() mutable {
    test::SerialMetronome metronome{"hopper", 1ms};
    BenchClient client{link::BenchSocket{std::move(bench_end)}, 1};
    const std::array<link::SerialLink*, 1> links{&port};
    const link::Welcome timing{link::Pace::kWallClock, 1.0, read_monotonic(), 2ms};
    end = RealTimeDriver{metronome, can, &client, timing, {metronome.lines(), links}}.run();
  }};
  std::vector<Event> all_events;
  const auto read_report_until = [&](auto wanted) {
    std::array<double, 7> values{};  // Sent, received, downs, and those of the driver.
    std::vector<Event> events;
    std::span<const std::uint8_t> message;
    while (!wanted(values)) {
      REQUIRE(bench.receive(message) == link::ReceiveStatus::kMessage);
      if (!read_report(message, events, values)) continue;
      all_events.insert(all_events.end(), events.begin(), events.end());
    }
  };
  CHECK(device.read(6) == "\1\1\1\2\2\2");
  device.write("answer");
  read_report_until([](const auto& values) { return values[1] >= 1; });
  device.unplug();
  read_report_until([](const auto& values) { return values[2] >= 1; });
  const test::Device other;
  std::filesystem::remove(name);
  std::filesystem::create_symlink(other.name(), name);
  CHECK(other.read(3).size() == 3);
  other.write("answer");
  read_report_until([](const auto& values) { return values[1] >= 2; });
  REQUIRE(all_events.size() == 2);
  CHECK(all_events[0].code == "port-down");
  CHECK(all_events[0].severity == Severity::kWarning);
  CHECK(all_events[1].code == "port-up");
  link::MessageWriter writer;
  writer.begin(link::MessageType::kStop);
  REQUIRE(bench.send(writer.bytes()));
  loop.join();
  CHECK(end == DriverEnd::kStopped);
}

TEST_CASE("Real-time driver: a bench that says stop and closes at once, with reports unread, has not been lost",
          "[runtime]") {
  auto can = test::make_socket_pair(SOCK_DGRAM);
  auto bench = test::make_socket_pair(SOCK_SEQPACKET);
  BenchClient client{link::BenchSocket{std::move(bench[0])}};
  client.report(Instant{}, {}, {});  // Nobody will read it.
  {
    link::BenchSocket far{std::move(bench[1])};
    link::MessageWriter writer;
    writer.begin(link::MessageType::kStop);
    REQUIRE(far.send(writer.bytes()));
  }
  test::Metronome metronome{"metronome", 0x123, 1ms};
  link::SocketCanLink link{std::move(can[0]), "test0", false};
  RealTimeDriver driver{metronome, link, &client, {link::Pace::kWallClock, 1.0, read_monotonic(), 2ms}};
  client.report(Instant{}, {}, {});  // Fails: the bench has closed.
  CHECK(driver.run() == DriverEnd::kStopped);
}

TEST_CASE("Real-time driver: without a bench it ends at the instant that it was given, not before", "[runtime]") {
  auto can = test::make_socket_pair(SOCK_DGRAM);
  test::Metronome metronome{"metronome", 0x123, 1ms};
  link::SocketCanLink link{std::move(can[0]), "test0", false};
  const Nanos start = read_monotonic();
  RealTimeDriver driver{metronome, link, nullptr, {link::Pace::kWallClock, 1.0, start, 100ms}};
  CHECK(driver.run(Instant{5ms}) == DriverEnd::kStopped);
  CHECK(read_monotonic() - start >= 5ms);
}
