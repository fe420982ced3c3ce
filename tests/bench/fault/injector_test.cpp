#include "bench/fault/injector.hpp"

#include <algorithm>
#include <catch2/catch.hpp>
#include <cmath>
#include <memory>
#include <string>
#include <vector>

#include "bench/bus/run_observer.hpp"
#include "bench/bus/virtual_time.hpp"
#include "bench/fault/faulty_port.hpp"
#include "protocols/config/toml.hpp"
#include "protocols/participant/restartable.hpp"

using namespace meltbench;

namespace {

/// Sends one frame 0x181, 0x182 ... every 10 ms, the first when it is started.
class Talker final : public Participant {
 public:
  [[nodiscard]] std::string_view name() const override { return "controller"; }
  void wake(const Wakeup& in, Outbox& out) override {
    if (sent_ == 0) next_ = in.now;
    for (; next_ <= in.now; next_ += 10ms) {
      ++sent_;
      for (std::uint8_t i = 1; i <= 2; ++i) out.send(can::make_frame(0x180U + i, {sent_}));
    }
    out.wake_at(next_);
  }
  [[nodiscard]] std::span<const SignalInfo> signals() const override { return signals_; }
  void read_signals(std::span<double> values) const override { values[0] = sent_; }

 private:
  std::vector<SignalInfo> signals_{{"talker.sent"}};
  std::uint8_t sent_ = 0;
  Instant next_{};
};

/// Keeps what reaches it, by its own clock.
class Listener final : public Participant {
 public:
  [[nodiscard]] std::string_view name() const override { return "plant"; }
  void wake(const Wakeup& in, Outbox& out) override {
    for (const can::StampedFrame& frame : in.frames) heard.push_back(frame);
    for (const std::string& order : in.orders) orders.push_back({in.now, order});
    out.wake_at(Instant::never());
  }
  [[nodiscard]] std::span<const SignalInfo> signals() const override { return {}; }
  void read_signals(std::span<double>) const override {}

  std::vector<can::StampedFrame> heard;
  std::vector<std::pair<Instant, std::string>> orders;
};

class Observer final : public bus::RunObserver {
 public:
  void on_frame(const can::StampedFrame& frame, std::size_t) override { frames.push_back(frame); }
  void on_row(Instant, std::span<const double> values) override { talker.push_back(values.front()); }
  void on_event(std::size_t, const Event&) override {}
  std::vector<can::StampedFrame> frames;
  std::vector<double> talker;  ///< Its signal, every 10 ms.
};

struct Run {
  std::vector<can::StampedFrame> heard;
  std::vector<std::pair<Instant, std::string>> orders;
  std::vector<Event> events;
  std::vector<can::StampedFrame> recorded;
  std::vector<double> talker;
  std::string written;  ///< Its faults, as [[fault]].

  /// Numbers of the frames with this id, in the order in which they came.
  [[nodiscard]] std::vector<int> numbers(std::uint32_t id) const {
    std::vector<int> result;
    for (const can::StampedFrame& one : heard) {
      if (one.frame.id == id) result.push_back(one.frame.bytes[0]);
    }
    return result;
  }
};

const config::Section& rig_root() {
  static const config::Section root{config::read_toml_file(MELTBENCH_SOURCE_DIR "/fixtures/rigs/bizone.toml")};
  return root;
}

const fault::Scope& scope() {
  static const config::Rig rig = config::read_rig(rig_root());
  static const fault::Scope scope{rig, "bizone"};
  return scope;
}

/// What somebody asks of a running bench, at the first instant that is not before `at`.
struct Order {
  Instant at;
  std::string begin;  ///< A fault; empty:
  std::string clear;  ///< the name of one.
};

/// Hands on to the injector, and orders.
class LiveOrders final : public bus::Intervention {
 public:
  LiveOrders(fault::Injector& injector, std::vector<Order> orders) : injector_{injector}, orders_{std::move(orders)} {}
  bool look(Instant now) override {
    bool any = false;
    for (; !orders_.empty() && orders_.front().at <= now; orders_.erase(orders_.begin())) {
      const Order& order = orders_.front();
      if (!order.begin.empty()) injector_.add(fault::read_live_fault(order.begin, scope()), now);
      if (!order.clear.empty()) CHECK(injector_.clear(order.clear, now) == 1);
      any = true;
    }
    return any;
  }
  [[nodiscard]] Instant next_deadline() const override { return injector_.next_deadline(); }
  void on_time(Instant now, bus::RunControl& run) override { injector_.on_time(now, run); }
  [[nodiscard]] bool on_frame(const can::StampedFrame& frame, std::size_t sender, bus::RunControl& run) override {
    return injector_.on_frame(frame, sender, run);
  }
  void on_row(Instant at, std::span<const double> values) override { injector_.on_row(at, values); }

