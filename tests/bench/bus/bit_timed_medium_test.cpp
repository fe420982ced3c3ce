#include "bench/bus/bit_timed_medium.hpp"

#include <algorithm>
#include <array>
#include <catch2/catch.hpp>

#include "bench/bus/virtual_time.hpp"
#include "protocols/can/candump.hpp"
#include "protocols/runtime/participant_port.hpp"
#include "tests/bench/bus/toy_participants.hpp"

using namespace meltbench;
using namespace meltbench::bus;
using runtime::InProcessPort;
using runtime::ParticipantPort;

namespace {

/// Boards as one participant: sends what it is told to at once, and writes down what it hears and which states it has.
class Boards final : public Participant {
 public:
  struct Order {
    std::uint8_t node = 0;
    can::CanFrame frame;
  };
  [[nodiscard]] std::string_view name() const override { return "boards"; }
  [[nodiscard]] std::span<const std::string> nodes() const override { return names; }
  [[nodiscard]] std::span<const SignalInfo> signals() const override { return {}; }
  void read_signals(std::span<double>) const override {}
  void wake(const Wakeup& in, Outbox& out) override {
    for (const can::StampedFrame& frame : in.frames) heard.push_back(frame);
    states.assign(in.nodes.begin(), in.nodes.end());
    for (const Order& order : orders) {
      out.speak_as(order.node);
      out.send(order.frame);
    }
    orders.clear();
    out.wake_at(Instant::never());
  }

  std::vector<std::string> names{"feeder", "drive"};
  std::vector<Order> orders;
  std::vector<can::StampedFrame> heard;
  std::vector<can::ErrorState> states;
};

/// A program behind a driver: sends a burst at the start.
class Burst final : public Participant {
 public:
  explicit Burst(int frames) : frames_{frames} {}
  [[nodiscard]] std::string_view name() const override { return "burst"; }
  [[nodiscard]] std::span<const SignalInfo> signals() const override { return {}; }
  void read_signals(std::span<double>) const override {}
  void wake(const Wakeup& in, Outbox& out) override {
    for (const can::StampedFrame& frame : in.frames) heard.push_back(frame);
    if (in.now == Instant{} && frames_ > 0) {
      for (int i = 0; i < frames_; ++i) out.send(can::make_frame(0x200, {static_cast<std::uint8_t>(i)}));
      frames_ = 0;
    }
    out.wake_at(Instant::never());
  }
  std::vector<can::StampedFrame> heard;

 private:
  int frames_;
};

class Notes final : public RunObserver {
 public:
  void on_frame(const can::StampedFrame& frame, std::size_t sender) override {
    (frame.frame.kind == can::FrameKind::kError ? errors : frames).emplace_back(sender, frame);
  }
  void on_row(Instant, std::span<const double>) override {}
  void on_event(std::size_t, const Event& event) override { events.push_back(event); }
  std::vector<std::pair<std::size_t, can::StampedFrame>> frames, errors;
  std::vector<Event> events;
};

RunOutcome run(std::span<ParticipantPort* const> ports, RunObserver& observer, const BitTimedSettings& settings,
               Nanos duration) {
  RunMedia media;
  media.bit_timed = settings;
  return VirtualTime{ports, 10ms, observer, media}.run(duration);
}

class Silent final : public MediumListener {
 public:
  void on_crossed(const can::StampedFrame&, std::size_t, std::uint64_t) override {}
  void on_error_frame(const can::StampedFrame&, std::size_t) override {}
  void on_node_state(std::size_t, const Event&) override {}
};

}  // namespace

