#include <catch2/catch.hpp>

#include "controller/machine/controller.hpp"
#include "tests/controller/machine/fake_rig.hpp"

using namespace meltbench;
using namespace meltbench::machine;
using Catch::Matchers::Contains;
using meltbench::machine::testing::FakeCoupledRig;
using meltbench::machine::testing::FakeMeltRig;
using meltbench::machine::testing::make_coupled_settings;
using meltbench::machine::testing::make_melt_settings;

namespace {

Order make_order(Nanos at, SequenceOrder what) {
  return {.at = Instant{at}, .kind = Order::Kind::kSequence, .order = what};
}

/// Started at 1 s, warm at 2 s; running at 5 s.
ControllerSettings make_started_settings() {
  ControllerSettings settings = make_coupled_settings();
  settings.orders = {make_order(1s, SequenceOrder::kStart)};
  return settings;
}

void warm_up(FakeCoupledRig& rig) {
  rig.run_for_s(2.0);
  rig.process.T_zone_degC = 147.0;
  rig.process.x_m = 0.15;
  rig.run_for_s(8.0);
}

double sequence_of(const FakeCoupledRig& rig) {
  return rig.signal("controller.sequence");
}

}  // namespace

// --- the melting front alone

TEST_CASE("Controller of the front: boots three boards and closes the loop in the preconditioner", "[machine]") {
  FakeMeltRig rig;
  rig.run_for_s(0.0);
  CHECK(rig.controller.state() == ControllerState::kRunning);
  CHECK(rig.preconditioner.mode() == 2);
  CHECK(rig.preconditioner.gain_W_per_m2K() == Approx(9048.625));  // ρ_s c_s b/2 at 10 mm/s.
  CHECK(rig.preconditioner.feedforward_W_per_m2() == Approx(-4.35623479));
  CHECK(rig.preconditioner.T_reference_degC() == Approx(rig.signal("controller.T_ref_degC")));
  CHECK(rig.signal("controller.front_m") == Approx(0.05));
  CHECK(rig.signal("controller.T_20_degC") == Approx(135.0));  // 50 mm: the front.
}

TEST_CASE("Controller of the front: PI and sampled laws ask for the flux itself", "[machine]") {
  ControllerSettings settings = make_melt_settings();
  settings.melt->law = "pi";
  FakeMeltRig rig{settings};
  rig.process.front_m = 0.03;
  rig.run_for_s(0.0);
  CHECK(rig.preconditioner.mode() == 1);
  CHECK(rig.preconditioner.feedforward_W_per_m2() == Approx(-4.35623479 - 6.0));
}

TEST_CASE("Controller of the front: a new set point is taken at its instant", "[machine]") {
  ControllerSettings settings = make_melt_settings();
  settings.orders = {{.at = Instant{500ms}, .kind = Order::Kind::kFrontSetPoint, .value = 0.06}};
  FakeMeltRig rig{settings};
  rig.process.front_m = 0.02;
  rig.process.T_inlet_degC = 115.0;
  rig.run_for_s(0.49);
  CHECK(rig.signal("controller.front_set_m") == 0.05);
  const double before = rig.preconditioner.T_reference_degC();
  rig.run_for_s(0.5);
  CHECK(rig.signal("controller.front_set_m") == 0.06);
  // c/b ΔH/c_s = 2.06 K of inlet for every millimetre.
  CHECK(rig.preconditioner.T_reference_degC() < before - 15.0);
  CHECK(rig.find_event("front-set-point") != nullptr);
}

TEST_CASE("Controller of the front: the timeline moves the screw by its ramp", "[machine]") {
  ControllerSettings settings = make_melt_settings();
  settings.screw_ramp_rev_per_s2 = 0.5;
  settings.orders = {{.at = Instant{1s}, .kind = Order::Kind::kScrewSpeed, .value = 1.5}};
  FakeMeltRig rig{settings};
  rig.drive.follows_target = true;
  rig.run_for_s(1.5);
  CHECK(rig.process.rev_per_s == Approx(1.25).margin(0.011));
  rig.run_for_s(2.5);
  CHECK(rig.process.rev_per_s == Approx(1.5));
  CHECK(rig.signal("controller.gain_speed_m_per_s") == Approx(0.015).epsilon(1e-4));
}

