#pragma once
/// Boards in the form of CANopen nodes with a trivial process behind them, and a bus without delay: enough to run
/// the controller against, and to break at every place.

#include <array>
#include <cmath>
#include <cstdint>
#include <fstream>
#include <functional>
#include <iterator>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "controller/machine/controller.hpp"
#include "controller/machine/objects.hpp"
#include "protocols/canopen/eds.hpp"
#include "protocols/canopen/node.hpp"
#include "tests/tools/allocation_counter.hpp"

namespace meltbench::machine::testing {

inline canopen::ObjectDictionary read_dictionary(const std::string& eds, std::uint8_t node_id) {
  const std::string path = std::string{MELTBENCH_SOURCE_DIR} + "/fixtures/boards/" + eds;
  std::ifstream in{path, std::ios::binary};
  const std::string text{std::istreambuf_iterator<char>{in}, {}};
  return canopen::read_eds(text, path, node_id).dictionary;
}

inline Identity identity_in(const canopen::ObjectDictionary& dictionary) {
  const auto value = [&](std::uint16_t index, std::uint8_t sub) {
    return static_cast<std::uint32_t>(dictionary.integer_or(index, sub, 0));
  };
  return {value(0x1000, 0), value(0x1018, 1), value(0x1018, 2), value(0x1018, 3)};
}

/// A screw that turns evenly and an extruder whose filled length, front and temperatures the test sets.
struct FakeProcess {
  law::BizoneModel model;
  double x_m = 0.1;
  double rev_per_s = 1.5;
  double front_m = 0.05;
  double T_inlet_degC = 130.0;
  double mean_flux_W_per_m2 = 0.0;
  double T_zone_degC = 20.0;
  double output = 0.0;  ///< Of every zone, share of its power.

  [[nodiscard]] double speed_m_per_s() const { return 0.01 * rev_per_s; }
  [[nodiscard]] double pressure_Pa() const {
    return model.feed_kg_per_s(model.holding_ratio(x_m), speed_m_per_s()) * model.viscosity_Pa_s / model.nozzle_kg;
  }
};

/// A node with what a test wants to do with it.
class FakeBoard : public canopen::NodeListener {
 public:
  FakeBoard(const std::string& eds, std::uint8_t node_id, FakeProcess& process)
      : node_{read_dictionary(eds, node_id), node_id, this}, process_{process} {}

  [[nodiscard]] canopen::Node& node() { return node_; }
  [[nodiscard]] canopen::ObjectDictionary& od() { return node_.dictionary(); }

  bool alive = true;  ///< Else it neither hears nor says anything.

 protected:
  [[nodiscard]] FakeProcess& process() { return process_; }

 private:
  canopen::Node node_;
  FakeProcess& process_;
};

/// Delivers a set point at once.
class FakeFeeder : public FakeBoard {
 public:
  explicit FakeFeeder(FakeProcess& process) : FakeBoard("feeder.eds", 5, process) { od().at(0x2001).set<float>(2.6F); }
  void on_rpdo(Instant now, unsigned number) override {
    if (number != 1) return;
    const float flow = od().at(0x2000).get<float>();
    if (flow != od().at(0x2001).get<float>()) {
      od().at(0x2004).set(static_cast<std::uint8_t>(od().at(0x2004).get<std::uint8_t>() + 1));
      changed_at_ = now;
    }
    od().at(0x2001).set(flow);
  }
  void on_sync(Instant now, std::uint8_t) override {
    od().at(0x2002).set(static_cast<std::uint16_t>(std::min<Nanos::rep>((now - changed_at_) / 10us, 0xFFFF)));
  }
  [[nodiscard]] double flow_kg_per_h() { return static_cast<double>(od().at(0x2001).get<float>()); }