 private:
  fault::Injector& injector_;
  std::vector<Order> orders_;
};

Run run_faults(const std::vector<fault::Fault>& faults, const std::vector<Order>& orders, Nanos duration,
               std::uint64_t seed) {
  Run result;
  Restartable talker{[] { return std::make_unique<Talker>(); }};
  Listener listener;
  runtime::InProcessPort first{talker};
  runtime::InProcessPort second{listener};
  const std::vector<std::string_view> names{"controller", "plant"};
  fault::Injector injector{
      faults, {seed, talker.signals(), names, 1, [&](const Event& event) { result.events.push_back(event); }}};
  fault::FaultyPort faulty_first{first, injector.condition_of(0)};
  fault::FaultyPort faulty_second{second, injector.condition_of(1)};
  const std::vector<runtime::ParticipantPort*> ports{&faulty_first, &faulty_second};
  Observer observer;
  LiveOrders live{injector, orders};
  REQUIRE(bus::VirtualTime{ports, 10ms, observer, {.intervention = &live}}.run(duration).kind ==
          bus::RunOutcome::Kind::kCompleted);
  config::Table written;
  written.set("fault", config::Value{injector.write(), {}});
  result.written = config::write_toml(written);
  result.heard = listener.heard;
  result.orders = listener.orders;
  result.recorded = observer.frames;
  result.talker = observer.talker;
  return result;
}

Run run(const std::vector<std::string>& texts, Nanos duration = 95ms, std::uint64_t seed = 1) {
  std::vector<fault::Fault> faults;
  for (const std::string& text : texts) faults.push_back(fault::read_live_fault(text, scope()));
  return run_faults(faults, {}, duration, seed);
}

std::vector<int> range(int first, int last) {
  std::vector<int> result;
  for (int i = first; i <= last; ++i) result.push_back(i);
  return result;
}

}  // namespace

TEST_CASE("Dropped frames reach nobody, by identifier and for as long as asked", "[fault]") {
  const Run seen = run({"target = 'frame'\nkind = 'drop'\nid = 0x181\nat_s = 0.02\nfor_s = 0.03"});
  CHECK(seen.numbers(0x181) == std::vector<int>{1, 2, 6, 7, 8, 9, 10});
  CHECK(seen.numbers(0x182) == range(1, 10));
  CHECK(seen.recorded.size() == 17);
  REQUIRE(seen.events.size() == 2);
  CHECK(seen.events[0].code == "fault-on");
  CHECK(seen.events[0].at == Instant{20ms});
  CHECK(seen.events[1].code == "fault-off");
  CHECK(seen.events[1].at == Instant{50ms});
  CHECK_THAT(seen.events[1].text, Catch::Contains("hit 3 of 3 frames"));
}

TEST_CASE("A mask takes several identifiers, a count ends the fault", "[fault]") {
  const Run seen = run({"target = 'frame'\nkind = 'drop'\nid = 0x180\nmask = 0x780\ncount = 3\nat_s = 0"});
  CHECK(seen.numbers(0x181) == range(3, 10));
  CHECK(seen.numbers(0x182) == range(2, 10));
}

TEST_CASE("A corrupted frame is lost on the ideal bus: every receiver finds its CRC wrong", "[fault]") {
  const Run seen = run({"target = 'frame'\nkind = 'corrupt'\nid = 0x182\nat_s = 0\ncount = 1"});
  CHECK(seen.numbers(0x182) == range(2, 10));
}

TEST_CASE("A delayed frame comes at its own instant, whatever else goes on", "[fault]") {
  const Run seen = run({"target = 'frame'\nkind = 'delay'\ndelay_ms = 13\nid = 0x181\nat_s = 0\ncount = 1"});
  CHECK(seen.numbers(0x181) == std::vector<int>{2, 1, 3, 4, 5, 6, 7, 8, 9, 10});
  REQUIRE(seen.heard.size() == 20);
  CHECK(seen.heard[3].frame.id == 0x181);
  CHECK(seen.heard[3].at == Instant{13ms});
}

