#include "controller/machine/controller.hpp"

#include <catch2/catch.hpp>

#include "tests/controller/machine/fake_rig.hpp"

using namespace meltbench;
using namespace meltbench::machine;
using Catch::Matchers::Contains;
using meltbench::machine::testing::FakeRig;
using meltbench::machine::testing::make_settings;

namespace {

constexpr double kHoldFlow_kg_per_h = 3.788;  // v(0.16) rho0 S_eff theta1, 3600 times; the model's constants.

std::vector<can::StampedFrame> frames_with_id(const FakeRig& rig, std::uint32_t id) {
  std::vector<can::StampedFrame> found;
  for (const can::StampedFrame& stamped : rig.sent) {
    if (stamped.frame.id == id) found.push_back(stamped);
  }
  return found;
}

double last_command_kg_per_h(const FakeRig& rig) {
  const auto commands = frames_with_id(rig, canopen::cob_id::rpdo(1, 5));
  REQUIRE_FALSE(commands.empty());
  return static_cast<double>(canopen::load<float>(commands.back().frame.bytes));
}

bool is_report_of(const can::CanFrame& frame, std::uint8_t node_id, unsigned tpdo) {
  return frame.id == canopen::cob_id::tpdo(tpdo, node_id);
}

}  // namespace

TEST_CASE("Controller: boots all boards and runs within one instant on a bus without delay", "[machine]") {
  FakeRig rig;
  rig.run_for_s(0.0);

  CHECK(rig.controller.state() == ControllerState::kRunning);
  CHECK(rig.feeder.node().state() == canopen::NmtState::kOperational);
  CHECK(rig.drive.node().state() == canopen::NmtState::kOperational);
  CHECK(rig.pressure.node().state() == canopen::NmtState::kOperational);
  CHECK(rig.find_event("ready") != nullptr);
  CHECK(rig.find_event("running") != nullptr);
}

TEST_CASE("Controller: configures heartbeats both ways and the feeder's flow on loss of master", "[machine]") {
  ControllerSettings settings = make_settings();
  settings.heartbeat = 50ms;
  settings.feeder_watchdog_ms = 70;
  FakeRig rig{settings};
  rig.run_for_s(0.0);

  CHECK(rig.feeder.od().at(0x1017).get<std::uint16_t>() == 100);
  CHECK(rig.feeder.od().at(0x1016, 1).get<std::uint32_t>() == ((127U << 16U) | 150U));  // Three heartbeats missed.
  CHECK(rig.feeder.od().at(0x2005).get<float>() == Approx(kHoldFlow_kg_per_h).epsilon(1e-3));
  CHECK(rig.feeder.od().at(0x2006).get<std::uint16_t>() == 70);
  CHECK(rig.drive.od().at(0x1A02, 1).get<std::uint32_t>() == 0x60640020);
}

TEST_CASE("Controller: stops the feed on loss of master if the safe feed is to stop", "[machine]") {
  ControllerSettings settings = make_settings();
  settings.safe_feed = SafeFeed::kStop;
  FakeRig rig{settings};
  rig.run_for_s(0.0);
  CHECK(rig.feeder.od().at(0x2005).get<float>() == 0.0F);
}

TEST_CASE("Controller: sends SYNC on the grid of its period and answers each with a feed command", "[machine]") {
  FakeRig rig;
  rig.run_for_s(0.1);
  const auto syncs = frames_with_id(rig, canopen::cob_id::kSync);
  const auto commands = frames_with_id(rig, canopen::cob_id::rpdo(1, 5));
  REQUIRE(syncs.size() == 11);
  REQUIRE(commands.size() == 11);
  for (std::size_t k = 0; k < syncs.size(); ++k) {
    CHECK(syncs[k].at == Instant{10ms * static_cast<int>(k)});
    CHECK(commands[k].at == syncs[k].at);
  }
  CHECK(rig.signal("controller.tpdos_missed") == 0);
}

