#include <algorithm>
#include <array>
#include <catch2/catch.hpp>
#include <cmath>
#include <cstring>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "plant_emulator/emulator.hpp"
#include "protocols/canopen/manager.hpp"
#include "protocols/canopen/types.hpp"
#include "protocols/config/toml.hpp"
#include "protocols/fault/fault.hpp"

using namespace meltbench;

namespace {

constexpr std::uint8_t kFeeder = 5, kScrew = 6, kPressure = 7, kCamera = 9, kHeater = 10;

/// An emulator without a controller, to be given faults: all boards Operational, a SYNC every 10 ms.
class Bench {
 public:
  explicit Bench(const std::string& rig_file, std::string_view more = {}, std::uint64_t seed = 1) {
    config::Table tree = *config::read_toml_file(MELTBENCH_SOURCE_DIR "/fixtures/rigs/" + rig_file);
    merge(tree, config::parse_toml(more, "more"));
    root_ = config::Section{std::make_shared<const config::Table>(std::move(tree))};
    rig_ = config::read_rig(root_);
    emulator_ = std::make_unique<emulator::Emulator>(emulator::read_settings(root_, rig_), seed);
    values_.resize(emulator_->signals().size());
    wake(Wakeup{});
    send(canopen::make_nmt_command(canopen::NmtCommand::kStart, 0));
  }

  /// Begins a fault now. @returns its number.
  std::size_t begin(const std::string& text) {
    faults_.push_back(fault::read_live_fault(text, fault::make_scope(root_, rig_)));
    order(fault::write_order(faults_.size(), true, faults_.back()));
    return faults_.size();
  }
  void end(std::size_t number) { order(fault::write_order(number, false, faults_[number - 1])); }

  /// Runs on, with SYNCs, and with what is sent every cycle.
  void run(Nanos span, const std::vector<can::CanFrame>& every_cycle = {}) {
    const Instant until = now_ + span;
    while (now_ < until) {
      const Instant next = std::min(until, now_ + 10ms);
      while (deadline_ < next) {
        now_ = std::max(deadline_, now_ + 1ns);
        wake(Wakeup{});
      }
      now_ = next;
      std::vector<can::StampedFrame> frames{{now_, canopen::make_sync()}};
      for (const can::CanFrame& frame : every_cycle) frames.push_back({now_, frame});
      Wakeup in;
      in.frames = frames;
      wake(in);
    }
  }
  void send(const can::CanFrame& frame) {
    const can::StampedFrame stamped{now_, frame};
    Wakeup in;
    in.frames = {&stamped, 1};
    wake(in);
  }

  [[nodiscard]] double value(std::string_view name) const {
    for (std::size_t i = 0; i < values_.size(); ++i) {
      if (emulator_->signals()[i].name == name) return values_[i];
    }
    FAIL("no signal " << name);
    return 0;
  }
  [[nodiscard]] std::size_t count(std::uint32_t id) const {
    return static_cast<std::size_t>(
        std::count_if(sent.begin(), sent.end(), [&](const auto& one) { return one.frame.id == id; }));
  }
  [[nodiscard]] Instant now() const { return now_; }

  std::vector<can::StampedFrame> sent;
  std::vector<Event> events;

 private:
  void order(const std::string& text) {
    Wakeup in;
    in.orders = {&text, 1};
    wake(in);
  }
  void wake(Wakeup in) {
    in.now = now_;
    out_.clear();
    emulator_->wake(in, out_);
    deadline_ = out_.deadline();
    for (const can::CanFrame& frame : out_.frames()) sent.push_back({now_, frame});
    events.insert(events.end(), out_.events().begin(), out_.events().end());
    emulator_->read_signals(values_);
  }