TEST_CASE("Bit-timed medium: boards of one participant hear each other over the wire, after the frame's time",
          "[bus]") {
  Boards boards;
  boards.orders = {{0, can::make_frame(0x185, {1})}, {1, can::make_frame(0x080, {})}};
  Burst other{0};
  InProcessPort a{boards};
  InProcessPort b{other};
  const std::array<ParticipantPort*, 2> ports{&a, &b};
  Notes notes;
  const RunOutcome outcome = run(ports, notes, {}, 5ms);
  CHECK(outcome.kind == RunOutcome::Kind::kCompleted);
  CHECK(outcome.lost_frames == 0);
  REQUIRE(notes.frames.size() == 2);
  CHECK(notes.frames[0].second.frame.id == 0x080);  // The drive's, by arbitration.
  CHECK(notes.frames[0].second.at == Instant{48 * 2us});
  REQUIRE(boards.heard.size() == 2);
  CHECK(boards.heard[0].frame.id == 0x080);
  CHECK(boards.heard[0].at == Instant{48 * 2us});
  CHECK(boards.heard[1].frame.id == 0x185);
  CHECK(other.heard.size() == 2);
  CHECK(boards.states == std::vector{can::ErrorState::kActive, can::ErrorState::kActive});
}

TEST_CASE("Bit-timed medium: a program's driver keeps what the full queue refuses, a board loses it", "[bus]") {
  BitTimedSettings settings;
  settings.tx_queue = 4;
  SECTION("a program") {
    Burst burst{20};
    Burst other{0};
    InProcessPort a{burst};
    InProcessPort b{other};
    const std::array<ParticipantPort*, 2> ports{&a, &b};
    Notes notes;
    CHECK(run(ports, notes, settings, 100ms).lost_frames == 0);
    REQUIRE(other.heard.size() == 20);
    for (std::size_t i = 0; i < 20; ++i) CHECK(other.heard[i].frame.bytes[0] == i);
  }
  SECTION("a board") {
    Boards boards;
    for (int i = 0; i < 20; ++i) boards.orders.push_back({1, can::make_frame(0x200, {static_cast<std::uint8_t>(i)})});
    Burst other{0};
    InProcessPort a{boards};
    InProcessPort b{other};
    const std::array<ParticipantPort*, 2> ports{&a, &b};
    Notes notes;
    CHECK(run(ports, notes, settings, 100ms).lost_frames == 16);
    CHECK(other.heard.size() == 4);
  }
}

TEST_CASE("Bit-timed medium: what comes from outside waits for room in its queue, none is lost or swapped", "[bus]") {
  /// Has forty frames to send, and gives as many as there is room for.
  class Loud final : public Outside {
   public:
    void exchange(std::size_t room, std::vector<can::CanFrame>& frames) override {
      for (; room > 0 && next_ < 40; --room) frames.push_back(can::make_frame(0x300, {next_++}));
    }
    void show(const can::StampedFrame&, std::size_t sender) override { own_seen += sender == kTapSender ? 1 : 0; }
    void watch(std::vector<pollfd>&) const override {}
    int own_seen = 0;

   private:
    std::uint8_t next_ = 0;
  };
  Burst burst{0};
  InProcessPort port{burst};
  const std::array<ParticipantPort*, 1> ports{&port};
  Notes notes;
  Loud loud;
  RunMedia media;
  media.bit_timed = BitTimedSettings{};
  media.outside = &loud;
  CHECK(VirtualTime{ports, 1ms, notes, media}.run(100ms).lost_frames == 0);
  REQUIRE(burst.heard.size() == 40);
  for (std::size_t i = 0; i < 40; ++i) CHECK(burst.heard[i].frame.bytes[0] == i);
  CHECK(loud.own_seen == 40);
}

TEST_CASE("Bit-timed medium: a lone program gets no acknowledgement, and the recording says so", "[bus]") {
  Burst lone{1};
  InProcessPort port{lone};
  const std::array<ParticipantPort*, 1> ports{&port};
  Notes notes;
  CHECK(run(ports, notes, {}, 20ms).kind == RunOutcome::Kind::kCompleted);
  CHECK(notes.frames.empty());
  CHECK(notes.errors.size() > 50);
  REQUIRE(notes.events.size() == 1);
  CHECK(notes.events[0].code == "error-passive");
  CHECK(notes.events[0].text == "burst is error-passive");
}

