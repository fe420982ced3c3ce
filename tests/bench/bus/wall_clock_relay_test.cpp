#include "bench/bus/wall_clock_relay.hpp"

#include <unistd.h>

#include <algorithm>
#include <array>
#include <catch2/catch.hpp>
#include <optional>
#include <thread>
#include <utility>

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

/// Says by events what it is told: orders, frames with their first byte, and plugs of its line.
class Teller final : public Participant {
 public:
  [[nodiscard]] std::string_view name() const override { return "teller"; }
  [[nodiscard]] std::span<const std::string> lines() const override { return lines_; }
  [[nodiscard]] std::span<const SignalInfo> signals() const override { return {}; }
  void read_signals(std::span<double>) const override {}
  void wake(const Wakeup& in, Outbox& out) override {
    for (const can::StampedFrame& stamped : in.frames) {
      out.report(Severity::kInfo, in.now, "frame", std::to_string(stamped.frame.bytes[0]));
    }
    for (const std::string& order : in.orders) out.report(Severity::kInfo, in.now, "order", order);
    const LinkState line = in.lines.empty() ? LinkState::kUp : in.lines[0];
    if (line != line_) out.report(Severity::kInfo, in.now, line == LinkState::kUp ? "plugged" : "unplugged", "");
    line_ = line;
  }

 private:
  std::array<std::string, 1> lines_{"hopper"};
  LinkState line_ = LinkState::kUp;
};

/// Drops frame 2, holds frame 3 until 5 has passed and a deadline has come, then orders, unplugs and plugs in: each as
/// soon as the one before has been told. Ends the run when all has.
class Meddler final : public RunObserver, public Intervention {
 public:
  explicit Meddler(Joined& teller) : teller_{teller} {}

  void on_frame(const can::StampedFrame&, std::size_t) override {}
  void on_row(Instant, std::span<const double>) override {}
  void on_event(std::size_t, const Event& event) override {
    told.push_back(event.code + " " + event.text);
    if (event.code == "plugged") stop(teller_);
  }

  [[nodiscard]] Instant next_deadline() const override { return deadline_; }
  void on_time(Instant now, RunControl& run) override {
    CHECK(now >= deadline_);
    deadline_ = Instant::never();
    run.deliver(can::make_frame(0x123, {3}), 0);
  }
  [[nodiscard]] bool on_frame(const can::StampedFrame& stamped, std::size_t sender, RunControl& run) override {
    CHECK(sender == 0);
    const int number = stamped.frame.bytes[0];
    if (number == 5) deadline_ = stamped.at + 1ms;
    if (number > 5 && has_told("frame 3") && !std::exchange(ordered_, true)) run.post_order(1, "x = 1");
    if (has_told("order x = 1") && !std::exchange(unplugged_, true)) run.plug_line(1, 0, false);
    if (has_told("unplugged ")) run.plug_line(1, 0, true);
    return number != 2 && number != 3;
  }
  [[nodiscard]] bool has_told(const std::string& text) const {
    return std::find(told.begin(), told.end(), text) != told.end();
  }
  std::vector<std::string> told;

 private:
  Joined& teller_;
  Instant deadline_ = Instant::never();
  bool ordered_ = false;
  bool unplugged_ = false;
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

TEST_CASE("Wall clock: an intervention holds up frames, gives orders and pulls plugs, as in virtual time", "[bus]") {
  const std::vector<config::RigLine> lines{{"hopper", {10'000, serial::Parity::kNone, 1}}};
  std::optional<Meddler> meddler;
  {
    Program metronome{std::make_unique<test::Metronome>("metronome", 0x123, 5ms)};
    Program teller{std::make_unique<Teller>()};
    std::vector<Joined> joined;
    joined.push_back(metronome.join());
    joined.push_back(teller.join());
    meddler.emplace(joined[1]);
    Broker broker{"relay-test-" + std::to_string(::getpid())};
    WallClockRelay relay{joined, broker, nullptr, 10ms, RunMedia{.lines = lines, .intervention = &*meddler}};
    const RunOutcome outcome = relay.run(60s, 1.0, *meddler);
    CHECK(outcome.kind == RunOutcome::Kind::kParticipantLost);  // The meddler has stopped it.
    stop(joined[0]);
  }
  const std::vector<std::string>& told = meddler->told;
  REQUIRE(told.size() > 4);
  CHECK(std::vector<std::string>{told.begin(), told.begin() + 2} == std::vector<std::string>{"frame 1", "frame 4"});
  CHECK_FALSE(meddler->has_told("frame 2"));
  const auto place = [&](const std::string& text) { return std::find(told.begin(), told.end(), text) - told.begin(); };
  CHECK(place("frame 5") < place("frame 3"));
  CHECK(place("frame 3") < place("order x = 1"));
  CHECK(place("order x = 1") < place("unplugged "));
  CHECK(place("unplugged ") < place("plugged "));
  CHECK(meddler->has_told("plugged "));
}
