#include <algorithm>
#include <array>
#include <catch2/catch.hpp>
#include <string>
#include <vector>

#include "bench/bus/bit_timed_medium.hpp"
#include "bench/bus/run_observer.hpp"
#include "bench/bus/virtual_time.hpp"
#include "bench/fault/injector.hpp"
#include "protocols/config/toml.hpp"

using namespace meltbench;

namespace {

/// Sends two frames every 10 ms, 0x181 and 0x182.
class Talker final : public Participant {
 public:
  [[nodiscard]] std::string_view name() const override { return "controller"; }
  void wake(const Wakeup& in, Outbox& out) override {
    for (; next_ <= in.now; next_ += 10ms) {
      out.send(can::make_frame(0x181, {0x11}));
      out.send(can::make_frame(0x182, {0x22}));
    }
    out.wake_at(next_);
  }
  [[nodiscard]] std::span<const SignalInfo> signals() const override { return {}; }
  void read_signals(std::span<double>) const override {}

 private:
  Instant next_{};
};

class Feeder final : public Participant {
 public:
  [[nodiscard]] std::string_view name() const override { return "plant"; }
  [[nodiscard]] std::span<const std::string> nodes() const override { return nodes_; }
  void wake(const Wakeup& in, Outbox& out) override {
    heard.insert(heard.end(), in.frames.begin(), in.frames.end());
    out.wake_at(Instant::never());
  }
  [[nodiscard]] std::span<const SignalInfo> signals() const override { return {}; }
  void read_signals(std::span<double>) const override {}

  std::vector<can::StampedFrame> heard;

 private:
  std::vector<std::string> nodes_{"feeder"};
};

struct Seen final : bus::RunObserver {
  void on_frame(const can::StampedFrame& frame, std::size_t) override { frames.push_back(frame); }
  void on_row(Instant, std::span<const double>) override {}
  void on_event(std::size_t, const Event& event) override { states.push_back(event.text); }

  [[nodiscard]] bool has(const std::string& state) const {
    return std::find(states.begin(), states.end(), state) != states.end();
  }
  [[nodiscard]] std::vector<Instant> errors() const {
    std::vector<Instant> at;
    for (const auto& one : frames) {
      if (one.frame.kind == can::FrameKind::kError) at.push_back(one.at);
    }
    return at;
  }

  std::vector<can::StampedFrame> frames;
  std::vector<can::StampedFrame> heard;  ///< By the feeder.
  std::vector<std::string> states;
};

/// A run with one fault on the bit-timed bus, 500 kbit/s.
Seen run(const std::string& text, Nanos duration = 95ms, std::uint64_t seed = 1) {
  const config::Section root{config::read_toml_file(MELTBENCH_SOURCE_DIR "/fixtures/rigs/bizone.toml")};
  config::Rig rig = config::read_rig(root);
  rig.bus.fidelity = config::BusFidelity::kBitTimed;
  Talker talker;
  Feeder feeder;
  runtime::InProcessPort first{talker}, second{feeder};
  const std::array<std::string_view, 2> names{"controller", "plant"};
  std::vector<fault::Fault> faults;
  if (!text.empty()) faults.push_back(fault::read_live_fault(text, fault::Scope{rig, "bizone"}));
  fault::Injector::Setup setup;
  setup.seed = seed;
  setup.participants = names;
  setup.emulator = 1;
  setup.report = [](const Event&) {};
  fault::Injector injector{std::move(faults), setup};
  const std::array<runtime::ParticipantPort*, 2> ports{&first, &second};
  Seen seen;
  bus::RunMedia media;
  media.intervention = &injector;
  media.bit_timed = bus::to_settings(rig.bus);
  REQUIRE(bus::VirtualTime{ports, 10ms, seen, media}.run(duration).kind == bus::RunOutcome::Kind::kCompleted);
  seen.heard = feeder.heard;
  return seen;
}

}  // namespace

TEST_CASE("Each fault of the bit-timed wire does what its name says", "[fault]") {
  const auto on = [](const std::string& text) { return run(text + "\nat_s = 0.015"); };
  REQUIRE(run("").heard.size() == 20);  // Four of them before 15 ms.

  const Seen shorted = on("target = 'bus'\nkind = 'short_circuit'");
  CHECK(shorted.heard.size() == 4);
  CHECK(shorted.has("controller is bus-off"));

  const Seen dominant = on("target = 'bus'\nkind = 'stuck_dominant'");
  CHECK(dominant.heard.size() == 4);
  CHECK(dominant.has("feeder is error-passive"));

  const Seen noisy = on("target = 'bus'\nkind = 'noise'\nbit_error_rate = 0.01");
  CHECK_FALSE(noisy.errors().empty());
  CHECK(noisy.heard.size() == 20);  // Repeated until they came through.

  const Seen alone = on("target = 'bus.feeder'\nkind = 'open_circuit'");
  CHECK(alone.heard.size() == 4);
  CHECK(alone.has("controller is error-passive"));  // Nobody acknowledges,
  CHECK_FALSE(alone.has("controller is bus-off"));  // which is no reason to leave.

  const Seen babbling = on("target = 'bus.feeder'\nkind = 'babble'");
  CHECK(babbling.heard.size() == 4);
  const auto zeros = std::count_if(babbling.frames.begin(), babbling.frames.end(),
                                   [](const auto& one) { return one.frame.id == 0 && one.frame.length == 8; });
  CHECK(zeros > 200);  // 80 ms at 500 kbit/s, 133 bits each: 300.

  const Seen slow = on("target = 'bus.feeder'\nkind = 'wrong_bit_rate'");
  CHECK(slow.heard.size() < 20);
  CHECK_FALSE(slow.errors().empty());

  const Seen off = on("target = 'bus.feeder'\nkind = 'bus_off'\nfor_s = 0.03");
  CHECK(off.has("feeder is bus-off"));
  CHECK(off.has("feeder is error-active again"));
  CHECK(off.heard.back().at > Instant{90ms});
}

TEST_CASE("On the bit-timed wire frames are corrupted by count, by chance, and for a while; each is repeated",
          "[fault]") {
  const std::string text = "target = 'frame'\nkind = 'corrupt'\nid = 0x181\nat_s = 0\n";
  CHECK(run(text, 1s).errors().size() == 1);
  CHECK(run(text + "count = 7", 1s).errors().size() == 7);
  const Seen chance = run(text + "probability = 0.25", 1s);
  CHECK(chance.heard.size() == 200);  // Those of the last instant are still on their way.
  // 100 frames come through, each after a geometric number of failures: 33 in all, standard deviation 7.
  CHECK(chance.errors().size() > 5);
  CHECK(chance.errors().size() < 70);
  CHECK(chance.frames == run(text + "probability = 0.25", 1s).frames);
  CHECK(chance.frames != run(text + "probability = 0.25", 1s, 2).frames);
  const Seen brief = run(text + "probability = 0.25\nfor_s = 0.2", 1s);
  REQUIRE_FALSE(brief.errors().empty());
  CHECK(brief.errors().back() < Instant{201ms});
}