TEST_CASE("Controller: the feed command is U rho0 S_eff c in kg/h", "[machine]") {
  FakeRig rig;
  rig.process.rev_per_s = 1.2;  // Not the speed it was told to have: the encoder counts.
  rig.run_for_s(1.0);
  const double U = rig.signal("controller.U_command");
  CHECK(U > 0.5);  // The extruder is emptier than the set point.
  // The encoder's speed is rounded to 1e-5 of itself, the command to a REAL32.
  CHECK(last_command_kg_per_h(rig) == Approx(U * 1240.0 * 2.2383097e-4 * 0.012 * 3600.0).epsilon(2e-5));
  CHECK(rig.signal("controller.flow_command_kg_per_h") == Approx(last_command_kg_per_h(rig)).epsilon(1e-6));
}

TEST_CASE("Controller: estimates the filled length from the pressure on the wire", "[machine]") {
  FakeRig rig;
  rig.process.x_m = 0.13;
  rig.run_for_s(0.05);
  CHECK(rig.signal("controller.x_m") == Approx(0.13).margin(6e-6));  // 1 Pa is 5 um, the encoder's speed adds 1 um.
  CHECK(rig.signal("controller.measurement_age_s") == Approx(0.0005));
}

TEST_CASE("Controller: holds the filled length of the start until the law is told to start", "[machine]") {
  ControllerSettings settings = make_settings();
  settings.law_starts_at = Instant{200ms};
  FakeRig rig{settings};
  const double U0 = settings.model.holding_ratio(0.1);
  rig.run_for_s(0.19);
  CHECK(rig.signal("controller.U_command") == Approx(U0).epsilon(1e-4));
  rig.run_for_s(0.2);
  CHECK(rig.signal("controller.U_command") > 0.8);
}

// --- boot that fails

TEST_CASE("Controller: a board that is somebody else is named with both values, and nothing is started", "[machine]") {
  ControllerSettings settings = make_settings();
  settings.boards[0].identity.product = 0x12345678;
  FakeRig rig{settings};
  rig.run_for_s(1.0);

  CHECK(rig.controller.state() == ControllerState::kFault);
  const Event* event = rig.find_event("identity-mismatch");
  REQUIRE(event != nullptr);
  CHECK(event->severity == Severity::kFault);
  CHECK_THAT(event->text, Contains("feeder (node 5)") && Contains("0x1018:2"));
  CHECK(rig.drive.node().state() == canopen::NmtState::kPreOperational);
  CHECK(frames_with_id(rig, canopen::cob_id::kSync).empty());
}

TEST_CASE("Controller: a board that never boots is named after the boot time-out", "[machine]") {
  ControllerSettings settings = make_settings();
  settings.boot_timeout = 2s;
  FakeRig rig{settings};
  rig.pressure.alive = false;
  rig.run_for_s(1.99);
  CHECK(rig.controller.state() == ControllerState::kBooting);
  rig.run_for_s(2.01);
  CHECK(rig.controller.state() == ControllerState::kFault);
  REQUIRE(rig.find_event("boot-timeout") != nullptr);
  CHECK_THAT(rig.find_event("boot-timeout")->text, Contains("melt_pressure (node 7)") && Contains("no boot-up"));
}

TEST_CASE("Controller: a board that refuses a value ends the boot with the node's reason", "[machine]") {
  ControllerSettings settings = make_settings();
  settings.model.mass_per_length_kg_per_m = 1e6;  // A safe flow far beyond the limit of 0x2005.
  FakeRig rig{settings};
  rig.run_for_s(0.5);
  REQUIRE(rig.find_event("configuration-failed") != nullptr);
  CHECK_THAT(rig.find_event("configuration-failed")->text, Contains("feeder (node 5)") && Contains("0x2005"));
}

TEST_CASE("Controller: an SDO answer that is lost costs a time-out, and the boot goes on", "[machine]") {
  FakeRig rig;
  int answers = 0;
  rig.loses = [&](Instant, const can::CanFrame& frame) {
    return frame.id == canopen::cob_id::sdo_response(6) && ++answers == 5;
  };
  rig.run_for_s(0.3);
  CHECK(rig.controller.state() == ControllerState::kRunning);
  CHECK(rig.signal("controller.sdo_timeouts") == 1);
}

