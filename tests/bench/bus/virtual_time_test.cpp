#include "bench/bus/virtual_time.hpp"

#include <array>
#include <catch2/catch.hpp>
#include <functional>
#include <sstream>
#include <thread>

#include "bench/bus/broker.hpp"
#include "protocols/can/candump.hpp"
#include "protocols/runtime/lockstep_driver.hpp"
#include "tests/bench/bus/toy_participants.hpp"
#include "tests/tools/socket_pair.hpp"

using namespace meltbench;
using namespace meltbench::bus;
using runtime::InProcessPort;
using runtime::ParticipantPort;
using test::Echo;
using test::Metronome;
using test::SerialEcho;
using test::SerialMetronome;

namespace {

/// At 10 kbit/s, 8N1, a character takes 1 ms.
const std::vector<config::RigLine> kTwoLines{{"hopper", {10'000, serial::Parity::kNone, 1}},
                                             {"other", {10'000, serial::Parity::kNone, 1}}};

/// Writes down everything as text, so that two runs can be compared.
class TextObserver final : public RunObserver {
 public:
  void on_frame(const can::StampedFrame& frame, std::size_t sender) override {
    text << frame.at.since_start.count() << ' ' << sender << ' ' << can::to_candump(frame.frame) << '\n';
    ++frames;
  }
  void on_row(Instant at, std::span<const double> values) override {
    text << "row " << at.since_start.count();
    for (const double value : values) text << ' ' << value;
    text << '\n';
    rows.push_back(at);
    last_row.assign(values.begin(), values.end());
  }
  void on_event(std::size_t participant, const Event& event) override {
    text << "event " << participant << ' ' << event.code << '\n';
  }
  void on_serial(std::string_view line, std::size_t sender, Instant at, std::span<const std::uint8_t> bytes) override {
    text << at.since_start.count() << ' ' << sender << ' ' << line;
    for (const std::uint8_t byte : bytes) text << ' ' << static_cast<int>(byte);
    text << '\n';
    if (on_piece) on_piece();
  }
  std::function<void()> on_piece;
  std::ostringstream text;
  int frames = 0;
  std::vector<Instant> rows;
  std::vector<double> last_row;
};

/// A participant behind a socket, answering from a thread of its own as a process would.
class RemoteParticipant {
 public:
  explicit RemoteParticipant(std::unique_ptr<Participant> participant) : participant_{std::move(participant)} {
    auto ends = test::make_socket_pair(SOCK_SEQPACKET);
    runtime::Hello hello{std::string{participant_->name()}, true, {}, {}, {}};
    hello.signals.assign(participant_->signals().begin(), participant_->signals().end());
    hello.lines.assign(participant_->lines().begin(), participant_->lines().end());
    joined_ = std::make_unique<Joined>(Joined{hello, link::BenchSocket{std::move(ends[0])}});
    thread_ = std::thread{[this, end = std::move(ends[1])]() mutable {
      link::BenchSocket socket{std::move(end)};
      static_cast<void>(runtime::run_lockstep(*participant_, socket));
    }};
  }
  ~RemoteParticipant() {
    stop(*joined_);
    thread_.join();
  }
  Joined& joined() { return *joined_; }

 private:
  std::unique_ptr<Participant> participant_;
  std::unique_ptr<Joined> joined_;
  std::thread thread_;
};

/// An outsider that sends one frame, after so many times that it was asked in vain, and writes down what it sees.
class ToyOutside final : public Outside {
 public:
  explicit ToyOutside(int silent_calls) : silent_calls_{silent_calls} {}
  void exchange(std::size_t room, std::vector<can::CanFrame>& frames) override {
    REQUIRE(room > 0);
    if (silent_calls_-- == 0) frames.push_back(can::make_frame(0x123, {0xEE}));
  }
  void show(const can::StampedFrame& frame, std::size_t sender) override { seen.emplace_back(frame, sender); }
  void watch(std::vector<pollfd>&) const override {}
  std::vector<std::pair<can::StampedFrame, std::size_t>> seen;

 private:
  int silent_calls_;
};

}  // namespace

TEST_CASE("Virtual time: a frame and its answer cross at the instant of its sending", "[bus]") {
  Metronome metronome{"metronome", 0x100, 10ms};
  Echo echo;
  InProcessPort a{metronome};
  InProcessPort b{echo};
  const std::array<ParticipantPort*, 2> ports{&a, &b};
  TextObserver observer;
  const RunOutcome outcome = VirtualTime{ports, 10ms, observer}.run(20ms);
  CHECK(outcome.kind == RunOutcome::Kind::kCompleted);
  CHECK(outcome.at == Instant{20ms});
  CHECK(observer.text.str() ==
        "0 0 100#01\n0 1 200#01\nrow 0 1 1\n"
        "10000000 0 100#02\n10000000 1 200#02\nrow 10000000 2 2\n"
        "20000000 0 100#03\n20000000 1 200#03\nrow 20000000 3 3\n");
}

TEST_CASE("Virtual time: of two participants due at one instant the lower number goes first", "[bus]") {
  Metronome first{"first", 0x700, 5ms};
  Metronome second{"second", 0x701, 5ms};
  InProcessPort a{first};
  InProcessPort b{second};
  TextObserver forward;
  TextObserver backward;
  SECTION("as numbered") {
    const std::array<ParticipantPort*, 2> ports{&a, &b};
    CHECK(VirtualTime{ports, 5ms, forward}.run(0ms).kind == RunOutcome::Kind::kCompleted);
    CHECK(forward.text.str().starts_with("0 0 700#01\n0 1 701#01\n"));
  }
  SECTION("numbered the other way") {
    const std::array<ParticipantPort*, 2> ports{&b, &a};
    CHECK(VirtualTime{ports, 5ms, backward}.run(0ms).kind == RunOutcome::Kind::kCompleted);
    CHECK(backward.text.str().starts_with("0 0 701#01\n0 1 700#01\n"));
  }
}

TEST_CASE("Virtual time: rows stand at whole multiples of the record period and hold what is true then", "[bus]") {
  Metronome metronome{"metronome", 0x700, 7ms};
  InProcessPort port{metronome};
  const std::array<ParticipantPort*, 1> ports{&port};
  TextObserver observer;
  static_cast<void>(VirtualTime{ports, 10ms, observer}.run(100ms));
  REQUIRE(observer.rows.size() == 11);
  CHECK(observer.rows.back() == Instant{100ms});
  CHECK(observer.last_row[0] == 15);  // Sent at 0, 7, ..., 98 ms.
}

TEST_CASE("Virtual time: processes and objects give the same run to the last byte", "[bus]") {
  TextObserver in_process;
  {
    Metronome metronome{"metronome", 0x100, 3ms};
    Metronome other{"other", 0x250, 7ms};
    Echo echo;
    InProcessPort a{metronome};
    InProcessPort b{other};
    InProcessPort c{echo};
    const std::array<ParticipantPort*, 3> ports{&a, &b, &c};
    static_cast<void>(VirtualTime{ports, 10ms, in_process}.run(500ms));
  }
  TextObserver lockstep;
  {
    RemoteParticipant metronome{std::make_unique<Metronome>("metronome", 0x100, 3ms)};
    RemoteParticipant other{std::make_unique<Metronome>("other", 0x250, 7ms)};
    RemoteParticipant echo{std::make_unique<Echo>()};
    SocketPort a{metronome.joined()};
    SocketPort b{other.joined()};
    SocketPort c{echo.joined()};
    const std::array<ParticipantPort*, 3> ports{&a, &b, &c};
    static_cast<void>(VirtualTime{ports, 10ms, lockstep}.run(500ms));
  }
  CHECK(in_process.frames > 400);
  CHECK(in_process.text.str() == lockstep.text.str());
}

TEST_CASE("Virtual time: two that answer each other without end are stopped and named", "[bus]") {
  class Parrot final : public Participant {
   public:
    [[nodiscard]] std::string_view name() const override { return "parrot"; }
    [[nodiscard]] std::span<const SignalInfo> signals() const override { return {}; }
    void read_signals(std::span<double>) const override {}
    void wake(const Wakeup&, Outbox& out) override { out.send(can::make_frame(1, {})); }
  };
  Parrot one;
  Parrot two;
  InProcessPort a{one};
  InProcessPort b{two};
  const std::array<ParticipantPort*, 2> ports{&a, &b};
  TextObserver observer;
  const RunOutcome outcome = VirtualTime{ports, 10ms, observer}.run(1s);
  CHECK(outcome.kind == RunOutcome::Kind::kParticipantLost);
  CHECK_THAT(outcome.text, Catch::Contains("parrot"));
}

TEST_CASE("Lockstep: a participant whose process has died ends the run and is named", "[bus]") {
  auto ends = test::make_socket_pair(SOCK_SEQPACKET);
  Joined joined{{"plant", true, {}, {}, {}}, link::BenchSocket{std::move(ends[0])}};
  SocketPort port{joined};
  const std::array<ParticipantPort*, 1> ports{&port};
  TextObserver observer;
  SECTION("died") {
    ends[1] = link::UniqueFd{};
    const RunOutcome outcome = VirtualTime{ports, 10ms, observer}.run(1s);
    CHECK(outcome.kind == RunOutcome::Kind::kParticipantLost);
    CHECK_THAT(outcome.text, Catch::Contains("plant has died"));
  }
  SECTION("hangs") {
    const RunOutcome outcome = VirtualTime{ports, 10ms, observer}.run(1s);
    CHECK(outcome.kind == RunOutcome::Kind::kParticipantLost);
    CHECK_THAT(outcome.text, Catch::Contains("plant hangs"));
  }
  SECTION("answers nonsense") {
    link::BenchSocket other{std::move(ends[1])};
    const std::array<std::uint8_t, 3> nonsense{1, 2, 3};
    REQUIRE(other.send(nonsense));
    const RunOutcome outcome = VirtualTime{ports, 10ms, observer}.run(1s);
    CHECK(outcome.kind == RunOutcome::Kind::kParticipantLost);
    CHECK_THAT(outcome.text, Catch::Contains("plant sent nonsense"));
  }
}

TEST_CASE("Virtual time: what the bench asks of a participant wakes it at the instant of the asking", "[bus]") {
  /// Asks at the row of 30 ms.
  class Asking final : public RunObserver {
   public:
    void on_frame(const can::StampedFrame&, std::size_t) override {}
    void on_row(Instant at, std::span<const double>) override {
      if (at == Instant{30ms}) engine->post_order(0, "kind = \"off\"");
    }
    void on_event(std::size_t, const Event&) override {}
    VirtualTime* engine = nullptr;
  };
  /// Notes when it was asked.
  class Obedient final : public Participant {
   public:
    [[nodiscard]] std::string_view name() const override { return "obedient"; }
    [[nodiscard]] std::span<const SignalInfo> signals() const override { return {}; }
    void read_signals(std::span<double>) const override {}
    void wake(const Wakeup& in, Outbox&) override {
      for (const std::string& order : in.orders) heard.emplace_back(in.now, order);
    }
    std::vector<std::pair<Instant, std::string>> heard;
  };
  Obedient obedient;
  InProcessPort port{obedient};
  const std::array<ParticipantPort*, 1> ports{&port};
  Asking observer;
  VirtualTime engine{ports, 10ms, observer};
  observer.engine = &engine;
  CHECK(engine.run(100ms).kind == RunOutcome::Kind::kCompleted);
  REQUIRE(obedient.heard.size() == 1);
  // The row of 30 ms is written when time goes on from there, before anything else happens.
  CHECK(obedient.heard[0].first >= Instant{30ms});
  CHECK(obedient.heard[0].first <= Instant{40ms});
  CHECK(obedient.heard[0].second == "kind = \"off\"");
}

TEST_CASE("Virtual time: a frame from outside enters when somebody is due next, reaches everybody and is marked",
          "[bus]") {
  Metronome metronome{"metronome", 0x700, 10ms};
  Echo echo;
  InProcessPort a{metronome};
  InProcessPort b{echo};
  const std::array<ParticipantPort*, 2> ports{&a, &b};
  TextObserver observer;
  ToyOutside outside{2};  // The instants after the start are 10, 20 and 30 ms: it sends at the third.
  REQUIRE(VirtualTime{ports, 10ms, observer, RunMedia{.outside = &outside}}.run(45ms).kind ==
          RunOutcome::Kind::kCompleted);
  const auto& seen = outside.seen;
  const auto own = std::ranges::find(seen, kTapSender, [](const auto& each) { return each.second; });
  REQUIRE(own != seen.end());
  CHECK(own->first == can::StampedFrame{Instant{30ms}, can::make_frame(0x123, {0xEE})});
  const auto answer = std::ranges::find(seen, 0x223U, [](const auto& each) { return each.first.frame.id; });
  REQUIRE(answer != seen.end());
  CHECK(answer->first.at == Instant{30ms});
  CHECK(seen.size() == static_cast<std::size_t>(observer.frames));
  const std::string text = observer.text.str();
  CHECK(text.find("30000000 254 123#EE") != std::string::npos);
  CHECK(text.find("event 254 frames-from-outside") != std::string::npos);
  CHECK(text.find("frames-from-outside") == text.rfind("frames-from-outside"));
}

TEST_CASE("Virtual time: bytes cross a serial line in the time of its baud rate, and their answer too", "[bus]") {
  SerialMetronome metronome{"hopper", 20ms};
  SerialEcho echo{{"other", "hopper"}};
  InProcessPort a{metronome};
  InProcessPort b{echo};
  const std::array<ParticipantPort*, 2> ports{&a, &b};
  TextObserver observer;
  static_cast<void>(VirtualTime{ports, 20ms, observer, RunMedia{.lines = kTwoLines}}.run(30ms));
  CHECK(observer.text.str() ==
        "row 0 1 0 0\n3000000 0 hopper 1 1 1\n6000000 1 hopper 1 1 1\n"
        "row 20000000 2 1 0\n23000000 0 hopper 2 2 2\n26000000 1 hopper 2 2 2\n");
}

TEST_CASE("Virtual time: a line that the rig does not have is refused", "[bus]") {
  SerialEcho echo{{"elsewhere"}};
  InProcessPort port{echo};
  const std::array<ParticipantPort*, 1> ports{&port};
  TextObserver observer;
  CHECK_THROWS_WITH(VirtualTime(ports, 20ms, observer, RunMedia{.lines = kTwoLines}),
                    Catch::Contains("no line \"elsewhere\""));
}

TEST_CASE("Virtual time: whoever is unplugged from a line is told at once, and hears nothing", "[bus]") {
  SerialMetronome metronome{"hopper", 20ms};
  SerialEcho echo{{"hopper"}};
  InProcessPort a{metronome};
  InProcessPort b{echo};
  const std::array<ParticipantPort*, 2> ports{&a, &b};
  TextObserver observer;
  VirtualTime time{ports, 20ms, observer, RunMedia{.lines = kTwoLines}};
  int pieces = 0;
  observer.on_piece = [&] {
    if (++pieces == 3) time.plug_line(0, 0, false);  // The second count is on its way to the echo.
    if (pieces == 4) time.plug_line(0, 0, true);     // Its answer has come: too early for the metronome to hear it.
  };
  static_cast<void>(time.run(90ms));
  CHECK(observer.last_row == std::vector<double>{5, 3, 1});  // At 80 ms: answers 1, 3 and 4.
  CHECK(time.find_line("hopper") != nullptr);
  CHECK(time.find_line("elsewhere") == nullptr);
}

TEST_CASE("Virtual time: processes and objects give the same run on serial lines, too", "[bus]") {
  TextObserver in_process;
  {
    SerialMetronome metronome{"hopper", 3500us};  // Faster than the line: questions and answers collide.
    SerialEcho echo{{"other", "hopper"}};
    InProcessPort a{metronome};
    InProcessPort b{echo};
    const std::array<ParticipantPort*, 2> ports{&a, &b};
    static_cast<void>(VirtualTime{ports, 10ms, in_process, RunMedia{.lines = kTwoLines}}.run(500ms));
  }
  TextObserver lockstep;
  {
    RemoteParticipant metronome{std::make_unique<SerialMetronome>("hopper", 3500us)};
    RemoteParticipant echo{std::make_unique<SerialEcho>(std::vector<std::string>{"other", "hopper"})};
    SocketPort a{metronome.joined()};
    SocketPort b{echo.joined()};
    const std::array<ParticipantPort*, 2> ports{&a, &b};
    static_cast<void>(VirtualTime{ports, 10ms, lockstep, RunMedia{.lines = kTwoLines}}.run(500ms));
  }
  CHECK(in_process.text.str().size() > 5000);
  CHECK(in_process.text.str() == lockstep.text.str());
}