  config::Section root_;
  config::Rig rig_;
  std::unique_ptr<emulator::Emulator> emulator_;
  std::vector<fault::Fault> faults_;
  Outbox out_;
  Instant now_;
  Instant deadline_;
  std::vector<double> values_;
};

can::CanFrame feed_command(float kg_per_h) {
  std::array<std::uint8_t, 4> bytes{};
  std::memcpy(bytes.data(), &kg_per_h, 4);
  return can::make_frame(0x200U + kFeeder, bytes);
}

/// As the drive has reported it last.
double position_of(const Bench& bench) {
  for (auto one = bench.sent.rbegin(); one != bench.sent.rend(); ++one) {
    if (one->frame.id != 0x380U + kScrew) continue;
    std::int32_t position_inc = 0;
    std::memcpy(&position_inc, one->frame.bytes.data(), 4);
    return position_inc;
  }
  return 0;
}

}  // namespace

// --- sensors

TEST_CASE("A stuck pressure shows what it was, an offset, drift and noise are added to it", "[fault]") {
  Bench bench{"bizone.toml"};
  bench.run(1s);
  const double before = bench.value("melt_pressure.reading_Pa");
  const auto stuck = bench.begin("target = 'sensor.melt_pressure'\nkind = 'stuck'");
  bench.run(9s, {feed_command(8)});                                              // It takes 6.7 s to get there.
  CHECK(bench.value("melt_pressure.reading_Pa") == Approx(before).margin(100));  // One sample later.
  CHECK(std::abs(bench.value("plant.pressure_Pa") - before) > 1000);
  bench.end(stuck);
  bench.run(50ms);
  CHECK(bench.value("melt_pressure.reading_Pa") == Approx(bench.value("plant.pressure_Pa")).margin(100));

  const auto offset = bench.begin("target = 'sensor.melt_pressure'\nkind = 'offset'\noffset_Pa = 5000");
  bench.run(50ms);
  CHECK(bench.value("melt_pressure.reading_Pa") - bench.value("plant.pressure_Pa") == Approx(5000).margin(100));
  bench.end(offset);
  bench.begin("target = 'sensor.melt_pressure'\nkind = 'drift'\ndrift_Pa_per_s = 1000");
  bench.run(2s);
  // Less what the sample is old, 4 ms.
  CHECK(bench.value("melt_pressure.reading_Pa") - bench.value("plant.pressure_Pa") == Approx(2000).margin(100));
}

TEST_CASE("Noise and spikes change the samples by chance, the same for the same seed", "[fault]") {
  const auto spread = [](const std::string& kind) {
    Bench bench{"bizone.toml"};
    bench.begin("target = 'sensor.melt_pressure'\n" + kind);
    double sum = 0;
    int far = 0;
    for (int i = 0; i < 500; ++i) {
      bench.run(10ms);
      const double error = bench.value("melt_pressure.reading_Pa") - bench.value("plant.pressure_Pa");
      sum += error * error;
      far += std::abs(error) > 5000 ? 1 : 0;
    }
    return std::pair{std::sqrt(sum / 500), far};
  };
  const auto noise = spread("kind = 'noise'\nnoise_Pa = 1000");
  CHECK(noise.first == Approx(1000).epsilon(0.2));  // 500 samples: 3 % standard error, and the plant moves.
  CHECK(noise == spread("kind = 'noise'\nnoise_Pa = 1000"));
  const auto spikes = spread("kind = 'spike'\nspike_Pa = 20000\nshare = 0.1");
  CHECK(spikes.second > 25);  // 50 +- 7.
  CHECK(spikes.second < 75);
}

TEST_CASE("A pressure loop that is open or shorted leaves its span, and the board says so", "[fault]") {
  Bench bench{"bizone.toml"};
  const auto open = bench.begin("target = 'sensor.melt_pressure'\nkind = 'open_circuit'");
  bench.run(50ms);
  CHECK(bench.value("melt_pressure.status") == 5);  // Not valid, negative overload.
  bench.end(open);
  bench.begin("target = 'sensor.melt_pressure'\nkind = 'short_circuit'");
  bench.run(50ms);
  CHECK(bench.value("melt_pressure.status") == 3);
}