TEST_CASE("Controller: a drive that is off is brought to operation enabled at speed, step by step", "[machine]") {
  FakeRig rig{make_settings(), false};
  rig.run_for_s(0.1);
  CHECK(rig.controller.state() == ControllerState::kRunning);
  CHECK(rig.drive.controlwords == std::vector<std::uint16_t>{0x0006, 0x0007, 0x000F});
  CHECK(rig.drive.od().at(0x60FF).get<std::int32_t>() == 98304);  // 1.5 rev/s of 65536 increments.
  CHECK(rig.drive.od().at(0x6060).get<std::int8_t>() == 3);
}

TEST_CASE("Controller: a drive that turns already is not stopped by the boot", "[machine]") {
  FakeRig rig;
  rig.run_for_s(0.1);
  CHECK(rig.drive.controlwords == std::vector<std::uint16_t>{0x000F});
}

TEST_CASE("Controller: a board that is reset in the middle of its configuration is configured anew", "[machine]") {
  FakeRig rig;
  int requests = 0;
  rig.loses = [&](Instant now, const can::CanFrame& frame) {
    if (frame.id == canopen::cob_id::sdo_request(5) && ++requests == 8) {
      canopen::Frames out;
      rig.feeder.node().on_frame(now, canopen::make_nmt_command(canopen::NmtCommand::kResetNode, 5), out);
      for (const can::CanFrame& boot_up : out) rig.inject(boot_up);
      return true;
    }
    return false;
  };
  rig.run_for_s(0.2);
  CHECK(rig.controller.state() == ControllerState::kRunning);
  CHECK(rig.feeder.od().at(0x1017).get<std::uint16_t>() == 100);
  CHECK(rig.signal("controller.sdo_timeouts") == 0);
}

// --- doubt

TEST_CASE("Controller: a lost heartbeat leads to the safe feed, and says whose it was", "[machine]") {
  FakeRig rig;
  rig.run_for_s(1.0);
  rig.drive.alive = false;
  rig.run_for_s(1.5);

  CHECK(rig.controller.state() == ControllerState::kSafe);
  const Event* event = rig.find_event("heartbeat-lost");
  REQUIRE(event != nullptr);
  CHECK(event->severity == Severity::kFault);
  CHECK_THAT(event->text, Contains("screw_drive (node 6)"));
  CHECK(event->at <= Instant{1300ms});  // Three heartbeats of 100 ms after the last one.
  CHECK(rig.signal("controller.heartbeats_lost") == 1);
  CHECK(last_command_kg_per_h(rig) == Approx(kHoldFlow_kg_per_h).epsilon(1e-3));
  CHECK(rig.signal("controller.state") == static_cast<double>(ControllerState::kSafe));
}

TEST_CASE("Controller: two devices with one node id are noticed by their heartbeats, one that is late is not",
          "[machine]") {
  FakeRig rig;
  rig.run_for_s(1.0);
  const can::CanFrame heartbeat = canopen::make_heartbeat(7, canopen::NmtState::kOperational);
  for (int i = 0; i < 3; ++i) rig.inject(heartbeat);
  rig.run_for_s(1.5);
  CHECK(rig.controller.state() == ControllerState::kRunning);
  for (int i = 1; i <= 10; ++i) {
    rig.inject(heartbeat);
    rig.run_for_s(1.5 + 0.1 * i);
  }
  CHECK(rig.controller.state() == ControllerState::kSafe);
  const Event* event = rig.find_event("node-doubled");
  REQUIRE(event != nullptr);
  CHECK_THAT(event->text, Contains("melt_pressure (node 7)"));
  CHECK(event->at <= Instant{2200ms});  // Within seven periods.
}

