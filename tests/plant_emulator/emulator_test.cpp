#include "plant_emulator/emulator.hpp"

#include <catch2/catch.hpp>
#include <cmath>
#include <cstdlib>
#include <new>
#include <string>

#include "plant_emulator/model/bizone_extruder.hpp"
#include "protocols/canopen/manager.hpp"
#include "protocols/canopen/types.hpp"
#include "protocols/config/toml.hpp"
#include "tests/plant_emulator/read_emulator.hpp"
#include "tests/tools/allocation_counter.hpp"

using namespace meltbench;
using emulator::Emulator;
using namespace emulator::testing;

namespace {

constexpr std::uint8_t kFeeder = 5, kScrew = 6, kPressure = 7;

std::string make_rig(std::string_view plant, std::string_view feeder = {}, std::string_view more = {}) {
  const std::string boards = std::string{MELTBENCH_SOURCE_DIR} + "/fixtures/boards/";
  std::string text = "[rig]\nname = 'test'\n[plant]\n";
  text.append(plant).append("\n");
  text += "[controller]\nnode_id = 127\n";
  text += "[board.feeder]\nkind = 'feeder'\nnode_id = 5\neds = '" + boards + "feeder.eds'\n";
  text.append(feeder).append("\n");
  text += "[board.screw]\nkind = 'screw_drive'\nnode_id = 6\neds = '" + boards + "screw_drive.eds'\n";
  text += "[board.pressure]\nkind = 'melt_pressure'\nnode_id = 7\neds = '" + boards + "melt_pressure.eds'\n";
  text.append(more).append("\n");
  return text;
}

/// A driver in virtual time and a master that knows nothing of our code: raw frames only.
class Wire {
 public:
  explicit Wire(const std::string& rig = make_rig(""), std::uint64_t seed = 1)
      : settings{read(rig)}, emulator{settings, seed} {
    wake({});
  }

  void run_to(Instant to) {
    while (out_.deadline() <= to) {
      now = std::max(now, out_.deadline());
      wake({});
    }
    if (to > now) {
      now = to;
      wake({});
    }
  }
  void send(std::uint32_t id, std::initializer_list<std::uint8_t> data) { send(can::make_frame(id, data)); }
  void send(const can::CanFrame& frame) {
    const can::StampedFrame stamped{now, frame};
    wake({&stamped, 1});
  }
  void sync() { send(0x080, {}); }
  void send_set_point(float kg_per_h) {
    can::CanFrame frame = can::make_frame(0x200 + kFeeder, {0, 0, 0, 0});
    canopen::store(std::span{frame.bytes}, 0, kg_per_h);
    send(frame);
  }
  [[nodiscard]] std::optional<can::CanFrame> last(std::uint32_t id) const {
    for (auto frame = sent.rbegin(); frame != sent.rend(); ++frame) {
      if (frame->frame.id == id) return frame->frame;
    }
    return std::nullopt;
  }
  [[nodiscard]] double signal(std::string_view name) const { return read_signal(emulator, name); }
  [[nodiscard]] Instant deadline() const { return out_.deadline(); }
  [[nodiscard]] const plant::BizoneParameters& bizone() const {
    return std::get<plant::BizoneParameters>(settings.plant);
  }

  emulator::EmulatorSettings settings;
  Emulator emulator;
  Instant now{};
  std::vector<can::StampedFrame> sent;
  std::vector<Event> events;

 private:
  void wake(std::span<const can::StampedFrame> frames) {
    out_.clear();
    emulator.wake({now, frames, LinkState::kUp}, out_);
    for (const can::CanFrame& frame : out_.frames()) sent.push_back({now, frame});
    for (const Event& event : out_.events()) events.push_back(event);
  }
  Outbox out_;
};

template <class T>
T field(const can::CanFrame& frame, std::size_t at) {
  return canopen::load<T>(std::span<const std::uint8_t>{frame.bytes}, at);
}

}  // namespace

TEST_CASE("Emulator: boots its boards at the start, and then needs no wake-up until it is asked for something",
          "[emulator]") {
  Wire wire;
  REQUIRE(wire.sent.size() == 3);
  for (const std::uint8_t node : {kFeeder, kScrew, kPressure}) {
    const can::CanFrame boot_up = wire.last(0x700U + node).value();
    CHECK(boot_up.length == 1);
    CHECK(boot_up.bytes[0] == 0x00);
  }
  CHECK(wire.deadline() == Instant::never());
}

