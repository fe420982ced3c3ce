#include "bench/bus/wall_clock_relay.hpp"

#include <unistd.h>

#include <catch2/catch.hpp>
#include <thread>

#include "protocols/runtime/real_time_driver.hpp"
#include "tests/bench/bus/toy_participants.hpp"
#include "tests/tools/socket_pair.hpp"

using namespace meltbench;
using namespace meltbench::bus;

namespace {

/// A participant under the real-time driver, in a thread as a process would be, with its lines carried by the bench.
class Program {
 public:
  explicit Program(std::unique_ptr<Participant> participant) : participant_{std::move(participant)} {
    auto ends = test::make_socket_pair(SOCK_SEQPACKET);
    hello_.name = participant_->name();
    hello_.signals.assign(participant_->signals().begin(), participant_->signals().end());
    hello_.lines.assign(participant_->lines().begin(), participant_->lines().end());
    bench_end_ = std::move(ends[0]);
    thread_ = std::thread{[this, end = std::move(ends[1])]() mutable { run(link::BenchSocket{std::move(end)}); }};
  }
  ~Program() { thread_.join(); }
  Joined join() { return {hello_, link::BenchSocket{std::move(bench_end_)}}; }

 private:
  void run(link::BenchSocket socket) {
    std::span<const std::uint8_t> message;
    if (socket.receive(message) != link::ReceiveStatus::kMessage) return;
    const auto welcome = runtime::read_welcome(message);
    if (!welcome) return;
    runtime::BenchClient client{std::move(socket), hello_.lines.size()};
    std::vector<link::SerialLink*> links;
    for (std::size_t line = 0; line < hello_.lines.size(); ++line) links.push_back(&client.line(line));
    static_cast<void>(
        runtime::RealTimeDriver{*participant_, client, &client, *welcome, {participant_->lines(), links}}.run());
  }

  std::unique_ptr<Participant> participant_;
  runtime::Hello hello_;
  link::UniqueFd bench_end_;
  std::thread thread_;
};

class Listener final : public RunObserver {
 public:
  struct Heard {
    std::string line;
    std::size_t sender;
    Instant at;
    std::vector<std::uint8_t> bytes;
  };
  void on_frame(const can::StampedFrame&, std::size_t) override {}
  void on_row(Instant, std::span<const double>) override {}
  void on_event(std::size_t, const Event&) override {}
  void on_serial(std::string_view line, std::size_t sender, Instant at, std::span<const std::uint8_t> bytes) override {
    heard.push_back({std::string{line}, sender, at, {bytes.begin(), bytes.end()}});
  }
  std::vector<Heard> heard;
};

}  // namespace

TEST_CASE("Wall clock: the bench carries serial lines between programs, no faster than their baud rate", "[bus]") {
  const std::vector<config::RigLine> lines{{"hopper", {10'000, serial::Parity::kNone, 1}}};  // A character takes 1 ms.
  Listener listener;
  {
    Program metronome{std::make_unique<test::SerialMetronome>("hopper", 50ms)};
    Program echo{std::make_unique<test::SerialEcho>(std::vector<std::string>{"hopper"})};
    std::vector<Joined> joined;
    joined.push_back(metronome.join());
    joined.push_back(echo.join());
    Broker broker{"relay-test-" + std::to_string(::getpid())};
    WallClockRelay relay{joined, broker, nullptr, 10ms, RunMedia{.lines = lines}};
    const RunOutcome outcome = relay.run(400ms, 1.0, listener);
    CHECK(outcome.kind == RunOutcome::Kind::kCompleted);
    for (Joined& program : joined) stop(program);
  }
  REQUIRE(listener.heard.size() >= 2);
  const auto& question = listener.heard[0];
  const auto& answer = listener.heard[1];
  CHECK(question.line == "hopper");
  CHECK(question.sender == 0);
  CHECK(question.bytes == std::vector<std::uint8_t>{1, 1, 1});
  CHECK(question.at >= Instant{3ms});
  CHECK(answer.sender == 1);
  CHECK(answer.bytes == question.bytes);
  CHECK(answer.at >= question.at + 3ms);
}

TEST_CASE("Wall clock: a program on a line that the rig does not have is refused", "[bus]") {
  std::vector<Joined> joined;
  auto ends = test::make_socket_pair(SOCK_SEQPACKET);
  runtime::Hello hello;
  hello.name = "echo";
  hello.lines = {"elsewhere"};
  joined.push_back({hello, link::BenchSocket{std::move(ends[0])}});
  Broker broker{"relay-test-" + std::to_string(::getpid())};
  CHECK_THROWS_WITH(WallClockRelay(joined, broker, nullptr, 10ms), Catch::Contains("elsewhere"));
}
