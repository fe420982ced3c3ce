#include "controller/machine/serial_feeder.hpp"

#include <algorithm>
#include <catch2/catch.hpp>
#include <map>

#include "protocols/modbus/rtu_server.hpp"
#include "tests/controller/machine/fake_rig.hpp"

using namespace meltbench;
using namespace meltbench::machine;
using modbus::ExceptionCode;
using modbus::Table;

namespace {

constexpr std::uint8_t kUnit = 3;
constexpr std::uint16_t kStatus = feeder_register::kReport + 4;

/// A feeder with the registers that the controller uses: delivers a set point at once.
class FakeSerialFeeder final : public modbus::RegisterMap {
 public:
  explicit FakeSerialFeeder(modbus::WordOrder order = modbus::WordOrder::kHighFirst) : order_{order} {
    words_[feeder_register::kWordOrder] = static_cast<std::uint16_t>(order);
    put(feeder_register::kReport, modbus::to_words(2.6F, order_));
    words_[feeder_register::kReport + 2] = 0xFFFF;
    put(feeder_register::kLatency, modbus::to_words(std::uint32_t{2000}, order_));
    put(feeder_register::kControlCycle, modbus::to_words(std::uint32_t{1000}, order_));
  }

  std::string_view product = "LIW-1";
  ExceptionCode refuses = ExceptionCode::kNone;
  void set_status(std::uint16_t bits) { words_[kStatus] = bits; }
  std::vector<std::pair<Instant, float>> set_points;

  [[nodiscard]] float number(std::uint16_t at) const {
    return modbus::to_float(std::array{words_.at(at), words_.at(static_cast<std::uint16_t>(at + 1))}, order_);
  }
  [[nodiscard]] std::uint16_t word(std::uint16_t at) const { return words_.at(at); }

  [[nodiscard]] bool supports(modbus::Function) const override { return true; }
  [[nodiscard]] bool covers(Table, std::uint16_t, std::uint16_t, bool) const override { return true; }
  ExceptionCode read_registers(Instant, Table, std::uint16_t first, std::span<std::uint16_t> values) override {
    for (auto& value : values) value = words_[first++];
    return refuses;
  }
  ExceptionCode write_registers(Instant now, std::uint16_t first, std::span<const std::uint16_t> values) override {
    if (refuses != ExceptionCode::kNone) return refuses;
    put(first, values);
    if (first == feeder_register::kLossOfMaster) words_[kStatus] = feeder_register::kConfigured;
    if (first == feeder_register::kSetPoint) {
      set_points.emplace_back(now, number(feeder_register::kSetPoint));
      put(feeder_register::kReport, values);
      ++words_[feeder_register::kReport + 3];
    }
    return ExceptionCode::kNone;
  }
  ExceptionCode read_bits(Instant, Table, std::uint16_t, std::span<bool>) override { return ExceptionCode::kNone; }
  ExceptionCode write_coils(Instant, std::uint16_t, std::span<const bool>) override { return ExceptionCode::kNone; }
  [[nodiscard]] modbus::Identity identity() const override {
    identity_ = {"Meltbench", product, "1.0"};
    return identity_;
  }