TEST_CASE("Controller: the safe state goes on feeding the feeder's watchdog, and is not left again", "[machine]") {
  FakeRig rig;
  rig.run_for_s(1.0);
  rig.drive.alive = false;
  rig.run_for_s(1.499);
  rig.drive.alive = true;
  const std::size_t before = frames_with_id(rig, canopen::cob_id::rpdo(1, 5)).size();
  rig.run_for_s(2.499);
  CHECK(frames_with_id(rig, canopen::cob_id::rpdo(1, 5)).size() == before + 100);
  CHECK(rig.find_event("heartbeat-back") != nullptr);
  CHECK(rig.controller.state() == ControllerState::kSafe);
}

TEST_CASE("Controller: stops the screw in the safe state if it is told to", "[machine]") {
  ControllerSettings settings = make_settings();
  settings.safe_feed = SafeFeed::kStop;
  settings.safe_screw = SafeScrew::kStop;
  FakeRig rig{settings};
  rig.run_for_s(1.0);
  rig.pressure.alive = false;
  rig.run_for_s(1.5);
  CHECK(last_command_kg_per_h(rig) == 0.0);
  CHECK(rig.drive.statusword() == 0x07);  // Quick stop active.
}

TEST_CASE("Controller: an emergency message of a device leads to the safe state in the same instant", "[machine]") {
  FakeRig rig;
  rig.run_for_s(1.0);
  rig.pressure.node().raise_emcy(0x5030, canopen::error_register::kGeneric);
  rig.run_for_s(1.0);
  CHECK(rig.controller.state() == ControllerState::kSafe);
  REQUIRE(rig.find_event("emcy") != nullptr);
  CHECK_THAT(rig.find_event("emcy")->text, Contains("melt_pressure (node 7)") && Contains("5030"));
  CHECK(rig.signal("controller.emcys") == 1);
}

TEST_CASE("Controller: the feeder's own watchdog is a warning, for it ends with the next set point", "[machine]") {
  FakeRig rig;
  rig.run_for_s(1.0);
  rig.feeder.node().raise_emcy(0xFF01, canopen::error_register::kGeneric);
  rig.run_for_s(1.2);
  CHECK(rig.controller.state() == ControllerState::kRunning);
  REQUIRE(rig.find_event("emcy") != nullptr);
  CHECK(rig.find_event("emcy")->severity == Severity::kWarning);
}

TEST_CASE("Controller: a board that is reset while it runs has lost its configuration", "[machine]") {
  FakeRig rig;
  rig.run_for_s(1.0);
  rig.inject(canopen::make_heartbeat(7, canopen::NmtState::kInitialising));
  rig.run_for_s(1.01);
  CHECK(rig.find_event("node-reset") != nullptr);
  CHECK(rig.controller.state() == ControllerState::kSafe);
}

TEST_CASE("Controller: a board that somebody stops is noticed by its heartbeat", "[machine]") {
  FakeRig rig;
  rig.run_for_s(1.0);
  canopen::Frames none;
  rig.feeder.node().on_frame(rig.now(), canopen::make_nmt_command(canopen::NmtCommand::kStop, 5), none);
  rig.run_for_s(1.2);
  REQUIRE(rig.find_event("node-not-operational") != nullptr);
  CHECK_THAT(rig.find_event("node-not-operational")->text, Contains("feeder (node 5)"));
}

TEST_CASE("Controller: a pressure that is lost for a while is bridged, and counted", "[machine]") {
  FakeRig rig;
  rig.loses = [](Instant now, const can::CanFrame& frame) {
    return is_report_of(frame, 7, 1) && now > Instant{1s} && now <= Instant{1500ms};
  };
  rig.run_for_s(2.0);
  CHECK(rig.controller.state() == ControllerState::kRunning);
  CHECK(rig.signal("controller.tpdos_missed") == 50);
  // One command per SYNC all the same: half a period late while an answer is missing.
  CHECK(frames_with_id(rig, canopen::cob_id::rpdo(1, 5)).size() == 201);
}