TEST_CASE("A delayed sensor shows what was, with a time stamp of now", "[fault]") {
  Bench bench{"bizone.toml"};
  bench.run(6s, {feed_command(8)});
  bench.begin("target = 'sensor.melt_pressure'\nkind = 'delayed'\ndelay_ms = 1000");
  std::vector<double> truth;
  for (int i = 0; i < 300; ++i) {
    bench.run(10ms, {feed_command(8)});
    truth.push_back(bench.value("plant.pressure_Pa"));
  }
  // 1 s and the board's own latency ago, at most 5 ms: between this row and the one before.
  CHECK(bench.value("melt_pressure.reading_Pa") == Approx(truth[199]).margin(std::abs(truth[199] - truth[198]) + 1));
  CHECK(std::abs(truth[299] - truth[199]) > 1000);
  CHECK(bench.value("melt_pressure.sample_age_s") < 0.01);
}

TEST_CASE("A stuck encoder counts no more, and counts on from there", "[fault]") {
  Bench bench{"bizone.toml"};
  bench.run(1s);
  const auto stuck = bench.begin("target = 'sensor.encoder'\nkind = 'stuck'");
  bench.run(10ms);
  const double at = position_of(bench);
  bench.run(2s);
  CHECK(position_of(bench) == at);
  bench.end(stuck);
  bench.run(1s);
  // 90 rpm, fluctuating by 10 %.
  CHECK(position_of(bench) - at == Approx(1.5 * 65536).epsilon(0.11));
}

TEST_CASE("Thermocouples break, touch the frame, or read what is out of range", "[fault]") {
  Bench bench{"coupled.toml"};
  const auto loose = bench.begin("target = 'sensor.zone2'\nkind = 'short_circuit'");
  bench.run(300ms);
  CHECK(bench.value("heater.zone2_degC") == Approx(23).margin(0.1));
  CHECK(bench.value("heater.zone1_degC") == Approx(145).margin(1));
  bench.end(loose);
  bench.begin("target = 'sensor.zone3'\nkind = 'open_circuit'");
  bench.begin("target = 'sensor.front'\nkind = 'out_of_range'\nvalue_m = 0.15");
  bench.run(300ms);
  CHECK(bench.value("heater.alarms") > 0);
  CHECK(bench.value("heater.zone3_output_percent") == 0);
  CHECK(bench.value("melt_camera.front_m") == Approx(0.15).margin(1e-4));
}

// --- actuators

TEST_CASE("A dead, stuck, saturated or lagging feed is not what the feeder believes", "[fault]") {
  Bench bench{"bizone.toml"};
  const auto feed_kg_per_h = [&] { return 3600 * bench.value("plant.feed_kg_per_s"); };
  bench.run(100ms, {feed_command(4)});
  CHECK(feed_kg_per_h() == Approx(4));
  const double weight = bench.value("feeder.net_weight_kg");
  const auto dead = bench.begin("target = 'actuator.feed'\nkind = 'dead'");
  bench.run(10s, {feed_command(4)});
  CHECK(feed_kg_per_h() == 0);
  CHECK(bench.value("feeder.flow_kg_per_h") == Approx(4));
  CHECK(bench.value("feeder.net_weight_kg") == Approx(weight).margin(2e-4));  // Two steps of the scale.
  CHECK(bench.value("feeder.measured_flow_kg_per_h") < 0.01);
  bench.end(dead);
  CHECK(feed_kg_per_h() == Approx(4));
  const auto stuck = bench.begin("target = 'actuator.feed'\nkind = 'stuck'");
  bench.run(100ms, {feed_command(6)});
  CHECK(feed_kg_per_h() == Approx(4));
  bench.end(stuck);
  const auto saturated = bench.begin("target = 'actuator.feed'\nkind = 'saturated'\nmax_kg_per_h = 5");
  bench.run(100ms, {feed_command(6)});
  CHECK(feed_kg_per_h() == Approx(5));
  bench.end(saturated);
  bench.begin("target = 'actuator.feed'\nkind = 'lagging'\nlag_ms = 1000");
  bench.run(1s, {feed_command(2)});
  CHECK(feed_kg_per_h() == Approx(2 + 4 * std::exp(-1.0)).margin(0.1));  // 10 ms steps, and the feeder's latency.
}