 private:
  void put(std::uint16_t at, std::span<const std::uint16_t> values) {
    for (const std::uint16_t value : values) words_[at++] = value;
  }
  modbus::WordOrder order_;
  std::map<std::uint16_t, std::uint16_t> words_;
  mutable std::array<std::string_view, 3> identity_;
};

ControllerSettings make_serial_settings() {
  ControllerSettings settings = testing::make_settings();
  settings.boards[0] = {
      .kind = config::BoardKind::kFeeder, .name = "feeder", .identity = {}, .line = "dosing", .unit = kUnit};
  settings.lines = {{"dosing", {.baud_rate = 115'200}}};
  settings.feeder_watchdog_ms = 300;
  return settings;
}

/// The feeder's line with its bytes' times, driven by a test in the controller's place.
struct Line {
  explicit Line(const ControllerSettings& from = make_serial_settings()) : settings{from} { master.add(feeder); }

  ControllerSettings settings;
  modbus::LineTiming timing = timing_of(settings, "dosing");
  SerialFeeder feeder{settings, 3.0 / 3600};
  SerialMaster master{0, timing, settings.serial};
  FakeSerialFeeder device;
  modbus::RtuServer server = make_server();
  bool plugged = true;
  Instant now{};
  std::vector<FeedSample> samples;
  std::vector<std::string> troubles, news;

  modbus::RtuServer make_server() {
    modbus::RtuServer made{timing};
    made.add(kUnit, device);
    return made;
  }
  void run_to(Instant end) {
    Outbox out;
    for (;;) {
      const Instant next = std::min({master.next_deadline(), server.next_deadline(), arrival_at()});
      if (next > end) break;
      now = std::max(now, next);
      if (arrival_at() <= now) deliver();
      std::vector<std::uint8_t> answer;
      if (server.next_deadline() <= now) server.on_time(now, answer);
      if (!answer.empty()) under_way_.push_back({now + timing.on_wire(answer.size()), true, answer});
      out.clear();
      if (master.next_deadline() <= now) master.on_time(now, out);
      for (const SerialPiece& piece : out.serial()) {
        const auto bytes = out.serial_bytes(piece);
        under_way_.push_back({now + timing.on_wire(bytes.size()), false, {bytes.begin(), bytes.end()}});
      }
      collect();
    }
    now = end;
  }
  /// As the controller does at every SYNC.
  void cycle(std::optional<double> flow_kg_per_h) {
    Outbox out;
    if (flow_kg_per_h) feeder.command(now, *flow_kg_per_h / 3600, out);
    feeder.end_cycle(now);
    run_to(now + 10ms);
  }

 private:
  struct Piece {
    Instant at;
    bool to_master;
    std::vector<std::uint8_t> bytes;
  };
  [[nodiscard]] Instant arrival_at() const { return under_way_.empty() ? Instant::never() : under_way_.front().at; }
  void deliver() {
    const Piece piece = under_way_.front();
    under_way_.erase(under_way_.begin());
    if (!plugged) return;
    if (piece.to_master) {
      master.on_bytes(now, {piece.at, 0, piece.bytes});
    } else {
      server.on_bytes(piece.at, piece.bytes);
    }
  }
  void collect() {
    if (const auto sample = feeder.take_sample()) samples.push_back(*sample);
    while (const auto trouble = feeder.take_trouble()) troubles.emplace_back(trouble->code);
    if (const auto text = feeder.take_news()) news.push_back(*text);
  }
  std::vector<Piece> under_way_;
};

}  // namespace

TEST_CASE("Serial feeder: is asked who it is and told its safe flow and watchdog before it is polled", "[machine]") {
  Line line;
  line.run_to(Instant{100ms});
  CHECK(line.feeder.is_configured());
  CHECK(line.device.number(feeder_register::kLossOfMaster) == Approx(3.0F));
  CHECK(line.device.word(feeder_register::kWatchdog) == 300);
  CHECK(line.device.set_points.empty());
  CHECK(line.troubles.empty());
}

TEST_CASE("Serial feeder: the request's own time is part of its latency", "[machine]") {
  Line line;
  line.run_to(Instant{100ms});
  const testing::FakeRig can;
  const FeederFacts facts = line.feeder.facts(BusManager{testing::make_settings(), 0.0});
  CHECK(facts.latency == 2ms + line.timing.on_wire(17));  // Function 23 with one 32-bit value: 17 bytes.
  CHECK(facts.cycle == 1ms);
}

TEST_CASE("Serial feeder: a cycle writes the set point and brings a report of the instant at which it arrived",
          "[machine]") {
  Line line;
  line.run_to(Instant{100ms});
  line.samples.clear();
  line.cycle(4.5);
  REQUIRE(line.device.set_points.size() == 1);
  CHECK(line.device.set_points[0].second == 4.5F);
  CHECK(line.device.set_points[0].first == Instant{100ms + line.timing.on_wire(17)});
  REQUIRE(line.samples.size() == 1);
  CHECK(line.samples[0].at == Instant{100ms + line.timing.on_wire(17)});
  CHECK(line.samples[0].flow_kg_per_s == Approx(4.5 / 3600).epsilon(1e-6));
  CHECK(line.samples[0].changes == 1);
  CHECK_FALSE(line.samples[0].age);  // Older than can be told.
  const auto sent = line.feeder.take_sent();
  REQUIRE(sent);
  CHECK(sent->at == Instant{100ms});
}

TEST_CASE("Serial feeder: without a set point it is only read", "[machine]") {
  Line line;
  line.run_to(Instant{100ms});
  line.samples.clear();
  line.cycle({});
  CHECK(line.device.set_points.empty());
  CHECK(line.samples.size() == 1);
}

TEST_CASE("Serial feeder: on a slow line the newest set point leaves when the line is free", "[machine]") {
  ControllerSettings settings = make_serial_settings();
  settings.lines[0].settings.baud_rate = 19'200;  // A request and its answer take 22 ms.
  Line line{settings};
  line.run_to(Instant{500ms});
  for (int i = 0; i < 12; ++i) line.cycle(static_cast<double>(i));
  line.run_to(line.now + 100ms);
  CHECK(line.device.set_points.size() < 12);
  CHECK(line.device.set_points.size() >= 5);
  CHECK(line.device.set_points.back().second == 11.0F);
  CHECK(line.troubles.empty());
}

TEST_CASE("Serial feeder: its word order is asked for", "[machine]") {
  Line line;
  line.device = FakeSerialFeeder{modbus::WordOrder::kLowFirst};
  line.run_to(Instant{100ms});
  line.cycle(4.5);
  REQUIRE(line.device.set_points.size() == 1);
  CHECK(line.device.set_points[0].second == 4.5F);
  CHECK(line.samples.back().flow_kg_per_s == Approx(4.5 / 3600).epsilon(1e-6));
}

TEST_CASE("Serial feeder: another device is not configured", "[machine]") {
  Line line;
  line.device.product = "SCALE-9";
  line.run_to(Instant{10s});
  CHECK_FALSE(line.feeder.is_configured());
  CHECK(line.troubles == std::vector<std::string>{"identity-mismatch"});
}

TEST_CASE("Serial feeder: one that never answers ends the boot", "[machine]") {
  Line line;
  line.plugged = false;
  line.run_to(Instant{4900ms});
  CHECK(line.troubles.empty());
  line.run_to(Instant{20s});
  CHECK(line.troubles == std::vector<std::string>{"boot-timeout"});  // 5 s, and what a request takes to be given up.
}

TEST_CASE("Serial feeder: unplugged it is lost once, and configured anew when it is back", "[machine]") {
  Line line;
  line.run_to(Instant{100ms});
  for (int i = 0; i < 10; ++i) line.cycle(4.0);
  line.plugged = false;
  const Instant unplugged_at = line.now;
  while (line.troubles.empty() && line.now < Instant{2s}) line.cycle(4.0);
  CHECK(line.troubles == std::vector<std::string>{"device-lost"});
  CHECK(to_s(line.now - unplugged_at) < 0.17);  // Three requests of 50 ms and 1.6 ms each, to the next cycle.
  for (int i = 0; i < 100; ++i) line.cycle(4.0);
  CHECK(line.troubles.size() == 1);
  Outbox out;
  BusManager bus{testing::make_settings(), 0.0};
  line.feeder.set_safe_flow(line.now, 2.0 / 3600, bus, out);
  line.device = FakeSerialFeeder{};  // It has lost power.
  line.plugged = true;
  for (int i = 0; i < 50; ++i) line.cycle(4.0);
  CHECK(line.news.size() == 1);
  CHECK(line.device.number(feeder_register::kLossOfMaster) == Approx(2.0F));
  CHECK(line.device.word(feeder_register::kWatchdog) == 300);
  CHECK(line.device.set_points.back().second == 4.0F);
}

TEST_CASE("Serial feeder: a changed safe flow is written between two polls", "[machine]") {
  Line line;
  line.run_to(Instant{100ms});
  line.cycle(4.0);
  Outbox out;
  BusManager bus{testing::make_settings(), 0.0};
  line.feeder.set_safe_flow(line.now, 2.5 / 3600, bus, out);
  line.cycle(4.0);
  line.cycle(4.0);
  CHECK(line.device.number(feeder_register::kLossOfMaster) == Approx(2.5F));
  CHECK(line.device.set_points.size() >= 2);
}

TEST_CASE("Serial feeder: a refused request is a trouble", "[machine]") {
  Line line;
  line.run_to(Instant{100ms});
  line.device.refuses = ExceptionCode::kDeviceFailure;
  line.cycle(4.0);
  CHECK(line.troubles == std::vector<std::string>{"device-refused"});
}

TEST_CASE("Serial feeder: one that was reset is told and configured anew, an empty one is told once", "[machine]") {
  Line line;
  line.run_to(Instant{100ms});
  for (int i = 0; i < 5; ++i) line.cycle(3.0);
  REQUIRE(line.troubles.empty());
  line.device.set_status(0);
  for (int i = 0; i < 20; ++i) line.cycle(3.0);
  CHECK(line.troubles == std::vector<std::string>{"device-reset"});
  CHECK(line.device.number(feeder_register::kLossOfMaster) == 3.0F);
  line.device.set_status(feeder_register::kConfigured | feeder_register::kHopperEmpty);
  for (int i = 0; i < 5; ++i) line.cycle(3.0);
  CHECK(line.troubles == std::vector<std::string>{"device-reset", "feeder-empty"});
}