TEST_CASE("Controller: while an answer is missing the command comes half a period after the SYNC", "[machine]") {
  FakeRig rig;
  rig.run_for_s(0.5);
  CHECK(rig.signal("controller.reaction_s") == 0.0);
  rig.loses = [](Instant, const can::CanFrame& frame) { return is_report_of(frame, 5, 1); };
  rig.run_for_s(0.515);
  CHECK(rig.signal("controller.reaction_s") == Approx(0.005));
}

TEST_CASE("Controller: what stays away longer than the limit leads to the safe state", "[machine]") {
  struct Lost {
    std::uint8_t node_id;
    unsigned tpdo;
    const char* code;
  };
  const Lost lost = GENERATE(Lost{7, 1, "measurement-stale"}, Lost{6, 3, "screw-stale"}, Lost{5, 1, "feed-stale"});
  FakeRig rig;
  rig.loses = [lost](Instant now, const can::CanFrame& frame) {
    return is_report_of(frame, lost.node_id, lost.tpdo) && now > Instant{1s};
  };
  rig.run_for_s(2.9);
  CHECK(rig.controller.state() == ControllerState::kRunning);
  rig.run_for_s(3.1);
  CHECK(rig.controller.state() == ControllerState::kSafe);
  CHECK(rig.find_event(lost.code) != nullptr);
}

TEST_CASE("Controller: a transmitter that says its value is not valid is bridged only for a moment", "[machine]") {
  FakeRig rig;
  rig.run_for_s(1.0);
  rig.pressure.status = 1;
  rig.run_for_s(1.2);
  CHECK(rig.controller.state() == ControllerState::kRunning);
  rig.run_for_s(1.23);
  CHECK(rig.find_event("measurement-implausible") != nullptr);
}

TEST_CASE("Controller: a pressure above the limit and a flooded screw lead to the safe state at once", "[machine]") {
  FakeRig rig;
  rig.run_for_s(1.0);
  SECTION("pressure") {
    rig.process.model.viscosity_Pa_s *= 4.0;
    rig.run_for_s(1.01);
    CHECK(rig.find_event("pressure-high") != nullptr);
  }
  SECTION("flooding") {
    rig.process.x_m = 0.199;
    rig.run_for_s(1.01);
    CHECK(rig.find_event("flooding") != nullptr);
  }
  CHECK(rig.controller.state() == ControllerState::kSafe);
}

TEST_CASE("Controller: a law that is not defined here refuses, and the feed is the safe one", "[machine]") {
  ControllerSettings settings = make_settings();
  settings.law = "paper_predictor";
  settings.model.fluctuation_rad_per_s = 4.0;  // Preset phys: 15 periods within one delay.
  FakeRig rig{settings};
  rig.run_for_s(5.0);
  REQUIRE(rig.find_event("law-refused") != nullptr);
  CHECK_THAT(rig.find_event("law-refused")->text, Contains("paper_predictor"));
  CHECK(rig.controller.state() == ControllerState::kSafe);
  CHECK(last_command_kg_per_h(rig) == Approx(kHoldFlow_kg_per_h).epsilon(1e-3));
}

TEST_CASE("Controller: a link that goes down is a fault, one that comes back is told", "[machine]") {
  FakeRig rig;
  rig.run_for_s(1.0);
  Outbox out;
  rig.controller.wake({rig.now(), {}, LinkState::kDown}, out);
  REQUIRE_FALSE(out.events().empty());
  CHECK(out.events().front().code == "link-down");
  CHECK(rig.controller.state() == ControllerState::kSafe);
}

// --- timeline

TEST_CASE("Controller: a new set point changes law and safe feed at its instant", "[machine]") {
  ControllerSettings settings = make_settings();
  settings.law = "open_loop";
  settings.set_points.push_back({Instant{500ms}, 0.05});
  FakeRig rig{settings};
  rig.run_for_s(0.49);
  CHECK(rig.signal("controller.U_command") == Approx(settings.model.holding_ratio(0.16)));
  rig.run_for_s(0.5);
  CHECK(rig.signal("controller.set_point_m") == 0.05);
  CHECK(rig.signal("controller.U_command") == Approx(settings.model.holding_ratio(0.05)));
  const double safe = settings.model.feed_kg_per_s(settings.model.holding_ratio(0.05), 0.015) * 3600.0;
  CHECK(rig.feeder.od().at(0x2005).get<float>() == Approx(safe).epsilon(1e-6));
  CHECK(rig.find_event("set-point") != nullptr);
}