TEST_CASE("A frame comes twice, or behind the one that was sent after it", "[fault]") {
  const Run twice = run({"target = 'frame'\nkind = 'duplicate'\nid = 0x182\nat_s = 0\ncount = 1"});
  CHECK(twice.numbers(0x182) == std::vector<int>{1, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10});
  const Run behind = run({"target = 'frame'\nkind = 'reorder'\nid = 0x181\nat_s = 0\ncount = 1"});
  REQUIRE(behind.heard.size() == 20);
  CHECK(behind.heard[0].frame.id == 0x182);
  CHECK(behind.heard[1].frame.id == 0x181);
  CHECK(behind.heard[1].frame.bytes[0] == 1);
  CHECK(behind.heard[2].frame.id == 0x181);
}

TEST_CASE("The nth frame begins a fault, itself included", "[fault]") {
  const Run seen = run({"target = 'frame'\nkind = 'drop'\nid = 0x181\nat_frame = { id = 0x181, n = 4 }\ncount = 2"});
  CHECK(seen.numbers(0x181) == std::vector<int>{1, 2, 3, 6, 7, 8, 9, 10});
}

TEST_CASE("A signal that crosses a value begins a fault, in the row in which it does", "[fault]") {
  const Run seen =
      run({"target = 'board.feeder'\nkind = 'off'\nwhen = { signal = 'talker.sent', above = 4.5 }\nfor_s = 0.02"});
  REQUIRE(seen.orders.size() == 2);
  CHECK(seen.orders[0].first == Instant{40ms});
  CHECK(seen.orders[1].first == Instant{60ms});
  const auto begins = fault::read_order(seen.orders[0].second);
  const auto ends = fault::read_order(seen.orders[1].second);
  REQUIRE(begins);
  REQUIRE(ends);
  CHECK(begins->begins);
  CHECK_FALSE(ends->begins);
  CHECK(begins->number == ends->number);
  CHECK_THROWS_AS(run({"target = 'frame'\nkind = 'drop'\nwhen = { signal = 'talker.none', above = 1 }"}),
                  config::ConfigError);
}

TEST_CASE("Chance depends on the seeds alone", "[fault]") {
  const std::string text = "target = 'frame'\nkind = 'drop'\nprobability = 0.5\nat_s = 0\nseed = ";
  const Run first = run({text + "1"}, 2s);
  CHECK(first.heard == run({text + "1"}, 2s).heard);
  CHECK(first.heard != run({text + "2"}, 2s).heard);
  CHECK(first.heard != run({text + "1"}, 2s, 2).heard);
  // 402 frames at 1/2: 201 +- 10; five standard deviations.
  CHECK(first.heard.size() > 150);
  CHECK(first.heard.size() < 252);
}

TEST_CASE("A clock that drifts or steps moves its participant alone", "[fault]") {
  const Run fast = run({"target = 'clock.controller'\nkind = 'drift'\ndrift_ppm = 100000\nat_s = 0"}, 1s);
  CHECK(fast.numbers(0x181).size() == 111);  // 1.1 s by its own clock, the first at 0.
  const Run stepped = run({"target = 'clock.plant'\nkind = 'step'\nstep_ms = 5\nat_s = 0.025"});
  REQUIRE(stepped.heard.size() == 20);
  CHECK(stepped.heard[4].at == Instant{20ms});
  CHECK(stepped.heard[6].at == Instant{35ms});
}

TEST_CASE("A killed program says nothing and has no values until it is started again, and then knows nothing",
          "[fault]") {
  const Run seen = run({"target = 'program.controller'\nkind = 'killed'\nat_s = 0.025\nfor_s = 0.03"});
  CHECK(seen.numbers(0x181) == std::vector<int>{1, 2, 3, 1, 2, 3, 4, 5});
  REQUIRE(seen.heard.size() == 16);
  CHECK(seen.heard[6].at == Instant{55ms});
  REQUIRE(seen.talker.size() == 10);
  CHECK(seen.talker[2] == 3);
  CHECK(std::isnan(seen.talker[3]));
  CHECK(std::isnan(seen.talker[5]));
  CHECK(seen.talker[6] == 1);
  const Run twice = run({"target = 'program.controller'\nkind = 'killed'\nat_s = 0.025\nfor_s = 0.03",
                         "target = 'program.controller'\nkind = 'killed'\nat_s = 0.035"});
  CHECK(twice.numbers(0x181) == std::vector<int>{1, 2, 3});
  const Run again = run({"target = 'program.controller'\nkind = 'restart'\nat_s = 0.025"});
  CHECK(again.numbers(0x181) == std::vector<int>{1, 2, 3, 1, 2, 3, 4, 5, 6, 7, 8});
}