 private:
  Instant changed_at_{};
};

/// Obeys the control word; a cold one starts in Switch on disabled.
class FakeDrive : public FakeBoard {
 public:
  FakeDrive(FakeProcess& process, bool warm) : FakeBoard("screw_drive.eds", 6, process) {
    od().at(0x6041).set<std::uint16_t>(warm ? 0x27 : 0x40);
    od().at(0x606B).set<std::int32_t>(warm ? 98304 : 0);
  }
  void on_written(Instant, const canopen::OdEntry& entry) override {
    if (entry.address().index == 0x6040) obey(od().at(0x6040).get<std::uint16_t>());
  }
  void on_rpdo(Instant, unsigned) override { obey(od().at(0x6040).get<std::uint16_t>()); }
  void on_sync(Instant now, std::uint8_t) override {
    const double increments = 65536.0 * process().rev_per_s * to_s(now);
    od().at(0x6064).set(static_cast<std::int32_t>(static_cast<std::uint32_t>(std::llround(increments))));
    od().at(0x606C).set(static_cast<std::int32_t>(std::lround(65536.0 * process().rev_per_s)));
  }
  [[nodiscard]] std::uint16_t statusword() { return od().at(0x6041).get<std::uint16_t>(); }
  std::vector<std::uint16_t> controlwords;
  bool follows_target = false;  ///< The screw turns as it is told, else as the test says.

 private:
  void obey(std::uint16_t controlword) {
    controlwords.push_back(controlword);
    const std::uint16_t now = statusword();
    std::uint16_t next = now;
    if (now == 0x40 && controlword == 0x06) next = 0x21;
    if (now == 0x21 && controlword == 0x07) next = 0x23;
    if (now == 0x23 && controlword == 0x0F) next = 0x27;
    if (now == 0x27 && controlword == 0x02) next = 0x07;
    if (next == 0x27) od().at(0x606B).set(od().at(0x60FF).get<std::int32_t>());
    if (next == 0x27 && follows_target) process().rev_per_s = od().at(0x60FF).get<std::int32_t>() / 65536.0;
    od().at(0x6041).set(next);
  }
};

/// Has a fresh sample at every SYNC.
class FakePressure : public FakeBoard {
 public:
  explicit FakePressure(FakeProcess& process) : FakeBoard("melt_pressure.eds", 7, process) {}
  void on_sync(Instant, std::uint8_t) override {
    od().at(0x9130, 1).set(static_cast<std::int32_t>(std::lround(process().pressure_Pa())));
    od().at(0x6150, 1).set(status);
    od().at(0x2001).set<std::uint16_t>(500);
  }
  std::uint8_t status = 0;
};

/// A board as its EDS file in the fixtures describes it.
inline BoardSettings make_board(config::BoardKind kind, std::uint8_t node_id) {
  const std::string name{config::name_of(kind)};
  return {kind, name, node_id, 100ms, identity_in(read_dictionary(name + ".eds", node_id))};
}

/// Has a fresh image at every SYNC.
class FakeCamera : public FakeBoard {
 public:
  explicit FakeCamera(FakeProcess& process) : FakeBoard("melt_camera.eds", 9, process) {}
  void on_sync(Instant, std::uint8_t) override {
    od().at(0x9130, 1).set(static_cast<std::int32_t>(std::lround(1e6 * process().front_m)));
    od().at(0x6150, 1).set(status);
    od().at(0x2001).set<std::uint16_t>(0);
  }
  std::uint8_t status = 0;
};

/// Has a fresh temperature at every SYNC; the flux is what the test says.
class FakePreconditioner : public FakeBoard {
 public:
  explicit FakePreconditioner(FakeProcess& process) : FakeBoard("preconditioner.eds", 8, process) {}
  void on_sync(Instant, std::uint8_t) override {
    od().at(0x6130, 1).set(static_cast<float>(process().T_inlet_degC));
    od().at(0x6150, 1).set(status);
    od().at(0x2010).set<std::uint16_t>(0);
    od().at(0x2012).set(static_cast<float>(process().mean_flux_W_per_m2));
  }
  [[nodiscard]] int mode() { return od().at(0x2002).get<std::uint8_t>(); }
  [[nodiscard]] double T_reference_degC() { return static_cast<double>(od().at(0x6402, 1).get<float>()); }
  [[nodiscard]] double feedforward_W_per_m2() { return static_cast<double>(od().at(0x2000).get<float>()); }
  [[nodiscard]] double gain_W_per_m2K() { return static_cast<double>(od().at(0x2001).get<float>()); }
  std::uint8_t status = 0;
};

/// Five zones, all at the temperature and output of the process.
class FakeHeater : public FakeBoard {
 public:
  explicit FakeHeater(FakeProcess& process) : FakeBoard("heater.eds", 10, process) { set_values(); }
  void on_sync(Instant, std::uint8_t) override { set_values(); }
  [[nodiscard]] int release() { return od().at(0x2000).get<std::uint8_t>(); }
  [[nodiscard]] double set_degC(std::uint8_t channel) { return 0.1 * od().at(0x7402, channel).get<std::int16_t>(); }
  std::array<std::uint8_t, 5> status{};
  std::array<std::uint8_t, 5> state{};
  std::array<double, 5> colder_K{};  ///< Than the process.