TEST_CASE("Controller of the front: a camera that sees nothing trips by travel, and the flux goes off", "[machine]") {
  FakeMeltRig rig;
  rig.run_for_s(1.0);
  rig.camera.status = 1;
  rig.run_for_s(2.0);
  CHECK(rig.controller.state() == ControllerState::kRunning);
  rig.run_for_s(5.0);  // 0.5 s/b = 2.5 s.
  CHECK(rig.controller.state() == ControllerState::kSafe);
  REQUIRE(rig.find_event("front-stale") != nullptr);
  CHECK_THAT(rig.find_event("front-stale")->text, Contains("inlet flux off"));
  CHECK(rig.preconditioner.mode() == 0);
}

TEST_CASE("Controller of the front: a front that is never seen is a fault", "[machine]") {
  FakeMeltRig rig;
  rig.camera.status = 1;
  rig.run_for_s(1.9);
  CHECK(rig.controller.state() == ControllerState::kReady);
  CHECK(rig.preconditioner.mode() == 0);
  rig.run_for_s(2.1);
  CHECK(rig.find_event("front-not-measured") != nullptr);
  CHECK(rig.controller.state() == ControllerState::kSafe);
}

TEST_CASE("Controller of the front: granules that would stick lead to the safe state at once", "[machine]") {
  FakeMeltRig rig;
  rig.run_for_s(1.0);
  rig.process.T_inlet_degC = 145.2;
  rig.run_for_s(1.01);
  CHECK(rig.find_event("superheated") != nullptr);
  CHECK(rig.preconditioner.mode() == 0);
}

TEST_CASE("Controller of the front: a lost report costs one cycle of waiting and nothing else", "[machine]") {
  FakeMeltRig rig;
  rig.loses = [](Instant now, const can::CanFrame& frame) {
    return now > Instant{1s} && now < Instant{1200ms} && frame.id == canopen::cob_id::tpdo(2, 8);
  };
  rig.run_for_s(2.0);
  CHECK(rig.controller.state() == ControllerState::kRunning);
  CHECK(rig.signal("controller.tpdos_missed") == 19);
}

TEST_CASE("Controller of the front: a running cycle allocates nothing", "[machine]") {
  FakeMeltRig rig;
  rig.run_for_s(1.0);
  const auto before = rig.allocations;
  rig.run_for_s(3.0);
  CHECK(rig.allocations == before);
}

// --- everything

TEST_CASE("Coupled controller: cold means heaters off, screw at rest and no feed, with all boards alive", "[machine]") {
  FakeCoupledRig rig;
  rig.run_for_s(5.0);
  CHECK(rig.controller.state() == ControllerState::kReady);
  CHECK(rig.heater.release() == 0);
  CHECK(rig.process.rev_per_s == 0.0);
  CHECK(rig.feeder.flow_kg_per_h() == 0.0);
  CHECK(rig.preconditioner.mode() == 0);
  CHECK(rig.feeder.od().at(0x2005).get<float>() == 0.0F);  // On loss of master a standing screw must not be fed.
  CHECK(rig.find_event("ready") != nullptr);
}

