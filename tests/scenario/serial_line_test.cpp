#include <catch2/catch.hpp>
#include <functional>
#include <memory>

#include "bench/bus/virtual_time.hpp"
#include "controller/machine/controller.hpp"
#include "plant_emulator/emulator.hpp"
#include "protocols/config/toml.hpp"

using namespace meltbench;

namespace {

/// The extruder with its feeder on a line, both programs as objects, and somebody at the plug.
class SerialRun final : public bus::RunObserver {
 public:
  SerialRun() : ports_{&controller_port_, &plant_port_} {}

  std::vector<std::pair<Instant, std::function<void(bus::VirtualTime&)>>> timeline;  ///< In the order of time.
  std::vector<Event> events;
  double x_m = 0;
  double feed_kg_per_h = 0;

  void run(Nanos duration) {
    bus::VirtualTime time{ports_, 10ms, *this, {.lines = rig_.lines}};
    time_ = &time;
    REQUIRE(time.run(duration).kind == bus::RunOutcome::Kind::kCompleted);
  }
  [[nodiscard]] const Event* find(std::string_view code) const {
    for (const Event& event : events) {
      if (event.code == code) return &event;
    }
    return nullptr;
  }
  [[nodiscard]] std::size_t count(std::string_view code) const {
    return static_cast<std::size_t>(
        std::count_if(events.begin(), events.end(), [&](const Event& event) { return event.code == code; }));
  }

 private:
  void on_frame(const can::StampedFrame&, std::size_t) override {}
  void on_event(std::size_t, const Event& event) override { events.push_back(event); }
  void on_row(Instant at, std::span<const double> values) override {
    const std::size_t of_controller = controller_.signals().size();
    for (std::size_t i = 0; i < plant_.signals().size(); ++i) {
      if (plant_.signals()[i].name == "plant.x_m") x_m = values[of_controller + i];
      if (plant_.signals()[i].name == "plant.feed_kg_per_s") feed_kg_per_h = 3600 * values[of_controller + i];
    }
    for (; next_ < timeline.size() && timeline[next_].first <= at; ++next_) timeline[next_].second(*time_);
  }

  config::Section root_{
      config::read_toml_file(std::string{MELTBENCH_SOURCE_DIR} + "/fixtures/rigs/bizone_serial.toml")};
  config::Rig rig_ = config::read_rig(root_);
  machine::Controller controller_{machine::read_settings(root_)};
  emulator::Emulator plant_{emulator::read_settings(root_, rig_), 1};
  runtime::InProcessPort controller_port_{controller_}, plant_port_{plant_};
  std::vector<runtime::ParticipantPort*> ports_;
  bus::VirtualTime* time_ = nullptr;
  std::size_t next_ = 0;
};

constexpr std::size_t kController = 0, kPlant = 1;

}  // namespace

TEST_CASE("Serial line: the feeder's cable is pulled and put in again", "[cli][serial]") {
  SerialRun run;
  run.timeline = {{Instant{30s}, [](bus::VirtualTime& time) { time.plug_line(kPlant, 0, false); }},
                  {Instant{40s}, [](bus::VirtualTime& time) { time.plug_line(kPlant, 0, true); }}};
  run.run(60s);
  const Event* lost = run.find("device-lost");
  REQUIRE(lost != nullptr);
  CHECK(lost->at >= Instant{30s});
  CHECK(lost->at < Instant{30'200ms});  // Three requests of 50 ms each.
  const Event* watchdog = run.find("master-lost");
  REQUIRE(watchdog != nullptr);
  CHECK(watchdog->at >= Instant{30'290ms});
  CHECK(watchdog->at <= Instant{30'310ms});  // 300 ms after the last set point.
  const Event* back = run.find("device-back");
  REQUIRE(back != nullptr);
  CHECK(back->at >= Instant{40s});
  CHECK(back->at < Instant{40'200ms});
  CHECK(run.count("master-back") == 1);  // The controller goes on to ask for the safe flow.
  CHECK(run.count("device-lost") == 1);
  CHECK(run.feed_kg_per_h == Approx(3.79).epsilon(0.01));  // v(x*) at nominal speed.
  CHECK(run.x_m == Approx(0.16).margin(0.02));             // The screw fluctuates by 10 % on.
}

TEST_CASE("Serial line: the controller's adapter is pulled and put in again", "[cli][serial]") {
  SerialRun run;
  run.timeline = {{Instant{30s}, [](bus::VirtualTime& time) { time.plug_line(kController, 0, false); }},
                  {Instant{35s}, [](bus::VirtualTime& time) { time.plug_line(kController, 0, true); }}};
  run.run(45s);
  const Event* down = run.find("line-down");
  REQUIRE(down != nullptr);
  CHECK(down->at >= Instant{30s});
  CHECK(down->at < Instant{30'010ms});  // A row of the recording.
  CHECK(down->severity == Severity::kFault);
  CHECK(run.find("line-up") != nullptr);
  CHECK(run.count("master-lost") == 1);
  CHECK(run.count("master-back") == 1);
  CHECK(run.feed_kg_per_h == Approx(3.79).epsilon(0.01));
}

TEST_CASE("Serial line: answers that are lost now and then are asked for again, and the length is held",
          "[cli][serial]") {
  class Noise final : public bus::LineFault {
    Nanos strike(Instant, std::size_t, std::vector<std::uint8_t>& bytes) override {
      if (++pieces_ % 40 == 0) bytes.back() ^= 1U;
      return Nanos{};
    }
    int pieces_ = 0;
  } noise;
  SerialRun run;
  run.timeline = {{Instant{1s}, [&](bus::VirtualTime& time) { time.find_line("dosing")->set_fault(&noise); }}};
  run.run(20s);
  CHECK(run.find("device-lost") == nullptr);
  CHECK(run.find("master-lost") == nullptr);
  CHECK(run.x_m == Approx(0.16).margin(0.0005));
}
