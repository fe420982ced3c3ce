/// Runs the real-time driver with nothing to do but to wake up, and prints how late it was: one line per microsecond
/// that occurred, "MICROSECONDS COUNT". Compared with cyclictest by compare.sh.

#include <fmt/format.h>
#include <sys/socket.h>

#include <CLI/CLI.hpp>
#include <array>
#include <exception>

#include "protocols/link/socketcan_link.hpp"
#include "protocols/program/program.hpp"
#include "protocols/runtime/real_time_driver.hpp"
#include "protocols/runtime/real_time_process.hpp"

namespace {

using namespace meltbench;

/// Wants to be woken every period; after the last one it unplugs the bench, which ends the driver.
class Ticker final : public Participant {
 public:
  Ticker(Nanos period, std::int64_t ticks, link::UniqueFd bench)
      : period_{period}, left_{ticks}, bench_{std::move(bench)} {}
  [[nodiscard]] std::string_view name() const override { return "ticker"; }
  [[nodiscard]] std::span<const SignalInfo> signals() const override { return {}; }
  void read_signals(std::span<double> /*values*/) const override {}
  void wake(const Wakeup& in, Outbox& out) override {
    if (--left_ < 0) bench_ = link::UniqueFd{};
    next_ = next_ + period_;
    // After a long delay cyclictest, too, goes on from the next whole period.
    while (next_ <= in.now) next_ = next_ + period_;
    out.wake_at(next_);
  }

 private:
  Nanos period_;
  std::int64_t left_;
  link::UniqueFd bench_;
  Instant next_{};
};

std::array<link::UniqueFd, 2> make_pair(int type) {
  std::array<int, 2> ends{-1, -1};
  ::socketpair(AF_UNIX, type, 0, ends.data());
  return {link::UniqueFd{ends[0]}, link::UniqueFd{ends[1]}};
}

void measure(std::int64_t period_us, std::int64_t ticks) {
  auto can = make_pair(SOCK_DGRAM);
  auto bench = make_pair(SOCK_SEQPACKET);
  link::SocketCanLink link{std::move(can[0]), "none", false};
  runtime::BenchClient client{link::BenchSocket{std::move(bench[0])}};
  Ticker ticker{Nanos{1000 * period_us}, ticks, std::move(bench[1])};
  // A record period beyond the end: what is measured is the wake-up, not the report.
  const link::Welcome timing{link::Pace::kWallClock, 1.0, runtime::read_monotonic(), 86'400s};
  runtime::RealTimeDriver driver{ticker, link, &client, timing};
  static_cast<void>(driver.run());
  for (std::size_t bucket = 0; bucket < LogHistogram::kBuckets; ++bucket) {
    const std::uint64_t count = driver.lateness().in_bucket(bucket);
    if (count > 0) fmt::print("{} {}\n", (LogHistogram::lower_edge(bucket + 1) - 1ns) / 1us, count);
  }
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app{"meltbench_wakeup_lateness - how late the real-time driver wakes up"};
  std::int64_t period_us = 1000;
  std::int64_t ticks = 10'000;
  int priority = 0;
  app.add_option("--period-us", period_us, "Between two deadlines")->capture_default_str();
  app.add_option("--ticks", ticks, "How many")->capture_default_str();
  app.add_option("--rt", priority, "SCHED_FIFO priority, 1..99; 0: SCHED_OTHER")->capture_default_str();
  CLI11_PARSE(app, argc, argv);
  try {
    if (priority > 0) runtime::become_real_time(priority);
    measure(period_us, ticks);
    return 0;
  } catch (const link::LinkError& error) {
    return program::complain(error.what(), error.hint());
  } catch (const std::exception& error) {
    return program::complain(error.what(), {});
  }
}
