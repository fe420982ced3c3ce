#include "controller/machine/settings.hpp"

#include <catch2/catch.hpp>
#include <filesystem>
#include <fstream>
#include <string>

#include "protocols/config/toml.hpp"

using namespace meltbench;
using namespace meltbench::machine;
using Catch::Matchers::Contains;

namespace {

const std::string kBoards = std::string{MELTBENCH_SOURCE_DIR} + "/fixtures/boards/";

std::string make_board(const std::string& kind, int node_id, const std::string& eds) {
  return "[board." + kind + "]\nkind = \"" + kind + "\"\nnode_id = " + std::to_string(node_id) + "\neds = \"" +
         kBoards + eds + "\"\n";
}

/// A rig with the shortest possible text, plus what a test adds to [controller] and after it.
std::string make_rig(const std::string& controller = "set_point_m = 0.16\n", const std::string& rest = "") {
  return "[rig]\nname = \"test\"\n" + make_board("feeder", 5, "feeder.eds") +
         make_board("screw_drive", 6, "screw_drive.eds") + make_board("melt_pressure", 7, "melt_pressure.eds") +
         "[controller]\n" + controller + rest;
}

ControllerSettings read(const std::string& text) {
  return read_settings(config::Section{std::make_shared<const config::Table>(config::parse_toml(text, "rig.toml"))});
}

struct Complaint {
  std::string what, hint;
};

Complaint complain(const std::string& text) {
  try {
    (void)read(text);
  } catch (const config::ConfigError& error) {
    return {error.what(), error.hint()};
  }
  return {};
}

}  // namespace

TEST_CASE("Controller settings: a rig with a set point only has every default", "[machine]") {
  const ControllerSettings settings = read(make_rig());
  CHECK(settings.node_id == 127);
  CHECK(settings.law == "exact_predictor");
  CHECK(settings.sync_period == 10ms);
  CHECK(settings.time_stamped);
  CHECK(settings.slope_margin_per_m == 30.0);
  CHECK(settings.max_fill == 0.9);
  CHECK(settings.model.speed_m_per_s == 0.015);
  CHECK(settings.model.fluctuation_rad_per_s == Approx(4.0 / 60.0));
  CHECK(settings.limits.max_age == 2s);
  CHECK(settings.limits.max_filled_length_m == Approx(0.198));
  // Twice 50.5 kPa, the pressure of a full screw: v(0.2) rho0 S_eff theta1 eta/Kd.
  CHECK(settings.limits.max_pressure_Pa == Approx(1.01e5).epsilon(1e-3));
  CHECK_FALSE(settings.feeder_watchdog_ms.has_value());
  REQUIRE(settings.set_points.size() == 1);
  CHECK(settings.set_points[0].x_m == 0.16);
}

