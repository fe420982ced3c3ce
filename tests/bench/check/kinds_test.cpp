#include "bench/check/kinds.hpp"

#include <catch2/catch.hpp>
#include <cmath>
#include <functional>
#include <limits>

namespace meltbench::check {
namespace {

using record::Recording;

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

/// Ten seconds of one signal "plant.x_m" at 100 rows per second.
Recording make_recording(const std::function<double(double)>& x_of_t) {
  Recording recording;
  recording.signals = {{"plant.x_m"}};
  for (int i = 0; i <= 1000; ++i) {
    recording.row_times.push_back(Instant{i * 10ms});
    recording.values.push_back(x_of_t(0.01 * i));
  }
  recording.ending.at = Instant{10s};
  return recording;
}

/// x = 0.16 (1 - e^-t): within 0.001 of 0.16 from t = ln 160 = 5.0752 s on.
double rise(double t_s) {
  return 0.16 * (1 - std::exp(-t_s));
}

const Quantity kX{"plant.x_m", ""};

Instant at_s(double seconds) {
  return Instant{nanos_from_s(seconds)};
}

}  // namespace

TEST_CASE("settle: the margin is the time left to the nearer of both limits", "[check]") {
  const Recording recording = make_recording(rise);
  // First row inside: 5.08 s, because rows are 10 ms apart.
  const Outcome in_time = Settle{kX, 0.16, 0.001, at_s(6), Instant{}, Instant::never()}.judge(recording);
  CHECK(in_time.held);
  CHECK(in_time.margin == Approx(0.92));
  CHECK(in_time.unit == "s");
  CHECK(*in_time.at_s == Approx(5.08));
  const Outcome too_late = Settle{kX, 0.16, 0.001, at_s(5), Instant{}, Instant::never()}.judge(recording);
  CHECK_FALSE(too_late.held);
  CHECK(too_late.margin == Approx(-0.08));
  const Outcome too_early = Settle{kX, 0.16, 0.001, at_s(6), at_s(5.5), Instant::never()}.judge(recording);
  CHECK_FALSE(too_early.held);
  CHECK(too_early.margin == Approx(-0.42));
}

TEST_CASE("settle: a visit to the band is not enough, it must stay there", "[check]") {
  const Recording recording = make_recording([](double t) { return t > 2 && t < 9.995 ? 0.16 : 0.1; });
  const Outcome outcome = Settle{kX, 0.16, 0.001, at_s(9.999), Instant{}, Instant::never()}.judge(recording);
  CHECK_FALSE(outcome.held);
  CHECK(outcome.margin < 0);
  CHECK(outcome.text.find("still outside") != std::string::npos);
  // Before the disturbance at the end it had settled.
  CHECK(Settle{kX, 0.16, 0.001, at_s(3), Instant{}, at_s(9)}.judge(recording).held);
}

TEST_CASE("settle: a signal without a value has not settled", "[check]") {
  const Recording recording = make_recording([](double t) { return t > 8 ? kNaN : 0.16; });
  CHECK_FALSE(Settle{kX, 0.16, 0.001, at_s(5), Instant{}, Instant::never()}.judge(recording).held);
}

TEST_CASE("never_settles: holds for a limit cycle and fails for a decaying one", "[check]") {
  const Recording cycle = make_recording([](double t) { return 0.16 + 0.004 * std::sin(6 * t); });
  const Outcome swings = NeverSettles{kX, 0.16, 0.001, 3s}.judge(cycle);
  CHECK(swings.held);
  // Rows 10 ms apart at 6 rad/s miss the peak by at most 0.03 rad: 0.05 % of 4 mm.
  CHECK(swings.margin == Approx(0.003).epsilon(1e-3));
  const Recording decay = make_recording([](double t) { return 0.16 + 0.004 * std::exp(-t) * std::sin(6 * t); });
  const Outcome settles = NeverSettles{kX, 0.16, 0.001, 3s}.judge(decay);
  CHECK_FALSE(settles.held);
  CHECK(settles.margin < 0);
}

TEST_CASE("band: the margin is the distance to the nearer bound, and says when", "[check]") {
  const Recording recording = make_recording([](double t) { return t < 4 ? 0.1 : 0.18; });
  const Outcome held = Band{kX, 0.05, 0.2, {}}.judge(recording);
  CHECK(held.held);
  CHECK(held.margin == Approx(0.02));
  CHECK(*held.at_s == Approx(4.0));
  CHECK(held.unit == "m");
  const Outcome above = Band{kX, {}, 0.17, {}}.judge(recording);
  CHECK_FALSE(above.held);
  CHECK(above.margin == Approx(-0.01));
  CHECK(Band{kX, {}, 0.17, {Instant{}, at_s(3.99)}}.judge(recording).held);
  CHECK(Band{kX, {}, 0.18, {}}.judge(recording).margin == 0.0);
}

TEST_CASE("band: a window without rows and a row without a value fail", "[check]") {
  const Recording recording = make_recording([](double t) { return t == 5.0 ? kNaN : 0.1; });
  CHECK_FALSE(Band{kX, 0.0, 1.0, {at_s(11), at_s(12)}}.judge(recording).held);
  const Outcome hole = Band{kX, 0.0, 1.0, {}}.judge(recording);
  CHECK_FALSE(hole.held);
  CHECK(std::isinf(hole.margin));
  CHECK(*hole.at_s == Approx(5.0));
}

TEST_CASE("band: the difference of two signals can be judged", "[check]") {
  Recording recording;
  recording.signals = {{"plant.x_m"}, {"controller.x_m"}};
  recording.row_times = {Instant{0s}, Instant{1s}};
  recording.values = {0.10, 0.11, 0.16, 0.13};
  const Outcome outcome = Band{{"plant.x_m", "controller.x_m"}, -0.02, 0.02, {}}.judge(recording);
  CHECK_FALSE(outcome.held);
  CHECK(outcome.margin == Approx(-0.01));
}

TEST_CASE("overshoot: counted in the direction from the first value to the target", "[check]") {
  const Recording up = make_recording([](double t) { return t < 5 ? 0.1 : t < 6 ? 0.163 : 0.16; });
  const Outcome over = Overshoot{kX, 0.16, 0.001, {}}.judge(up);
  CHECK_FALSE(over.held);
  CHECK(over.margin == Approx(-0.002));
  CHECK(*over.at_s == Approx(5.0));
  // Seen from 0.163 the target lies below, and nothing goes below it.
  const Outcome down = Overshoot{kX, 0.16, 0.001, {at_s(5), Instant::never()}}.judge(up);
  CHECK(down.held);
  CHECK(down.margin == Approx(0.001));
  CHECK(Overshoot{kX, 0.2, 0.0, {}}.judge(up).margin == 0.0);
}

TEST_CASE("overshoot: from a start on the target both directions count", "[check]") {
  const Recording recording = make_recording([](double t) { return t < 5 ? 0.16 : 0.15; });
  CHECK(Overshoot{kX, 0.16, 0.001, {}}.judge(recording).margin == Approx(-0.009));
}

TEST_CASE("peak_to_peak: span of the window against both bounds", "[check]") {
  const Recording recording = make_recording([](double t) { return t < 5 ? 0.0 : 0.16 + 0.004 * std::sin(20 * t); });
  const Window late{at_s(6), Instant::never()};
  CHECK(PeakToPeak{kX, 0.007, 0.009, late}.judge(recording).held);
  CHECK_FALSE(PeakToPeak{kX, 0.0085, {}, late}.judge(recording).held);
  CHECK_FALSE(PeakToPeak{kX, {}, 0.009, {}}.judge(recording).held);
}

TEST_CASE("response: the first crossing counts, from either side", "[check]") {
  const Recording recording = make_recording(rise);
  // 0.16 (1 - e^-t) = 0.08 at t = ln 2 = 0.693 s, seen in the row of 0.70 s.
  const Outcome up = Response{kX, 0.08, Instant{}, at_s(1), Instant{}}.judge(recording);
  CHECK(up.held);
  CHECK(up.margin == Approx(0.3));
  CHECK_FALSE(Response{kX, 0.08, Instant{}, at_s(1), at_s(0.8)}.judge(recording).held);
  CHECK_FALSE(Response{kX, 0.17, Instant{}, at_s(10), Instant{}}.judge(recording).held);
  const Recording falling = make_recording([](double t) { return 1 - t; });
  CHECK(Response{kX, 0.5, Instant{}, at_s(1), Instant{}}.judge(falling).margin == Approx(0.5));
}

TEST_CASE("always and never: margins mirror each other", "[check]") {
  const Recording recording = make_recording(rise);
  const Condition above{kX, 0.05, {}};
  const Outcome always = Always{above, {}, {at_s(1), Instant::never()}}.judge(recording);
  CHECK(always.held);
  CHECK(always.margin == Approx(rise(1.0) - 0.05));
  const Outcome never = Never{above, {}, {at_s(1), Instant::never()}}.judge(recording);
  CHECK_FALSE(never.held);
  CHECK(never.margin == Approx(-(rise(10.0) - 0.05)));
  CHECK(Never{{kX, {}, -0.01}, {}, {}}.judge(recording).margin == Approx(0.01));
  // Between both bounds: true only inside.
  CHECK_FALSE(Never{{kX, 0.05, 0.06}, {}, {}}.judge(recording).held);
}

TEST_CASE("always and never: only the rows of \"during\" are judged, and none is a failure", "[check]") {
  const Recording recording = make_recording(rise);
  const Condition small{kX, {}, 0.1};
  CHECK_FALSE(Always{small, {}, {}}.judge(recording).held);
  CHECK(Always{small, Condition{kX, {}, 0.09}, {}}.judge(recording).held);
  CHECK_FALSE(Always{small, Condition{kX, 5.0, {}}, {}}.judge(recording).held);
  CHECK_FALSE(Never{small, Condition{kX, 5.0, {}}, {}}.judge(recording).held);
}

TEST_CASE("Missing signal: skipped where the bench cannot look into the part, else failed with the nearest name",
          "[check]") {
  Recording recording = make_recording(rise);
  const Outcome missing = Band{{"plant.y_m", ""}, 0.0, 1.0, {}}.judge(recording);
  CHECK_FALSE(missing.held);
  CHECK(missing.skipped.empty());
  CHECK(missing.text.find("plant.x_m") != std::string::npos);
  recording.info.unseen = {"plant"};
  const Outcome skipped = Band{{"plant.y_m", ""}, 0.0, 1.0, {}}.judge(recording);
  CHECK(skipped.held);
  CHECK_FALSE(skipped.skipped.empty());
  CHECK_FALSE(Band{{"plants.y_m", ""}, 0.0, 1.0, {}}.judge(recording).held);
}

TEST_CASE("Missing events: a check on those of a part that the bench cannot look into is skipped", "[check]") {
  Recording recording = make_recording(rise);
  recording.info.unseen = {"controller"};
  CHECK_FALSE(EventOccurs{"running", "controller", {}, {}}.judge(recording).skipped.empty());
  CHECK(EventOccurs{"running", "plant", {}, {}}.judge(recording).skipped.empty());
  const Moment boot{Moment::OnEvent{"ready", "controller"}};
  const Outcome reaction = Reaction{boot, Moment{Moment::At{Instant{1s}}}, 1s, false}.judge(recording);
  CHECK(reaction.held);
  CHECK_FALSE(reaction.skipped.empty());
}

namespace {

/// SYNC every 10 ms for 1 s; the 50th comes 3 ms late.
Recording make_sync() {
  Recording recording;
  for (int i = 0; i < 100; ++i) {
    recording.frames.push_back(Instant{i * 10ms + (i == 50 ? 3ms : 0ms)}, can::make_frame(0x80, {}), 1);
  }
  recording.ending.at = Instant{1s};
  return recording;
}

}  // namespace

TEST_CASE("frame_period: the worst gap decides, and says when", "[check]") {
  const Recording recording = make_sync();
  const Outcome strict = FramePeriod{0x80, 10ms, 1ms, 100, {}}.judge(recording);
  CHECK_FALSE(strict.held);
  CHECK(strict.margin == Approx(-0.002));
  CHECK(FramePeriod{0x80, 10ms, 3ms, 100, {}}.judge(recording).held);
  // Two of 99 gaps are off, so 97 % of them are exact.
  CHECK(FramePeriod{0x80, 10ms, 0ms, 97, {}}.judge(recording).held);
  CHECK_FALSE(FramePeriod{0x80, 10ms, 0ms, 99, {}}.judge(recording).held);
  CHECK(FramePeriod{0x80, 10ms, 0ms, 100, {at_s(0.6), Instant::never()}}.judge(recording).held);
}

TEST_CASE("frame_period: a sender that falls silent or never speaks fails", "[check]") {
  Recording recording = make_sync();
  recording.ending.at = Instant{2s};
  const Outcome silent = FramePeriod{0x80, 10ms, 5ms, 100, {}}.judge(recording);
  CHECK_FALSE(silent.held);
  CHECK(silent.margin == Approx(0.005 - (1.01 - 0.01)));
  CHECK_FALSE(FramePeriod{0x81, 10ms, 5ms, 100, {}}.judge(recording).held);
}

TEST_CASE("bus_load: share of the wire's time in the busiest stretch, stuff bits and interframe spaces counted",
          "[check]") {
  Recording recording;
  recording.info.bit_rate_bit_per_s = 500'000;
  recording.ending.at = Instant{1s};
  // 080# takes 51 bits of 2 us: 102 us. One every 10 ms, and ten more from 500 ms on, 1 ms apart.
  for (int i = 0; i < 100; ++i) {
    recording.frames.push_back(Instant{i * 10ms}, can::make_frame(0x080, {}), 0);
    for (int j = 1; i == 50 && j <= 9; ++j) {
      recording.frames.push_back(Instant{500ms + j * 1ms}, can::make_frame(0x080, {}), 0);
    }
  }
  const Outcome outcome = BusLoad{0.1, 10ms, {}}.judge(recording);
  CHECK_FALSE(outcome.held);  // Ten frames in 10 ms, the space behind the last one (6 us) outside: 10.14 %.
  CHECK(outcome.margin == Approx(0.1 - 0.1014));
  CHECK(outcome.at_s == Approx(0.509));
  CHECK(BusLoad{0.1, 100ms, {}}.judge(recording).margin == Approx(0.1 - (19 * 102e-6 - 6e-6) / 0.1));
  CHECK(BusLoad{0.1, 10ms, {Instant{600ms}, Instant::never()}}.judge(recording).margin == Approx(0.1 - 0.0096));
  recording.info.bit_rate_bit_per_s.reset();
  CHECK_FALSE(BusLoad{1, 10ms, {}}.judge(recording).held);
}

TEST_CASE("frame_jitter: longest minus shortest gap", "[check]") {
  const Recording recording = make_sync();
  // 13 ms before and 7 ms after the late one.
  const Outcome outcome = FrameJitter{0x80, 5ms, 100, {}}.judge(recording);
  CHECK_FALSE(outcome.held);
  CHECK(outcome.margin == Approx(-0.001));
  CHECK(FrameJitter{0x80, 0ms, 98, {}}.judge(recording).held);
}

namespace {

/// Commands at 1 s and 2 s, answered after 4 ms and 9 ms; an event at 1.5 s; x crosses 0.5 at 1.6 s.
Recording make_dialogue() {
  Recording recording;
  const auto say = [&](Nanos at, std::uint32_t id, std::initializer_list<std::uint8_t> data) {
    recording.frames.push_back(Instant{at}, can::make_frame(id, data), 0);
  };
  say(1000ms, 0x605, {0x40, 0x00, 0x10});
  say(1004ms, 0x585, {0x43, 0x00, 0x10});
  say(2000ms, 0x605, {0x40, 0x18, 0x10});
  say(2009ms, 0x585, {0x43, 0x18, 0x10});
  recording.events.push_back({"plant", {Instant{1500ms}, Severity::kInfo, "watchdog", ""}});
  recording.signals = {{"plant.x_m"}};
  for (int i = 0; i <= 30; ++i) {
    recording.row_times.push_back(Instant{i * 100ms});
    recording.values.push_back(i < 16 ? 0.0 : 1.0);
  }
  recording.ending.at = Instant{3s};
  return recording;
}

const Moment kAsk{Moment::OnFrame{0x605, {}}};
const Moment kAnswer{Moment::OnFrame{0x585, {}}};

}  // namespace

TEST_CASE("reaction: first or every cause, from frame to frame", "[check]") {
  const Recording recording = make_dialogue();
  CHECK(Reaction{kAsk, kAnswer, 5ms, false}.judge(recording).margin == Approx(0.001));
  const Outcome every = Reaction{kAsk, kAnswer, 5ms, true}.judge(recording);
  CHECK_FALSE(every.held);
  CHECK(every.margin == Approx(-0.004));
  CHECK(*every.at_s == Approx(2.0));
  const Moment second_ask{Moment::OnFrame{0x605, {0x40, 0x18}}};
  CHECK(Reaction{second_ask, kAnswer, 10ms, false}.judge(recording).margin == Approx(0.001));
  const Moment any_then_18{Moment::OnFrame{0x585, {std::nullopt, 0x18}}};
  CHECK(Reaction{kAsk, any_then_18, 2s, false}.judge(recording).margin == Approx(2 - 1.009));
}

TEST_CASE("reaction: events, signals and instants are moments too", "[check]") {
  const Recording recording = make_dialogue();
  const Moment watchdog{Moment::OnEvent{"watchdog", "plant"}};
  const Moment high{Moment::OnSignal{kX, 0.5, {}}};
  CHECK(Reaction{watchdog, high, 200ms, false}.judge(recording).margin == Approx(0.1));
  CHECK(Reaction{Moment{Moment::At{Instant{1s}}}, watchdog, 1s, false}.judge(recording).margin == Approx(0.5));
}

TEST_CASE("reaction: no cause fails, no effect fails", "[check]") {
  const Recording recording = make_dialogue();
  const Moment other{Moment::OnEvent{"watchdog", "controller"}};
  CHECK_FALSE(Reaction{other, kAnswer, 5ms, false}.judge(recording).held);
  const Outcome unanswered = Reaction{kAsk, other, 500ms, false}.judge(recording);
  CHECK_FALSE(unanswered.held);
  CHECK(unanswered.margin == Approx(-1.5));
  // Even if the run ended before the reaction was due, one must be seen.
  const Outcome undecided = Reaction{kAsk, other, 3600s, false}.judge(recording);
  CHECK_FALSE(undecided.held);
  CHECK(undecided.margin < 0);
}

TEST_CASE("event: at least once, exactly n times, never, in a window", "[check]") {
  const Recording recording = make_dialogue();
  CHECK(EventOccurs{"watchdog", "", {}, {}}.judge(recording).held);
  CHECK(EventOccurs{"watchdog", "plant", 1, {}}.judge(recording).held);
  CHECK_FALSE(EventOccurs{"watchdog", "controller", {}, {}}.judge(recording).held);
  CHECK_FALSE(EventOccurs{"watchdog", "", 0, {}}.judge(recording).held);
  CHECK(EventOccurs{"watchdog", "", 0, {Instant{2s}, Instant::never()}}.judge(recording).held);
  CHECK(EventOccurs{"watchdog", "", 3, {}}.judge(recording).margin == -2.0);
}

}  // namespace meltbench::check