 private:
  void set_values() {
    for (std::uint8_t channel = 1; channel <= 5; ++channel) {
      od().at(0x7130, channel)
          .set(static_cast<std::int16_t>(std::lround(10.0 * (process().T_zone_degC - colder_K[channel - 1U]))));
      od().at(0x2102, channel).set(state[channel - 1U]);
      od().at(0x6150, channel).set(status[channel - 1U]);
      od().at(0x7410, channel).set(static_cast<std::int16_t>(std::lround(1000.0 * process().output)));
    }
  }
};

/// The rig of the tests: node ids 5, 6, 7, the models' default extruder.
inline ControllerSettings make_settings() {
  ControllerSettings settings;
  settings.max_disagreement_m = 1.0;  // The fake's pressure does not follow its feed.
  settings.boards = {make_board(config::BoardKind::kFeeder, 5), make_board(config::BoardKind::kScrewDrive, 6),
                     make_board(config::BoardKind::kMeltPressure, 7)};
  settings.set_points = {{Instant{}, 0.16}};
  settings.limits.max_pressure_Pa = 1e5;
  settings.limits.max_filled_length_m = 0.198;
  return settings;
}

/// A controller and some boards on one bus on which frames cross at once. The boards are those of a derived class.
class FakeBus {
 public:
  explicit FakeBus(const ControllerSettings& settings) : controller{settings} {}

  FakeProcess process;
  Controller controller;
  std::function<bool(Instant, const can::CanFrame&)> loses;  ///< True: the frame is lost on the bus.
  std::vector<Event> events;
  std::vector<can::StampedFrame> sent;  ///< By the controller.
  std::uint64_t allocations = 0;        ///< By the controller.

  /// Everything up to and including `end`.
  void run_until(Instant end) {
    if (!started_) power_on();
    for (;;) {
      const Instant next = std::min({controller_due_, next_board_deadline()});
      if (arrived_.empty() && next > end) return;
      if (arrived_.empty()) now_ = std::max(now_, next);
      wake_boards();
      if (controller_due_ <= now_ || !arrived_.empty()) wake_controller();
    }
  }
  void run_for_s(double seconds) { run_until(Instant{nanos_from_s(seconds)}); }

  /// The controller is started now, on a bus that has been there for a while.
  void start_at(Instant at) { now_ = controller_due_ = at; }

  /// As from another node on the bus.
  void inject(const can::CanFrame& frame) { arrived_.push_back({now_, frame}); }

  [[nodiscard]] const Event* find_event(std::string_view code) const {
    for (const Event& event : events) {
      if (event.code == code) return &event;
    }
    return nullptr;
  }
  [[nodiscard]] double signal(std::string_view name) const {
    std::vector<double> values(controller.signals().size());
    controller.read_signals(values);
    for (std::size_t i = 0; i < values.size(); ++i) {
      if (controller.signals()[i].name == name) return values[i];
    }
    throw std::out_of_range(std::string{name});
  }
  [[nodiscard]] Instant now() const { return now_; }

 protected:
  std::vector<FakeBoard*> boards_;