TEST_CASE("Emulator: a stranger's master identifies a board, remaps its PDO and gets data", "[emulator]") {
  Wire wire;
  const auto sdo = [&](std::initializer_list<std::uint8_t> request) {
    const std::size_t before = wire.sent.size();
    wire.send(0x600 + kPressure, request);
    REQUIRE(wire.sent.size() > before);  // Answered in the same instant.
    return wire.last(0x580 + kPressure).value();
  };
  const can::CanFrame type = sdo({0x40, 0x00, 0x10, 0x00, 0, 0, 0, 0});
  CHECK(type.bytes[0] == 0x43);
  CHECK(field<std::uint32_t>(type, 4) == 0x0002'0194);
  CHECK(sdo({0x40, 0x18, 0x10, 0x04, 0, 0, 0, 0}).bytes[0] == 0x43);

  // The remap rule: PDO off, mapping closed, one entry (6130:1, REAL32 in bar), opened, type 1, on.
  constexpr std::uint8_t kWritten = 0x60;
  CHECK(sdo({0x23, 0x00, 0x18, 0x01, 0x87, 0x01, 0x00, 0xC0}).bytes[0] == kWritten);
  CHECK(sdo({0x2F, 0x00, 0x18, 0x02, 0x01, 0, 0, 0}).bytes[0] == kWritten);
  CHECK(sdo({0x2F, 0x00, 0x1A, 0x00, 0x00, 0, 0, 0}).bytes[0] == kWritten);
  CHECK(sdo({0x23, 0x00, 0x1A, 0x01, 0x20, 0x01, 0x30, 0x61}).bytes[0] == kWritten);
  CHECK(sdo({0x2F, 0x00, 0x1A, 0x00, 0x01, 0, 0, 0}).bytes[0] == kWritten);
  CHECK(sdo({0x23, 0x00, 0x18, 0x01, 0x87, 0x01, 0x00, 0x40}).bytes[0] == kWritten);
  CHECK(sdo({0x2B, 0x17, 0x10, 0x00, 0x64, 0x00, 0, 0}).bytes[0] == kWritten);  // Heartbeat every 100 ms.

  wire.sync();
  CHECK_FALSE(wire.last(0x180 + kPressure));  // Pre-operational: no PDO.
  wire.send(0x000, {0x01, kPressure});
  wire.run_to(Instant{150ms});
  CHECK(wire.last(0x700 + kPressure)->bytes[0] == 0x05);
  wire.sync();
  const can::CanFrame data = wire.last(0x180 + kPressure).value();
  REQUIRE(data.length == 4);
  CHECK(static_cast<double>(field<float>(data, 0)) * 1e5 == Approx(wire.signal("plant.pressure_Pa")).margin(2));
  CHECK_FALSE(wire.last(0x180 + kFeeder));  // Only the one node was started.
}

TEST_CASE("Emulator: stays in balance until something is asked of it", "[emulator]") {
  Wire wire{make_rig("preset = 'slow'\nfluctuation_case = 'none'")};
  wire.run_to(Instant{60s});
  // The start flow is a REAL32: 6e-8 of it at most, times 1/v'(x0) = 0.7 m.
  CHECK(wire.signal("plant.x_m") == Approx(0.1).margin(1e-8));
  CHECK(wire.signal("plant.mass_residual_m") == Approx(0).margin(1e-8));
  CHECK(wire.signal("plant.rejected_feed_kg") == 0.0);
}

TEST_CASE("Emulator: the plant gets each flow at the instant that the feeder reports, whoever looks when",
          "[emulator]") {
  Wire wire{make_rig("preset = 'slow'\nfluctuation_case = 'A'", "watchdog_ms = 0")};
  wire.send(0x000, {0x01, 0x00});
  plant::BizoneExtruder twin{wire.bizone()};
  float flow = static_cast<float>(twin.parameters().holding_feed_kg_per_s(0.1) * 3600);
  twin.set_feed_kg_per_s(static_cast<double>(flow) / 3600);
  for (int k = 1; k <= 2000; ++k) {
    wire.run_to(Instant{k * 10ms});
    wire.sync();
    const can::CanFrame report = wire.last(0x180 + kFeeder).value();
    if (const float reported = field<float>(report, 0); reported != flow) {
      twin.advance_to(wire.now - field<std::uint16_t>(report, 4) * 10us);
      flow = reported;
      twin.set_feed_kg_per_s(static_cast<double>(flow) / 3600);
    }
    wire.send_set_point(2.0F + static_cast<float>((k / 50) % 7));
  }
  twin.advance_to(wire.now);
  // The steps differ, so U's mean over a step in which c changes by less than 0.1 % does: 1e-3 squared, times the way.
  CHECK(wire.signal("plant.x_m") == Approx(twin.x_m()).margin(1e-7));
  CHECK(std::abs(twin.x_m() - 0.1) > 0.01);  // It has moved.
}

TEST_CASE("Emulator: the pressure report is the plant's pressure at SYNC minus its age", "[emulator]") {
  Wire wire{make_rig("preset = 'phys'\nfluctuation_case = 'B'")};  // The pressure swings by 40 % at 0.8 rad/s.
  wire.send(0x000, {0x01, 0x00});
  plant::BizoneExtruder twin{wire.bizone()};
  for (int k = 1; k <= 500; ++k) {
    wire.run_to(Instant{k * 10ms});
    wire.sync();
    const can::CanFrame report = wire.last(0x180 + kPressure).value();
    twin.advance_to(wire.now - field<std::uint16_t>(report, 5) * 1us);
    REQUIRE(field<std::int32_t>(report, 0) == Approx(twin.pressure_Pa()).margin(0.6));  // Rounded to 1 Pa.
  }
}

TEST_CASE("Emulator: the encoder follows the fluctuation on the screw, and not slip", "[emulator]") {
  const std::string place = GENERATE("screw", "slip");
  Wire wire{make_rig("preset = 'phys'\nfluctuation_on = '" + place + "'")};
  wire.send(0x000, {0x01, 0x00});
  wire.run_to(Instant{390ms});  // c is at its largest slope from the mean: the position leads by eps/omega.
  wire.sync();
  const double shown_m = field<std::int32_t>(wire.last(0x380 + kScrew).value(), 0) / 65536.0 * 0.01;
  const double mean_m = 0.015 * 0.39;
  const double swing_m = 0.015 * 0.1 / 4.0 * std::sin(4.0 * 0.39);
  CHECK(shown_m == Approx(mean_m + (place == "screw" ? swing_m : 0.0)).margin(0.01 / 65536));  // One increment.
}

TEST_CASE("Emulator: equal seeds give equal frames, another seed other phases", "[emulator]") {
  const auto run = [](std::uint64_t seed) {
    Wire wire{make_rig("", "weight_noise_kg = 0.01"), seed};
    wire.send(0x000, {0x01, 0x00});
    for (int k = 1; k <= 300; ++k) {
      wire.run_to(Instant{k * 10ms});
      wire.sync();
      wire.send_set_point(3.0F + 0.01F * static_cast<float>(k));
    }
    return wire.sent;
  };
  const auto one = run(1);
  CHECK(one == run(1));
  CHECK(one != run(2));
}

TEST_CASE("Emulator: a killed master is survived at the open-loop rate, and every board says what it saw",
          "[emulator]") {
  Wire wire;
  wire.send(0x000, {0x01, 0x00});
  wire.send(0x77F, {0x05});
  for (const std::uint8_t node : {kFeeder, kScrew}) {  // 1016:1 = node 127, 100 ms.
    wire.send(0x600U + node, {0x23, 0x16, 0x10, 0x01, 0x64, 0x00, 0x7F, 0x00});
  }
  wire.send(0x77F, {0x05});
  wire.send_set_point(8.0F);
  wire.run_to(Instant{3s});
  const double hold_kg_per_h = wire.bizone().holding_feed_kg_per_s(0.16) * 3600;
  CHECK(wire.signal("feeder.flow_kg_per_h") == Approx(hold_kg_per_h).epsilon(1e-6));
  CHECK(wire.signal("feeder.master_lost") == 1.0);
  CHECK(wire.last(0x080 + kFeeder));
  CHECK(field<std::uint16_t>(wire.last(0x080 + kScrew).value(), 0) == 0x8130);
  CHECK(wire.signal("screw.actual_rpm") == Approx(wire.signal("plant.speed_m_per_s") * 6000).epsilon(1e-9));
  CHECK(wire.signal("screw.actual_rpm") > 80.0);  // 6007 = 0: the screw goes on.
  CHECK(std::any_of(wire.events.begin(), wire.events.end(), [](const Event& event) {
    return event.code == "master-lost" && event.severity == Severity::kWarning;
  }));
}

TEST_CASE("Emulator: boards hear each other", "[emulator]") {
  Wire wire;
  wire.send(0x000, {0x01, 0x00});
  wire.send(0x600 + kScrew, {0x2B, 0x17, 0x10, 0x00, 0x32, 0x00, 0, 0});           // Heartbeat every 50 ms.
  wire.send(0x600 + kFeeder, {0x23, 0x16, 0x10, 0x01, 0x64, 0x00, kScrew, 0x00});  // Watched by the feeder, 100 ms.
  wire.run_to(Instant{1s});
  CHECK_FALSE(wire.last(0x080 + kFeeder));
  wire.send(0x600 + kScrew, {0x2B, 0x17, 0x10, 0x00, 0x00, 0x00, 0, 0});
  wire.run_to(Instant{2s});
  CHECK(field<std::uint16_t>(wire.last(0x080 + kFeeder).value(), 0) == 0x8130);
}

TEST_CASE("Emulator: a frame is handled at its own stamp, also when it is read late", "[emulator]") {
  const auto change_of = [](bool late) {
    Wire wire{make_rig("", "sample_time_ms = 0\nlatency_ms = 0")};
    wire.send(0x000, {0x01, 0x00});
    can::CanFrame frame = can::make_frame(0x200 + kFeeder, {0, 0, 0x80, 0x40});  // 4.0
    const can::StampedFrame stamped{Instant{7ms}, frame};
    Outbox out;
    wire.emulator.wake({late ? Instant{9ms} : Instant{7ms}, {&stamped, 1}, LinkState::kUp}, out);
    wire.now = Instant{10ms};
    wire.sync();
    return field<std::uint16_t>(wire.last(0x180 + kFeeder).value(), 4);
  };
  CHECK(change_of(false) == 300);
  CHECK(change_of(true) == 300);
}

TEST_CASE("Emulator: a feeder left at full flow floods the screw, with an event", "[emulator]") {
  Wire wire{make_rig("", "watchdog_ms = 0")};
  wire.send(0x000, {0x01, 0x00});
  wire.send_set_point(13.0F);
  wire.run_to(Instant{20s});
  wire.sync();
  CHECK(wire.signal("plant.x_m") == Approx(0.2));
  CHECK(wire.signal("plant.spill_m") > 0.0);
  CHECK(wire.signal("plant.delay_s") == 0.0);
  CHECK(std::count_if(wire.events.begin(), wire.events.end(),
                      [](const Event& event) { return event.code == "screw-flooded"; }) == 1);
}

TEST_CASE("Emulator: the steady loop does not allocate, with all boards of the coupled extruder neither",
          "[emulator]") {
  const bool coupled = GENERATE(false, true);
  const std::string boards = std::string{MELTBENCH_SOURCE_DIR} + "/fixtures/boards/";
  const std::string more = "[board.inlet]\nkind = 'preconditioner'\nnode_id = 8\neds = '" + boards +
                           "preconditioner.eds'\n[board.camera]\nkind = 'melt_camera'\nnode_id = 9\neds = '" + boards +
                           "melt_camera.eds'\n[board.heater]\nkind = 'heater'\nnode_id = 10\neds = '" + boards +
                           "heater.eds'\n";
  Wire wire{coupled ? make_rig("kind = 'coupled'", "", more) : make_rig("")};
  wire.send(0x000, {0x01, 0x00});
  Outbox out;
  std::vector<double> values(wire.emulator.signals().size());
  can::CanFrame set_point = can::make_frame(0x200 + kFeeder, {0, 0, 0, 0});
  can::CanFrame inlet = can::make_frame(0x208, {0, 0, 0, 0, 0, 0, 0, 0});
  can::CanFrame heater = can::make_frame(0x30A, {0xAA, 0x05, 0x1F});  // 145 degC, all released.
  canopen::store(std::span{inlet.bytes}, 0, 131.9F);
  const auto run = [&](int from, int to) {
    for (int k = from; k < to; ++k) {
      const Instant now{k * 10ms};
      canopen::store(std::span{set_point.bytes}, 0, 3.0F + 0.1F * static_cast<float>(k % 5));
      const can::StampedFrame frames[] = {{now, canopen::make_sync()}, {now, set_point}, {now, inlet}, {now, heater}};
      out.clear();
      wire.emulator.wake({now, frames, LinkState::kUp}, out);
      wire.emulator.read_signals(values);
    }
  };
  run(1, 200);
  const std::uint64_t before = test::count_allocations();
  run(200, 2200);
  CHECK(test::count_allocations() == before);
}

TEST_CASE("Emulator settings: mistakes in the rig are named where they are", "[emulator][settings]") {
  CHECK(complaint(make_rig("")) == "none");
  CHECK_THAT(complaint(make_rig("preset = 'fast'")), Catch::Contains("rig.toml:4:") && Catch::Contains("plant.preset"));
  CHECK_THAT(complaint(make_rig("x0_m = 0.3")), Catch::Contains("plant.x0_m = 0.3"));
  CHECK_THAT(complaint(make_rig("epsilon = 1")), Catch::Contains("plant.epsilon"));
  CHECK_THAT(complaint(make_rig("epsilom = 0.1")), Catch::Contains("epsilom") && Catch::Contains("epsilon"));
  CHECK_THAT(complaint(make_rig("", "latency_ms = -1")), Catch::Contains("board.feeder.latency_ms = -1"));
  CHECK_THAT(complaint(make_rig("", "latency_ms = 0.0005")), Catch::Contains("whole number of microseconds"));
  CHECK_THAT(complaint(make_rig("", "latency_s = 1")), Catch::Contains("latency_s"));
  CHECK_THAT(complaint(make_rig("", "loss_of_master_kg_per_h = 100")), Catch::Contains("loss_of_master_kg_per_h"));
}

TEST_CASE("Emulator settings: an EDS of another kind of board is refused, and so are two of one kind",
          "[emulator][settings]") {
  const std::string boards = std::string{MELTBENCH_SOURCE_DIR} + "/fixtures/boards/";
  const std::string second = "[board.second]\nkind = 'feeder'\nnode_id = 9\neds = '" + boards;
  CHECK_THAT(complaint(make_rig("", "", second + "feeder.eds'")),
             Catch::Contains("twice") && Catch::Contains("feeder"));
  std::string swapped = make_rig("");
  swapped.replace(swapped.find("feeder.eds"), 10, "melt_pressure.eds");
  CHECK_THAT(complaint(swapped), Catch::Contains("board.feeder.eds") && Catch::Contains("must describe a feeder") &&
                                     Catch::Contains("0x2000"));
}

TEST_CASE("Emulator settings: presets and overrides reach the plant", "[emulator][settings]") {
  const auto settings = read(
      make_rig("preset = 'paper'\nfluctuation_case = 'B'\nx0_m = 0.12\nviscosity_Pa_s = 500\nfluctuation_on = 'slip'"));
  const auto& bizone = std::get<plant::BizoneParameters>(settings.plant);
  CHECK(bizone.speed_m_per_s == 0.9);
  CHECK(bizone.fluctuation == 0.4);
  CHECK(bizone.fluctuation_rad_per_s == Approx(0.8));
  CHECK(bizone.delay_reading == plant::DelayReading::kPaper);
  CHECK(bizone.fluctuation_place == plant::FluctuationPlace::kSlip);
  CHECK(bizone.x0_m == 0.12);
  CHECK(bizone.viscosity_Pa_s == 500.0);
  const auto& feeder = std::get<board::FeederSettings>(settings.boards.front().firmware);
  CHECK(feeder.start_flow_kg_per_h == Approx(bizone.holding_feed_kg_per_s(0.12) * 3600));
  CHECK(feeder.loss_of_master_kg_per_h == Approx(bizone.holding_feed_kg_per_s(0.16) * 3600));
}

TEST_CASE("Emulator: a real board is left to itself, and the model beside it tells no truth", "[emulator]") {
  const Wire wire{make_rig("", "part = 'real'")};
  REQUIRE(wire.settings.boards.size() == 2);
  CHECK(wire.settings.boards[0].name == "screw");
  for (const SignalInfo& signal : wire.emulator.signals()) {
    CHECK_FALSE(signal.name.starts_with("plant."));
    CHECK_FALSE(signal.name.starts_with("feeder."));
  }
  CHECK_FALSE(wire.last(0x700 + kFeeder).has_value());
  CHECK(wire.last(0x706).has_value());
}