TEST_CASE("Coupled controller: start heats, soaks, turns the screw, and runs both loops", "[machine]") {
  FakeCoupledRig rig{make_started_settings()};
  rig.run_for_s(1.5);
  CHECK(rig.heater.release() == 0x1F);
  CHECK(rig.heater.set_degC(1) == Approx(145.0));
  CHECK(rig.heater.set_degC(5) == Approx(150.0));
  CHECK(sequence_of(rig) == static_cast<double>(SequencePhase::kHeating));
  rig.process.T_zone_degC = 147.0;
  rig.process.x_m = 0.15;
  rig.run_for_s(1.8);
  CHECK(sequence_of(rig) == static_cast<double>(SequencePhase::kSoaking));
  CHECK(rig.process.rev_per_s == 0.0);
  rig.run_for_s(3.5);
  CHECK(sequence_of(rig) == static_cast<double>(SequencePhase::kFilling));
  CHECK(rig.process.rev_per_s > 0.5);
  rig.run_for_s(8.0);
  CHECK(sequence_of(rig) == static_cast<double>(SequencePhase::kRunning));
  CHECK(rig.process.rev_per_s == Approx(1.5));
  CHECK(rig.preconditioner.mode() == 2);
  CHECK(rig.feeder.flow_kg_per_h() > 0.0);
  CHECK(rig.feeder.od().at(0x2005).get<float>() == Approx(3.788).epsilon(1e-3));
  CHECK(rig.signal("controller.T_barrel_degC") == Approx(147.0));
}

TEST_CASE("Coupled controller: hold goes slower, purge stops the feed, shut down ends cold", "[machine]") {
  ControllerSettings settings = make_started_settings();
  settings.sequence->purge = 3s;
  settings.orders.push_back(make_order(10s, SequenceOrder::kHold));
  settings.orders.push_back(make_order(15s, SequenceOrder::kShutDown));
  FakeCoupledRig rig{settings};
  warm_up(rig);
  rig.run_for_s(14.0);
  CHECK(rig.process.rev_per_s == Approx(0.75).epsilon(1e-4));
  CHECK(rig.feeder.od().at(0x2005).get<float>() == Approx(0.5 * 3.788).epsilon(1e-3));  // Safe is in step, too.
  CHECK(rig.feeder.flow_kg_per_h() > 0.0);
  rig.process.x_m = 0.1;
  rig.run_for_s(16.0);
  CHECK(rig.feeder.flow_kg_per_h() == 0.0);
  CHECK(rig.process.rev_per_s > 0.5);
  CHECK(rig.heater.release() == 0x1F);
  rig.run_for_s(25.0);
  CHECK(rig.process.rev_per_s == 0.0);
  CHECK(rig.heater.release() == 0);
  CHECK(rig.preconditioner.mode() == 0);
  CHECK(rig.controller.state() == ControllerState::kRunning);  // A shut-down that was asked for is no fault.
}

TEST_CASE("Coupled controller: any doubt takes heat and flux away and feeds at the safe rate", "[machine]") {
  FakeCoupledRig rig{make_started_settings()};
  warm_up(rig);
  REQUIRE(sequence_of(rig) == static_cast<double>(SequencePhase::kRunning));
  rig.heater.status[2] = 3;
  rig.run_for_s(8.2);
  CHECK(rig.controller.state() == ControllerState::kSafe);
  REQUIRE(rig.find_event("zone-sensor-open") != nullptr);
  CHECK_THAT(rig.find_event("zone-sensor-open")->text, Contains("zone 3") && Contains("heaters off"));
  CHECK(rig.heater.release() == 0);
  CHECK(rig.preconditioner.mode() == 0);
  CHECK(rig.feeder.flow_kg_per_h() == Approx(3.788).epsilon(1e-3));
  CHECK(rig.process.rev_per_s == Approx(1.5));
}

TEST_CASE("Coupled controller: a cold zone trips where it touches the melt, not before the front", "[machine]") {
  FakeCoupledRig rig{make_started_settings()};
  warm_up(rig);
  REQUIRE(sequence_of(rig) == static_cast<double>(SequencePhase::kRunning));
  CHECK(rig.signal("controller.liquid_margin_K") == Approx(12.0));
  rig.heater.colder_K[0] = 30.0;  // Granules only, up to half of the barrel.
  rig.run_for_s(8.5);
  CHECK(rig.controller.state() == ControllerState::kRunning);
  CHECK(rig.signal("controller.liquid_margin_K") == Approx(12.0));
  rig.heater.colder_K[3] = 21.0;
  rig.run_for_s(9.0);
  CHECK(rig.signal("controller.liquid_margin_K") == Approx(-9.0));  // (7) may be violated, within the limit.
  CHECK(rig.controller.state() == ControllerState::kRunning);
  rig.heater.colder_K[3] = 22.2;
  rig.run_for_s(9.5);
  CHECK(rig.controller.state() == ControllerState::kSafe);
  REQUIRE(rig.find_event("melt-freezing") != nullptr);
  CHECK(rig.heater.release() == 0);
}