TEST_CASE("A welded relay heats whatever the heater board says, a dead one does not", "[fault]") {
  Bench bench{"coupled.toml"};
  bench.run(100ms);
  bench.begin("target = 'actuator.zone1'\nkind = 'welded_on'");
  bench.begin("target = 'actuator.zone2'\nkind = 'dead'");
  bench.run(5s);
  CHECK(bench.value("barrel.power_zone1_W") == Approx(500));
  CHECK(bench.value("barrel.power_zone2_W") == 0);
  bench.send(can::make_frame(0x300U + kHeater, {0, 0, 0}));  // Nothing is released: the contactor opens.
  bench.run(1s);
  CHECK(bench.value("barrel.power_zone1_W") == 0);
}

// --- the plant

TEST_CASE("Granules that bridge, and a hopper that is empty, stop the feed", "[fault]") {
  Bench bench{"bizone.toml"};
  bench.run(1s, {feed_command(4)});
  const auto bridging = bench.begin("target = 'plant'\nkind = 'feeder_bridging'");
  bench.run(100ms, {feed_command(4)});
  CHECK(bench.value("plant.feed_kg_per_s") == 0);
  CHECK(bench.count(0x80U + kFeeder) == 0);
  bench.end(bridging);
  CHECK(3600 * bench.value("plant.feed_kg_per_s") == Approx(4));
  const auto empty = bench.begin("target = 'plant'\nkind = 'hopper_empty'");
  bench.run(100ms, {feed_command(4)});
  CHECK(bench.value("plant.feed_kg_per_s") == 0);
  CHECK(bench.value("feeder.net_weight_kg") == 0);
  CHECK(bench.count(0x80U + kFeeder) == 1);  // EMCY.
  bench.end(empty);
  bench.run(100ms, {feed_command(4)});
  CHECK(3600 * bench.value("plant.feed_kg_per_s") == Approx(4));
  CHECK(bench.value("feeder.net_weight_kg") == Approx(25).margin(0.01));
}

TEST_CASE("A clogged nozzle and a thicker melt raise the pressure, a surging screw swings", "[fault]") {
  Bench bench{"bizone.toml", "[plant]\nfluctuation_case = 'none'"};
  bench.run(100ms);
  const double before = bench.value("plant.pressure_Pa");
  const auto clog = bench.begin("target = 'plant'\nkind = 'nozzle_clog'\nclosed_share = 0.5");
  CHECK(bench.value("plant.pressure_Pa") > 1.05 * before);
  bench.end(clog);
  bench.run(10ms);
  const auto thick = bench.begin("target = 'plant'\nkind = 'material'\nviscosity_factor = 1.5");
  CHECK(bench.value("plant.pressure_Pa") == Approx(1.5 * before).epsilon(0.02));
  bench.end(thick);
  CHECK(bench.value("plant.pressure_Pa") == Approx(before).epsilon(0.02));
  bench.begin("target = 'plant'\nkind = 'screw_surge'\neps = 0.3\nw_rad_per_s = 3.141592653589793");
  bench.run(500ms);
  CHECK(bench.value("plant.speed_m_per_s") == Approx(0.015 * 1.3).epsilon(0.01));
  bench.run(1s);
  CHECK(bench.value("plant.speed_m_per_s") == Approx(0.015 * 0.7).epsilon(0.01));
}