TEST_CASE("Controller: equal input gives equal frames", "[machine]") {
  FakeRig first, second;
  first.run_for_s(0.5);
  second.run_for_s(0.5);
  CHECK(first.sent == second.sent);
}

TEST_CASE("Controller: the safe state ends with the order to start alone, and the feed goes on from what is delivered",
          "[machine]") {
  ControllerSettings settings = make_settings();
  settings.orders = {{.at = Instant{4s}, .kind = Order::Kind::kSequence, .order = SequenceOrder::kStart}};
  FakeRig rig{settings};
  rig.run_for_s(1.0);
  rig.process.x_m = 0.199;
  rig.run_for_s(1.1);
  REQUIRE(rig.controller.state() == ControllerState::kSafe);
  rig.process.x_m = 0.16;
  rig.run_for_s(3.9);
  CHECK(rig.controller.state() == ControllerState::kSafe);  // Well again, but nobody has asked.
  rig.run_for_s(4.5);
  CHECK(rig.controller.state() == ControllerState::kRunning);
  CHECK(rig.find_event("restart") != nullptr);
  // In the middle, at the set point, fed with what holds it: nothing to correct.
  CHECK(rig.signal("controller.U_command") == Approx(0.2528).epsilon(0.01));
}

TEST_CASE("Controller: started in the middle of a run it goes on from what it finds, without the orders before",
          "[machine]") {
  ControllerSettings settings = make_settings();
  settings.set_points.push_back({Instant{2s}, 0.05});
  settings.set_points.push_back({Instant{6s}, 0.1});
  settings.orders = {{.at = Instant{3s}, .kind = Order::Kind::kScrewSpeed, .value = 1.0}};
  FakeRig rig{settings};
  rig.start_at(Instant{4s});
  rig.process.x_m = 0.16;
  rig.run_for_s(5.0);
  CHECK(rig.controller.state() == ControllerState::kRunning);
  CHECK(rig.find_event("screw-speed") == nullptr);
  CHECK(rig.signal("controller.set_point_m") == 0.16);
  // At the set point, and the feeder brings 2.6 kg/h: the law knows that it does, and asks for what holds.
  CHECK(rig.signal("controller.U_command") > 0.2);
  rig.run_for_s(6.5);
  CHECK(rig.signal("controller.set_point_m") == 0.1);
}

TEST_CASE("Controller: a process that is woken some milliseconds late has not been away", "[machine]") {
  ControllerSettings settings = make_settings();
  settings.law_starts_at = Instant{10s};
  FakeRig rig{settings};
  rig.start_at(Instant{20ms});
  rig.process.x_m = 0.16;
  rig.run_for_s(0.2);
  // It holds what it finds, and not what the feeder brings.
  CHECK(rig.signal("controller.U_command") == Approx(settings.model.holding_ratio(0.16)).epsilon(1e-4));
}

TEST_CASE("Controller: bus-off leads to the safe state at once, error-passive after a second", "[machine]") {
  ControllerSettings settings = make_settings();
  Controller controller{settings};
  Outbox out;
  const auto wake = [&](Nanos at, can::ErrorState state) {
    out.clear();
    const std::array<can::ErrorState, 1> nodes{state};
    Wakeup in;
    in.now = Instant{at};
    in.nodes = nodes;
    controller.wake(in, out);
    for (const Event& event : out.events()) {
      if (event.severity == Severity::kFault) return event.code;
    }
    return std::string{};
  };
  CHECK(wake(0ms, can::ErrorState::kActive).empty());
  CHECK(wake(10ms, can::ErrorState::kPassive).empty());
  CHECK(wake(500ms, can::ErrorState::kPassive).empty());
  CHECK(wake(600ms, can::ErrorState::kBusOff) == "bus-off");
}