TEST_CASE("Coupled controller: a zone is tuned by the board when the timeline says so, and the outcome told",
          "[machine]") {
  ControllerSettings settings = make_started_settings();
  settings.orders.push_back({.at = Instant{9s}, .kind = Order::Kind::kAutotune, .index = 2});
  settings.orders.push_back({.at = Instant{9s}, .kind = Order::Kind::kAutotune, .index = 5});
  FakeCoupledRig rig{settings};
  warm_up(rig);
  CHECK(rig.heater.od().at(0x2110, 2).get<std::uint8_t>() == 0);
  rig.run_for_s(9.5);
  CHECK(rig.heater.od().at(0x2110, 2).get<std::uint8_t>() == 1);
  CHECK(rig.heater.od().at(0x2110, 5).get<std::uint8_t>() == 1);
  CHECK(rig.find_event("autotune") != nullptr);
  rig.heater.state = {0, 0x40, 0, 0, 0x40};
  rig.run_for_s(10.5);
  CHECK(rig.find_event("autotune-over") == nullptr);
  rig.heater.state = {};
  std::uint8_t state = 0;
  std::string outcome;
  SECTION("done") {
    state = 2;
    outcome = "zone 2: tuned; band 5.5 K, integral 60.0 s, derivative 4.0 s";
  }
  SECTION("failed") {
    state = 3;
    outcome = "zone 2: not tuned, the board keeps what it had; band 5.5 K";
    rig.heater.node().raise_emcy(0xFF14, canopen::error_register::kGeneric);
  }
  rig.heater.od().at(0x2111, 2).set(state);
  rig.heater.od().at(0x7450, 2).set(std::int16_t{55});
  rig.heater.od().at(0x7452, 2).set(std::int16_t{600});
  rig.heater.od().at(0x7454, 2).set(std::int16_t{40});
  rig.run_for_s(11.5);
  REQUIRE(rig.find_event("autotune-over") != nullptr);
  CHECK_THAT(rig.find_event("autotune-over")->text, Contains(outcome));
  CHECK(rig.find_event("autotune-over")->severity == (state == 2 ? Severity::kInfo : Severity::kWarning));
  CHECK(rig.controller.state() == ControllerState::kRunning);  // What cannot be tuned goes on as before.
}

TEST_CASE("Coupled controller: doubt while the screw stands feeds nothing", "[machine]") {
  FakeCoupledRig rig{make_started_settings()};
  rig.run_for_s(1.5);
  rig.heater.status[0] = 3;
  rig.run_for_s(1.8);
  CHECK(rig.controller.state() == ControllerState::kSafe);
  CHECK(rig.heater.release() == 0);
  CHECK(rig.feeder.flow_kg_per_h() == 0.0);
}

TEST_CASE("Coupled controller: a heater at full power without heat trips, one that is too hot as well", "[machine]") {
  ControllerSettings settings = make_started_settings();
  settings.zones->limits.window = 5s;
  FakeCoupledRig rig{settings};
  rig.run_for_s(1.5);
  SECTION("no heat") {
    rig.process.output = 1.0;
    rig.run_for_s(6.0);
    CHECK(rig.controller.state() == ControllerState::kRunning);
    rig.run_for_s(7.0);
    CHECK(rig.find_event("zone-not-rising") != nullptr);
  }
  SECTION("too hot") {
    rig.process.T_zone_degC = 185.1;
    rig.run_for_s(1.7);
    CHECK(rig.find_event("zone-over-temperature") != nullptr);
  }
  CHECK(rig.heater.release() == 0);
}