TEST_CASE("Another device with a board's node id boots up, or answers SYNC as if it had always been there", "[fault]") {
  const std::string text =
      "target = 'board.melt_pressure'\nkind = 'same_node_id'\nat_s = 0.01\nfor_s = 0.3\nrunning = ";
  const auto count = [](const Run& seen, std::uint32_t id) {
    return std::count_if(seen.heard.begin(), seen.heard.end(), [&](const auto& one) { return one.frame.id == id; });
  };
  const Run booted = run({text + "0"}, 1s);
  CHECK(count(booted, 0x707) == 1);
  CHECK(booted.numbers(0x707) == std::vector<int>{0});
  CHECK(booted.orders.empty());  // The emulator has nothing to do with it.
  const Run running = run({text + "1"}, 1s);
  CHECK(running.numbers(0x707) == std::vector<int>{5, 5});  // Operational, every 100 ms.
  CHECK(running.recorded.size() == running.heard.size());
}

TEST_CASE("Faults that come and go by order are written down so that they happen again at the same instants",
          "[fault]") {
  const std::vector<Order> orders{
      {Instant{13ms}, "target = 'frame', kind = 'drop', probability = 0.5, name = 'chance'", {}},
      {Instant{20ms},
       "target = 'frame', kind = 'delay', delay_ms = 3, id = 0x182, at_frame = { id = 0x181, n = 3 }",
       {}},
      {Instant{30ms},
       "target = 'frame', kind = 'duplicate', when = { signal = 'talker.sent', above = 2 }, for_s = 1",
       {}},
      {Instant{55ms}, {}, "chance"},
      {Instant{60ms}, "target = 'clock.plant', kind = 'step', step_ms = 5, at_s = 0.125", {}},
      {Instant{60ms}, "target = 'board.feeder', kind = 'off', at_s = 0.2, name = 'never'", {}},
      {Instant{90ms}, {}, "never"},
      {Instant{100ms}, {}, "frame delay"},
      {Instant{150ms}, "target = 'frame', kind = 'drop', count = 1", {}},
  };
  const auto of_file =
      fault::read_live_fault("target = 'frame'\nkind = 'reorder'\nprobability = 0.1\nat_s = 0", scope());
  const Run first = run_faults({of_file}, orders, 300ms, 1);
  const config::Section root{std::make_shared<const config::Table>(config::parse_toml(first.written, "written"))};
  const std::vector<fault::Fault> written = fault::read_faults(root, scope());
  REQUIRE(written.size() == 7);
  CHECK(written[1].trigger.at == Instant{20ms});  // The first instant at which somebody was due.
  CHECK(written[1].cleared_at == Instant{60ms});
  CHECK(written[2].trigger.armed_at == Instant{20ms});
  const Run again = run_faults(written, {}, 300ms, 1);
  CHECK(again.heard == first.heard);
  CHECK(again.recorded == first.recorded);
  CHECK(again.orders.empty());  // "never" was cleared before it began.
  const auto list_events = [](const Run& one) {
    std::vector<std::string> texts;
    for (const Event& event : one.events) texts.push_back(std::to_string(to_s(event.at)) + event.code + event.text);
    return texts;
  };
  CHECK(list_events(again) == list_events(first));
  CHECK(again.written == first.written);
}

TEST_CASE("An order for a time that is over is refused, and changes nothing", "[fault]") {
  fault::Injector injector{{}, {}};
  const auto late = fault::read_live_fault("target = 'frame', kind = 'drop', at_s = 1", scope());
  CHECK_THROWS_WITH(injector.add(late, Instant{2s}), Catch::Contains("at_s = 1, is over: the run is at 2 s"));
  const auto unknown =
      fault::read_live_fault("target = 'frame', kind = 'drop', when = { signal = 'x', above = 0 }", scope());
  CHECK_THROWS_WITH(injector.add(unknown, Instant{2s}), Catch::Contains("there is no \"x\""));
  CHECK(injector.standing().empty());
  CHECK(injector.next_deadline() == Instant::never());
  CHECK(injector.clear("frame drop", Instant{2s}) == 0);
}