TEST_CASE("Controller settings: identities come from the boards' EDS files", "[machine]") {
  const ControllerSettings settings = read(make_rig());
  const BoardSettings& feeder = settings.board(config::BoardKind::kFeeder);
  CHECK(feeder.name == "feeder");
  CHECK(feeder.node_id == 5);
  CHECK(feeder.identity.product == 0x4D42'0001);
  CHECK(settings.board(config::BoardKind::kScrewDrive).identity.device_type == 0x0001'0192);
  CHECK(settings.board(config::BoardKind::kMeltPressure).identity.revision == 0x0001'0000);
}

TEST_CASE("Controller settings: the rigs of the fixtures can be read", "[machine]") {
  const std::string name = GENERATE("bizone.toml", "bizone_paper.toml", "melt.toml", "coupled.toml");
  const auto file = std::filesystem::path{MELTBENCH_SOURCE_DIR} / "fixtures" / "rigs" / name;
  CHECK_NOTHROW(read_settings(config::Section{config::read_toml_file(file)}));
}

TEST_CASE("Controller settings: the model follows the emulated plant's preset, and can differ from it", "[machine]") {
  const std::string plant = "[plant]\npreset = \"paper\"\nfluctuation_case = \"B\"\n";
  const ControllerSettings same = read(make_rig("set_point_m = 0.16\n", plant));
  CHECK(same.model.speed_m_per_s == 0.9);
  CHECK(same.model.fluctuation == 0.4);
  CHECK(same.model.fluctuation_rad_per_s == Approx(0.8));

  const ControllerSettings other = read(
      make_rig("set_point_m = 0.16\n", "[controller.model]\npreset = \"slow\"\npressure_flow_m4 = 1e-8\n" + plant));
  CHECK(other.model.speed_m_per_s == 0.015);
  CHECK(other.model.theta2_per_m == Approx(2.45e-5 / (1e-8 * 1240.0)));
}

TEST_CASE("Controller settings: a timeline of set points is read in the order of time", "[machine]") {
  const std::string events =
      "[[event]]\nat_s = 20\ntarget = \"controller\"\naction = \"set_point\"\nvalue = 0.12\n"
      "[[event]]\nat_s = 10\ntarget = \"controller\"\naction = \"set_point\"\nvalue = 0.1\n"
      "[[event]]\nat_s = 5\ntarget = \"plant\"\naction = \"explode\"\nhow = 3\n";
  const ControllerSettings settings = read(make_rig("set_point_m = 0.16\n", events));
  REQUIRE(settings.set_points.size() == 3);
  CHECK(settings.set_points[1].from == Instant{10s});
  CHECK(settings.set_points[1].x_m == 0.1);
  CHECK(settings.set_points[2].x_m == 0.12);
}

TEST_CASE("Controller settings: a set point outside the screw is refused with its place and a hint", "[machine]") {
  const Complaint complaint = complain(make_rig("set_point_m = 0.3\n"));
  CHECK_THAT(complaint.what, Contains("rig.toml:") && Contains("controller.set_point_m = 0.3") && Contains("0.2"));
  CHECK_THAT(complaint.hint, Contains("inside the screw"));
  CHECK_THAT(complain(make_rig("set_point_m = 0\n")).what, Contains("controller.set_point_m"));
  const std::string event = "[[event]]\nat_s = 1\ntarget = \"controller\"\naction = \"set_point\"\nvalue = 0.21\n";
  CHECK_THAT(complain(make_rig("set_point_m = 0.16\n", event)).what, Contains("value = 0.21"));
}

TEST_CASE("Controller settings: what does not fit is refused, each for its own reason", "[machine]") {
  CHECK_THAT(complain(make_rig("")).what, Contains("set_point_m"));
  const Complaint misspelt = complain(make_rig("set_point_m = 0.16\nslope_margn = 20\n"));
  CHECK_THAT(misspelt.what, Contains("slope_margn"));
  CHECK_THAT(misspelt.hint, Contains("slope_margin"));
  CHECK_THAT(complain(make_rig("set_point_m = 0.16\nlaw = \"magic\"\n")).what, Contains("law"));
  CHECK_THAT(complain(make_rig("set_point_m = 0.16\nv_max = 0.2\n")).what, Contains("v_max"));
  CHECK_THAT(complain(make_rig("set_point_m = 0.16\nv_max = 1\n")).what, Contains("v_max"));
  CHECK_THAT(complain(make_rig("set_point_m = 0.16\nsafe_screw = \"stop\"\n")).what, Contains("safe_screw"));
  CHECK(complain(make_rig("set_point_m = 0.16\nsafe_screw = \"stop\"\nsafe_feed = \"stop\"\n")).what.empty());
  const std::string event = "[[event]]\nat_s = 1\ntarget = \"controller\"\naction = \"dance\"\n";
  CHECK_THAT(complain(make_rig("set_point_m = 0.16\n", event)).what, Contains("action"));
}

TEST_CASE("Controller settings: a rig without a feeder, or with two, is refused", "[machine]") {
  const std::string head = "[rig]\nname = \"test\"\n[controller]\nset_point_m = 0.16\n";
  const std::string others =
      make_board("screw_drive", 6, "screw_drive.eds") + make_board("melt_pressure", 7, "melt_pressure.eds");
  CHECK_THAT(complain(head + others).what, Contains("feeder"));
  std::string second = make_board("feeder", 9, "feeder.eds");
  second.replace(second.find("[board.feeder]"), 14, "[board.second]");
  CHECK_THAT(complain(head + others + make_board("feeder", 5, "feeder.eds") + second).what, Contains("board.feeder"));
}

TEST_CASE("Controller settings: an EDS that is none is refused with its own place", "[machine]") {
  const auto file = std::filesystem::temp_directory_path() / "meltbench_settings_test.eds";
  std::ofstream{file} << "[1000]\nParameterName=Device type\nDataType=what\n";
  std::string text = make_rig();
  const std::string good = kBoards + "feeder.eds";
  text.replace(text.find(good), good.size(), file.string());
  CHECK_THAT(complain(text).what, Contains("eds") && Contains("meltbench_settings_test.eds"));
  std::filesystem::remove(file);
}

// --- melting front, zones, sequence

namespace {

const std::string kDrive = make_board("screw_drive", 6, "screw_drive.eds");
const std::string kFrontBoards =
    make_board("preconditioner", 8, "preconditioner.eds") + make_board("melt_camera", 9, "melt_camera.eds");
const std::string kHeater = make_board("heater", 10, "heater.eds");

/// A rig of the melting front alone, plus what a test adds to [controller.melt] and after it.
std::string make_melt_rig(const std::string& melt = "front_set_point_m = 0.05\n", const std::string& rest = "") {
  return "[rig]\nname = \"test\"\n" + kDrive + kFrontBoards + "[controller]\n[controller.melt]\n" + melt + rest;
}

/// Everything.
std::string make_coupled_rig(const std::string& rest = "") {
  return make_rig("set_point_m = 0.08\n", kFrontBoards + kHeater +
                                              "[controller.melt]\nfront_set_point_m = 0.08\n"
                                              "[controller.zones]\nbarrel_degC = [140, 145]\nnozzle_degC = 150\n" +
                                              rest);
}

}  // namespace

TEST_CASE("Controller settings: a rig of the melting front needs a set point and has every default", "[machine]") {
  const ControllerSettings settings = read(make_melt_rig());
  CHECK_FALSE(settings.has_length_loop());
  CHECK_FALSE(settings.zones);
  CHECK_FALSE(settings.sequence);
  REQUIRE(settings.melt);
  CHECK(settings.melt->law == "output_feedback");
  CHECK(settings.melt->front_set_m == 0.05);
  CHECK(settings.melt->model.T_melt_degC == 135.0);
  CHECK(settings.melt->model.solid.barrel_exchange_W_per_m3K == 2e4);
  CHECK(settings.melt->T_barrel_degC == 145.0);
  CHECK(settings.melt->speed_m_per_s == 0.002);
  CHECK(settings.run_speed_rev_per_s() == Approx(0.2));
  CHECK_THAT(complain(make_melt_rig("")).what, Contains("front_set_point_m"));
  CHECK_THAT(complain(make_melt_rig("front_set_point_m = 0.1\n")).what, Contains("front_set_point_m = 0.1"));
}

TEST_CASE("Controller settings: the model of the front follows the emulated plant, and can differ", "[machine]") {
  const std::string plant = "[plant]\nkind = \"melt\"\npreset = \"bench\"\nspeed_m_per_s = 0.01\n";
  const ControllerSettings same = read(make_melt_rig("front_set_point_m = 0.05\n", plant));
  CHECK(same.melt->model.solid.barrel_exchange_W_per_m3K == 9e4);
  CHECK(same.melt->speed_m_per_s == 0.01);
  const ControllerSettings other =
      read(make_melt_rig("front_set_point_m = 0.05\n",
                         "[controller.melt.model]\nbarrel_exchange_W_per_m3K = 1e5\nspeed_m_per_s = 0.012\n" + plant));
  CHECK(other.melt->model.solid.barrel_exchange_W_per_m3K == 1e5);
  CHECK(other.melt->speed_m_per_s == 0.012);
}

TEST_CASE("Controller settings: a coupled rig has both loops, its length from one screw, its melt from the material",
          "[machine]") {
  const ControllerSettings settings =
      read(make_coupled_rig("[controller.sequence]\nsoak_s = 20\n[plant]\nkind = \"coupled\"\nmaterial = \"ldpe\"\n"));
  REQUIRE(settings.melt);
  REQUIRE(settings.zones);
  REQUIRE(settings.sequence);
  CHECK(settings.has_length_loop());
  CHECK(settings.melt->model.length_m == 0.2);
  CHECK(settings.melt->model.solid.barrel_exchange_W_per_m3K == 9e4);
  CHECK(settings.melt->model.T_melt_degC == 110.0);
  CHECK(settings.model.mass_per_length_kg_per_m == Approx(855.0 * 2.2383097e-4));
  CHECK(settings.viscosity.per_K == Approx(49e3 / (8.314 * 393.15 * 393.15)));
  CHECK(settings.viscosity.at_degC == 120.0);
  REQUIRE(settings.zones->zones.size() == 3);
  CHECK(settings.zones->zones[1].set_degC == 145.0);
  CHECK(settings.zones->zones[2].channel == kNozzleChannel);
  CHECK(settings.zones->limits.max_degC == 190.0);
  CHECK(settings.sequence->soak == 20s);
  CHECK(settings.sequence->hold_rev_per_s == Approx(0.75));
}

TEST_CASE("Controller settings: boards that make half a loop are refused with the other half", "[machine]") {
  const std::string head = "[rig]\nname = \"test\"\n" + kDrive;
  const std::string tail = "[controller]\n[controller.melt]\nfront_set_point_m = 0.05\n";
  CHECK_THAT(complain(head + make_board("melt_camera", 9, "melt_camera.eds") + tail).what, Contains("preconditioner"));
  CHECK_THAT(complain(head + kFrontBoards + make_board("feeder", 5, "feeder.eds") + tail).what,
             Contains("melt_pressure"));
  CHECK_THAT(complain("[rig]\nname = \"test\"\n" + kFrontBoards + tail).what, Contains("screw_drive"));
  CHECK_THAT(complain(make_melt_rig("front_set_point_m = 0.05\n", kHeater)).what, Contains("zones"));
}

TEST_CASE("Controller settings: zones want one number each, and the limit lies above them", "[machine]") {
  const auto zones = [](const std::string& text) {
    return complain(make_melt_rig("front_set_point_m = 0.05\n", kHeater + "[controller.zones]\n" + text)).what;
  };
  CHECK(zones("barrel_degC = [145]\n").empty());
  CHECK_THAT(zones("barrel_degC = []\n"), Contains("1 to 4"));
  CHECK_THAT(zones("barrel_degC = [1, 2, 3, 4, 5]\n"), Contains("1 to 4"));
  CHECK_THAT(zones("barrel_degC = [145]\nmax_degC = 140\n"), Contains("max_degC = 140"));
}

TEST_CASE("Controller settings: the timeline speaks to front, screw, zones and sequence", "[machine]") {
  const auto event = [](const std::string& action, const std::string& keys) {
    return "[[event]]\nat_s = 1\ntarget = \"controller\"\naction = \"" + action + "\"\n" + keys;
  };
  const ControllerSettings settings = read(make_coupled_rig(
      "[controller.sequence]\n[controller.material.soft]\nmaterial = \"ldpe\"\n" +
      event("front_set_point", "value = 0.09\n") + event("screw_speed", "rpm = 60\n") +
      event("zone_set_point", "value = 150\n") + event("material", "name = \"soft\"\n") + event("shut_down", "")));
  REQUIRE(settings.orders.size() == 5);
  CHECK(settings.orders[0].value == 0.09);
  CHECK(settings.orders[1].value == Approx(1.0));
  CHECK(settings.orders[2].value == 150.0);
  CHECK(settings.orders[3].index == 0);
  CHECK(settings.orders[4].order == SequenceOrder::kShutDown);
  REQUIRE(settings.materials.size() == 1);
  CHECK(settings.materials[0].T_barrel_degC == 120.0);
  CHECK(settings.materials[0].filled.theta2_per_m < settings.model.theta2_per_m);  // Denser than HDPE's melt.

  CHECK_THAT(complain(make_coupled_rig(event("hold", ""))).what, Contains("sequence"));
  CHECK_THAT(complain(make_rig("set_point_m = 0.16\n", event("front_set_point", "value = 0.1\n"))).what,
             Contains("melting front"));
  CHECK_THAT(complain(make_coupled_rig(event("material", "name = \"wood\"\n"))).what, Contains("wood"));
  CHECK_THAT(complain(make_melt_rig("front_set_point_m = 0.05\n", event("set_point", "value = 0.1\n"))).what,
             Contains("filled length"));

  CHECK(read(make_coupled_rig(event("autotune", "zone = 2\n"))).orders.at(0).index == 2);
  CHECK_THAT(complain(make_coupled_rig(event("autotune", "zone = 4\n"))).what, Contains("not heated"));
  CHECK_THAT(complain(make_coupled_rig(event("autotune", "zone = 6\n"))).what, Contains("zone = 6"));
  CHECK_THAT(complain(make_melt_rig("front_set_point_m = 0.05\n", event("autotune", "zone = 1\n"))).what,
             Contains("heated zones"));
}