TEST_CASE("Bit-timed medium: response times per identifier run from queued to the end of the frame", "[bus]") {
  Silent silent;
  const std::array<BitTimedMedium::Member, 2> members{{{"a", {}}, {"b", {}}}};
  BitTimedMedium medium{{}, members, silent};
  medium.send(Instant{}, 0, 0, *can::parse_candump("123#1122334455667788"));  // 112 bits with interframe space.
  medium.send(Instant{}, 1, 0, *can::parse_candump("705#00"));                // 58.
  medium.advance(Instant{10ms});
  REQUIRE(medium.responses().size() == 2);
  CHECK(medium.responses()[0].worst_response == 109 * 2us);
  CHECK(medium.responses()[0].worst_delay == 0us);
  CHECK(medium.responses()[1].worst_delay == 112 * 2us);
  CHECK(medium.responses()[1].worst_response == (112 + 55) * 2us);
  CHECK(medium.node_names() == std::vector<std::string>{"a", "b", "stranger", "twin"});
}

TEST_CASE("Bit-timed medium: a node whose clock is slow takes so much longer to say the same", "[bus]") {
  config::Rig rig;
  rig.bus.fidelity = config::BusFidelity::kBitTimed;
  rig.controller_clock_drift_ppm = -1000;
  config::RigBoard board;
  board.name = "board";
  rig.boards.push_back(board);
  Silent silent;
  const std::array<BitTimedMedium::Member, 2> members{{{"controller", {}}, {"board", {}}}};
  BitTimedMedium medium{{}, members, silent};
  medium.set_clock_drifts(make_media(rig).clock_drifts);
  medium.send(Instant{}, 0, 0, *can::parse_candump("123#1122334455667788"));  // 109 bits of 2 us.
  medium.advance(Instant{5ms});
  medium.send(Instant{5ms}, 1, 0, *can::parse_candump("124#1122334455667788"));  // 110: another CRC.
  medium.advance(Instant{10ms});
  REQUIRE(medium.responses().size() == 2);
  CHECK(medium.responses()[0].worst_response == 218us + 218ns);
  CHECK(medium.responses()[1].worst_response == 220us);
}

TEST_CASE("Bit-timed medium: a device that a fault plugs in speaks, hears, and collides with its like", "[bus]") {
  class Notes final : public MediumListener {
   public:
    void on_crossed(const can::StampedFrame& stamped, std::size_t sender, std::uint64_t heard_by) override {
      crossed.push_back(stamped.frame);
      senders.push_back(sender);
      heard.push_back(heard_by);
    }
    void on_error_frame(const can::StampedFrame&, std::size_t) override { ++errors; }
    void on_node_state(std::size_t, const Event& event) override { states.push_back(event.text); }
    std::vector<can::CanFrame> crossed;
    std::vector<std::size_t> senders;
    std::vector<std::uint64_t> heard;
    int errors = 0;
    std::vector<std::string> states;
  };
  Notes notes;
  const std::array<BitTimedMedium::Member, 2> members{{{"a", {}}, {"b", {}}}};
  BitTimedMedium medium{{}, members, notes};
  CHECK_FALSE(medium.hears_twin());
  medium.plug_twin(Instant{}, true);
  medium.advance(Instant{1ms});
  REQUIRE(medium.hears_twin());
  medium.send_for_twin(Instant{1ms}, *can::parse_candump("705#00"));
  medium.advance(Instant{2ms});
  REQUIRE(notes.crossed.size() == 1);
  CHECK(notes.senders[0] == kOutsideSender);
  CHECK(notes.heard[0] == 0b11);
  // Equal bits go as one frame.
  medium.send(Instant{2ms}, 0, 0, *can::parse_candump("701#05"));
  medium.send_for_twin(Instant{2ms}, *can::parse_candump("701#05"));
  medium.advance(Instant{3ms});
  CHECK(notes.crossed.size() == 2);
  CHECK(notes.errors == 0);
  // Other bits behind an equal identifier destroy each other until one of the two is bus-off.
  medium.send(Instant{3ms}, 0, 0, *can::parse_candump("181#0000"));
  medium.send_for_twin(Instant{3ms}, *can::parse_candump("181#0001"));
  medium.advance(Instant{50ms});
  CHECK(notes.errors >= 16);
  CHECK(std::ranges::count(notes.states, "twin is error-passive") == 1);
  medium.plug_twin(Instant{50ms}, false);
  CHECK_FALSE(medium.hears_twin());
}