TEST_CASE("Another batch melts elsewhere", "[fault]") {
  Bench bench{"coupled.toml"};
  bench.run(100ms);
  CHECK(bench.value("melt.T_melt_degC") == Approx(135));
  const auto batch = bench.begin("target = 'plant'\nkind = 'material'\nmelting_point_shift_K = 4");
  CHECK(bench.value("melt.T_melt_degC") == Approx(139));
  bench.end(batch);
  CHECK(bench.value("melt.T_melt_degC") == Approx(135));
}

// --- boards

TEST_CASE("A board without power is silent and drives nothing, and powers up with a boot-up message", "[fault]") {
  Bench bench{"bizone.toml"};
  bench.run(1s, {feed_command(4)});
  bench.sent.clear();
  const auto off = bench.begin("target = 'board.feeder'\nkind = 'off'");
  bench.run(1s, {feed_command(4)});
  CHECK(bench.count(0x180U + kFeeder) == 0);
  CHECK(bench.count(0x180U + kPressure) == 100);
  CHECK(bench.value("plant.feed_kg_per_s") == 0);
  bench.end(off);
  CHECK(bench.count(0x700U + kFeeder) == 1);
  CHECK(bench.sent.back().frame.bytes[0] == 0);
  CHECK(3600 * bench.value("plant.feed_kg_per_s") == Approx(2.62).epsilon(0.01));  // Its start flow.
}

TEST_CASE("A board that hangs answers SYNC with old values until its watchdog resets it", "[fault]") {
  Bench bench{"bizone.toml"};
  bench.run(1s, {feed_command(4)});
  const auto hang = bench.begin("target = 'board.melt_pressure'\nkind = 'hang'\nwatchdog_ms = 0");
  bench.run(10ms, {feed_command(8)});
  const auto bytes_of_last = [&] {
    for (auto one = bench.sent.rbegin(); one != bench.sent.rend(); ++one) {
      if (one->frame.id == 0x180U + kPressure) return one->frame.bytes;
    }
    return can::CanFrame{}.bytes;
  };
  const auto frozen = bytes_of_last();
  bench.sent.clear();
  bench.run(5s, {feed_command(8)});
  CHECK(bench.count(0x180U + kPressure) == 500);
  CHECK(bytes_of_last() == frozen);
  bench.end(hang);
  CHECK(bench.count(0x700U + kPressure) == 1);
}

TEST_CASE("A feeder that hangs feeds on, and its watchdog does not act", "[fault]") {
  Bench bench{"bizone.toml"};
  bench.run(1s, {feed_command(4)});
  bench.begin("target = 'board.feeder'\nkind = 'hang'\nwatchdog_ms = 3000");
  bench.run(1s);
  CHECK(3600 * bench.value("plant.feed_kg_per_s") == Approx(4));
  bench.run(1s, {feed_command(8)});
  CHECK(3600 * bench.value("plant.feed_kg_per_s") == Approx(4));
  CHECK(bench.count(0x700U + kFeeder) == 1);
  bench.run(2s);
  CHECK(bench.count(0x700U + kFeeder) == 2);  // Its hardware watchdog has reset it.
}

TEST_CASE("A slow board sends everything later, in order", "[fault]") {
  Bench bench{"bizone.toml"};
  bench.run(1s);
  bench.begin("target = 'board.melt_pressure'\nkind = 'slow'\ndelay_ms = 25");
  bench.sent.clear();
  bench.run(100ms);
  std::vector<Instant> times;
  for (const auto& one : bench.sent) {
    if (one.frame.id == 0x180U + kPressure) times.push_back(one.at);
  }
  REQUIRE(times.size() >= 7);
  CHECK(times[0] == Instant{1035ms});
  CHECK(times[1] == Instant{1045ms});
}