 private:
  [[nodiscard]] Instant next_board_deadline() {
    Instant next = Instant::never();
    for (FakeBoard* board : boards_) {
      if (board->alive) next = std::min(next, board->node().next_deadline());
    }
    return next;
  }
  void power_on() {
    started_ = true;
    wake_controller();  // A reset that nobody hears: the boards come up later.
    for (FakeBoard* board : boards_) {
      if (board->alive) board->node().start(now_, from_boards_);
    }
    collect();
  }
  void wake_boards() {
    for (FakeBoard* board : boards_) {
      if (board->alive && board->node().next_deadline() <= now_) board->node().on_time(now_, from_boards_);
    }
    collect();
  }
  void collect() {
    for (const can::CanFrame& frame : from_boards_) {
      if (!loses || !loses(now_, frame)) arrived_.push_back({now_, frame});
    }
    from_boards_.clear();
  }
  void wake_controller() {
    Outbox& out = outbox_;
    out.clear();
    const std::vector<can::StampedFrame> in = std::move(arrived_);
    arrived_.clear();
    const std::uint64_t before = test::count_allocations();
    controller.wake({now_, in, LinkState::kUp}, out);
    allocations += test::count_allocations() - before;
    controller_due_ = out.deadline();
    events.insert(events.end(), out.events().begin(), out.events().end());
    for (const can::CanFrame& frame : out.frames()) {
      sent.push_back({now_, frame});
      if (loses && loses(now_, frame)) continue;
      for (FakeBoard* board : boards_) {
        if (started_ && board->alive) board->node().on_frame(now_, frame, from_boards_);
      }
    }
    collect();
  }

  bool started_ = false;
  Instant now_{};
  Instant controller_due_{};
  Outbox outbox_;
  canopen::Frames from_boards_;
  std::vector<can::StampedFrame> arrived_;
};

/// The filled length: feeder, screw drive and melt pressure.
class FakeRig : public FakeBus {
 public:
  explicit FakeRig(const ControllerSettings& settings = make_settings(), bool warm_drive = true)
      : FakeBus{settings}, feeder{process}, drive{process, warm_drive}, pressure{process} {
    boards_ = {&feeder, &drive, &pressure};
  }

  FakeFeeder feeder;
  FakeDrive drive;
  FakePressure pressure;
};

/// The melting front alone: 10 mm/s, steady at 50 mm when nobody asks otherwise.
inline ControllerSettings make_melt_settings() {
  ControllerSettings settings;
  settings.boards = {make_board(config::BoardKind::kScrewDrive, 6), make_board(config::BoardKind::kPreconditioner, 8),
                     make_board(config::BoardKind::kMeltCamera, 9)};
  settings.melt = MeltSettings{};
  settings.model.speed_m_per_s = settings.melt->speed_m_per_s;
  return settings;
}

class FakeMeltRig : public FakeBus {
 public:
  explicit FakeMeltRig(const ControllerSettings& settings = make_melt_settings())
      : FakeBus{settings}, drive{process, true}, preconditioner{process}, camera{process} {
    process.rev_per_s = 1.0;
    boards_ = {&drive, &preconditioner, &camera};
  }

  FakeDrive drive;
  FakePreconditioner preconditioner;
  FakeCamera camera;
};

/// Everything: both loops, four zones at 145 C and a nozzle at 150 C, and a sequence; cold.
inline ControllerSettings make_coupled_settings() {
  ControllerSettings settings = make_settings();
  settings.boards.push_back(make_board(config::BoardKind::kHeater, 10));
  settings.boards.push_back(make_board(config::BoardKind::kPreconditioner, 8));
  settings.boards.push_back(make_board(config::BoardKind::kMeltCamera, 9));
  settings.melt = MeltSettings{};
  settings.melt->speed_m_per_s = settings.model.speed_m_per_s;
  settings.zones = ZoneSettings{.zones = {{1, 145.0}, {2, 145.0}, {3, 145.0}, {4, 145.0}, {kNozzleChannel, 150.0}},
                                .band_K = 6.0,
                                .limits = {.max_degC = 185.0}};
  settings.sequence = SequenceSettings{.soak = 1s, .fill = 1s};
  settings.zones->limits.max_step_K = 1000.0;  // Its zones are as warm as they are told.
  return settings;
}

class FakeCoupledRig : public FakeBus {
 public:
  explicit FakeCoupledRig(const ControllerSettings& settings = make_coupled_settings())
      : FakeBus{settings},
        feeder{process},
        drive{process, false},
        pressure{process},
        heater{process},
        preconditioner{process},
        camera{process} {
    process.rev_per_s = 0.0;
    drive.follows_target = true;
    boards_ = {&feeder, &drive, &pressure, &heater, &preconditioner, &camera};
  }

  FakeFeeder feeder;
  FakeDrive drive;
  FakePressure pressure;
  FakeHeater heater;
  FakePreconditioner preconditioner;
  FakeCamera camera;
};

}  // namespace meltbench::machine::testing