TEST_CASE("Coupled controller: a heater that goes silent on its PDOs trips by age", "[machine]") {
  FakeCoupledRig rig{make_started_settings()};
  rig.run_for_s(1.5);
  rig.loses = [](Instant, const can::CanFrame& frame) { return frame.id == canopen::cob_id::tpdo(2, 10); };
  rig.run_for_s(4.0);
  REQUIRE(rig.find_event("zone-stale") != nullptr);
  CHECK_THAT(rig.find_event("zone-stale")->text, Contains("zone 3"));
}

TEST_CASE("Coupled controller: heating that never ends is a fault", "[machine]") {
  ControllerSettings settings = make_started_settings();
  settings.sequence->heat_timeout = 10s;
  FakeCoupledRig rig{settings};
  rig.run_for_s(11.9);
  CHECK(rig.controller.state() == ControllerState::kRunning);
  rig.run_for_s(12.1);
  CHECK(rig.find_event("sequence-overdue") != nullptr);
  CHECK(rig.heater.release() == 0);
}

TEST_CASE("Coupled controller: an order that means nothing is refused and told", "[machine]") {
  ControllerSettings settings = make_coupled_settings();
  settings.orders = {make_order(1s, SequenceOrder::kHold)};
  FakeCoupledRig rig{settings};
  rig.run_for_s(1.0);
  REQUIRE(rig.find_event("order-refused") != nullptr);
  CHECK(rig.find_event("order-refused")->severity == Severity::kWarning);
}

TEST_CASE("Coupled controller: another material changes model, barrel and front together", "[machine]") {
  ControllerSettings settings = make_started_settings();
  MaterialSettings ldpe;
  ldpe.name = "ldpe";
  ldpe.model.T_melt_degC = 110.0;
  ldpe.T_barrel_degC = 120.0;
  ldpe.front_set_m = 0.06;
  settings.materials = {ldpe};
  settings.orders.push_back({.at = Instant{9s}, .kind = Order::Kind::kMaterial, .index = 0});
  FakeCoupledRig rig{settings};
  warm_up(rig);
  rig.process.T_inlet_degC = 105.0;
  rig.run_for_s(9.2);
  CHECK(rig.heater.set_degC(1) == Approx(120.0));
  CHECK(rig.heater.set_degC(5) == Approx(150.0));
  CHECK(rig.signal("controller.front_set_m") == 0.06);
  CHECK(rig.signal("controller.T_40_degC") == 110.0);  // At the nozzle: melt.
  CHECK(rig.controller.state() == ControllerState::kRunning);
}

TEST_CASE("Coupled controller: a running cycle allocates nothing", "[machine]") {
  FakeCoupledRig rig{make_started_settings()};
  warm_up(rig);
  rig.run_for_s(9.0);
  const auto before = rig.allocations;
  rig.run_for_s(11.0);
  CHECK(rig.allocations == before);
}

TEST_CASE("Controller: started beside a screw that turns it goes on from the speed that it finds", "[machine]") {
  ControllerSettings settings = make_coupled_settings();
  settings.sequence.reset();
  settings.orders = {{.at = Instant{9s}, .kind = Order::Kind::kScrewSpeed, .value = 1.0}};  // So it is its screw.
  FakeCoupledRig rig{settings};
  rig.drive.follows_target = false;
  rig.process.rev_per_s = 1.2;
  rig.process.T_zone_degC = 147.0;
  rig.start_at(Instant{4s});
  rig.run_for_s(4.2);
  const auto first = std::find_if(rig.sent.begin(), rig.sent.end(), [](const can::StampedFrame& sent) {
    return sent.frame.id == canopen::cob_id::rpdo(drive_object::kVelocityRpdo, 6);
  });
  REQUIRE(first != rig.sent.end());
  const auto inc_per_s = canopen::load<std::int32_t>(first->frame.data(), 2);
  CHECK(inc_per_s >= 1.2 * 65536);
  CHECK(inc_per_s < 1.25 * 65536);
}