TEST_CASE("A board can lose its heartbeat only, be swapped, storm, and reboot", "[fault]") {
  Bench bench{"bizone.toml"};
  const auto write_heartbeat = [&] {  // 1017 = 100 ms, by expedited SDO.
    bench.send(can::make_frame(0x600U + kScrew, {0x2B, 0x17, 0x10, 0, 100, 0, 0, 0}));
  };
  write_heartbeat();
  bench.sent.clear();
  bench.run(1s);
  CHECK(bench.count(0x700U + kScrew) == 10);
  const auto mute = bench.begin("target = 'board.screw_drive'\nkind = 'heartbeat_lost'");
  bench.sent.clear();
  bench.run(1s);
  CHECK(bench.count(0x700U + kScrew) == 0);
  CHECK(bench.count(0x380U + kScrew) == 100);
  bench.end(mute);

  bench.sent.clear();
  bench.begin("target = 'board.screw_drive'\nkind = 'wrong_identity'\nproduct = 0x01020304");
  CHECK(bench.count(0x700U + kScrew) == 1);
  bench.send(can::make_frame(0x600U + kScrew, {0x40, 0x18, 0x10, 2, 0, 0, 0, 0}));
  CHECK(bench.sent.back().frame == can::make_frame(0x580U + kScrew, {0x43, 0x18, 0x10, 2, 4, 3, 2, 1}));

  bench.sent.clear();
  bench.begin("target = 'board.melt_pressure'\nkind = 'emcy_storm'\ncode = 0x4200\nperiod_ms = 5");
  bench.run(100ms);
  CHECK(bench.count(0x80U + kPressure) == 21);  // The first at once.
  CHECK(bench.sent[0].frame.bytes[1] == 0x42);

  bench.sent.clear();
  bench.begin("target = 'board.feeder'\nkind = 'reboot'");
  CHECK(bench.count(0x700U + kFeeder) == 1);
}

TEST_CASE("A heater without power is cold, and does not heat by itself when power is back", "[fault]") {
  Bench bench{"coupled.toml"};
  bench.run(2s);
  const auto off = bench.begin("target = 'board.heater'\nkind = 'off'");
  bench.run(1s);
  CHECK(bench.value("barrel.power_zone1_W") == 0);
  bench.end(off);
  bench.run(5s);
  CHECK(bench.value("barrel.power_zone1_W") == 0);
  CHECK(bench.count(0x180U + kCamera) > 0);
  CHECK(bench.count(0x700U + kHeater) > 0);
}

TEST_CASE("A heater on a serial line loses the power of its bands with its own, and waits to be told when it is back",
          "[fault]") {
  Bench bench{"coupled_serial.toml", "[board.heater]\noutput = 'proportional'"};
  bench.run(100ms);
  REQUIRE(bench.value("barrel.power_zone1_W") > 0);
  bench.begin("target = 'actuator.zone1'\nkind = 'welded_on'");
  bench.run(100ms);
  CHECK(bench.value("barrel.power_zone1_W") == 500);
  const auto off = bench.begin("target = 'board.heater'\nkind = 'off'");
  bench.run(100ms);
  CHECK(bench.value("barrel.power_zone1_W") == 0);
  CHECK(bench.value("barrel.power_nozzle_W") == 0);
  bench.end(off);
  bench.run(1s);
  CHECK(bench.value("barrel.power_zone1_W") == 0);  // Nothing is released: the contactor is open.
}

TEST_CASE("A heater on a serial line that hangs keeps its bands as they are until its watchdog resets it", "[fault]") {
  Bench bench{"coupled_serial.toml", "[board.heater]\noutput = 'proportional'\nwatchdog_ms = 200"};
  bench.run(100ms);
  const double before = bench.value("barrel.power_zone1_W");
  REQUIRE(before > 0);
  bench.begin("target = 'board.heater'\nkind = 'hang'\nwatchdog_ms = 600");
  bench.run(590ms);
  CHECK(bench.value("barrel.power_zone1_W") == before);  // Its own watchdog hangs, too.
  CHECK(std::none_of(bench.events.begin(), bench.events.end(),
                     [](const Event& one) { return one.code == "master-lost"; }));
  bench.run(20ms);
  CHECK(bench.value("barrel.power_zone1_W") == 0);
}
