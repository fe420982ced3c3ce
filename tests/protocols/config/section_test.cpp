#include "protocols/config/section.hpp"

#include <catch2/catch.hpp>

#include "tests/protocols/config/complaint.hpp"

using namespace meltbench;
using namespace meltbench::config;
using Catch::Contains;
using Catch::StartsWith;

TEST_CASE("Section: typed values are read, integers pass as numbers", "[config]") {
  const Section root = section_of(R"(
a_m = 1
b_m = 0.25
n = 7
flag = true
title = "x"
list = [1, 2.5]
names = ["a", "b"]
wait_ms = 2.5
)");
  CHECK(root.number("a_m") == 1.0);
  CHECK(root.number("b_m", inside(0, 1)) == 0.25);
  CHECK(root.integer("n", between(1, 127)) == 7);
  CHECK(root.boolean("flag"));
  CHECK(root.text("title") == "x");
  CHECK(root.numbers("list") == std::vector<double>{1, 2.5});
  CHECK(root.texts("names") == std::vector<std::string>{"a", "b"});
  CHECK(root.duration("wait_ms") == 2500us);
  root.finish();
}

TEST_CASE("Section: a missing key gives its default, and is still a known key", "[config]") {
  const Section root = section_of("");
  CHECK(root.number_or("a_m", 0.5) == 0.5);
  CHECK(root.integer_or("n", 3) == 3);
  CHECK(root.boolean_or("flag", true));
  CHECK(root.text_or("title", "t") == "t");
  CHECK(root.choice_or("law", "open_loop", {"open_loop"}) == "open_loop");
  CHECK(root.duration_or("wait_ms", 1.5) == 1500us);
  CHECK(root.texts_or_none("names").empty());
  CHECK(root.sections("event").empty());
  CHECK(root.section_or_empty("plant").keys().empty());
  root.finish();
}

TEST_CASE("Section: a key that nobody reads is an error that names the nearest key", "[config]") {
  const Section root = section_of("[plant]\nx0_m = 0.1\nepsilom = 0.4\n");
  const Section plant = root.section("plant");
  (void)plant.number_or("x0_m", 0.1);
  (void)plant.number_or("epsilon", 0.1);
  CHECK(complaint_of([&] { root.finish(); }) == "a.toml:3:1: plant.epsilom: unknown key | did you mean epsilon?");
}

TEST_CASE("Section: a key that is like no other lists the keys there are", "[config]") {
  const Section root = section_of("colour = \"red\"\n");
  (void)root.number_or("x0_m", 0.1);
  (void)root.number_or("epsilon", 0.1);
  CHECK(complaint_of([&] { root.finish(); }) == "a.toml:1:1: colour: unknown key | keys here: x0_m, epsilon");
}

TEST_CASE("Section: a key with another unit is told apart from a misspelt one", "[config]") {
  const Section root = section_of("[scenario]\nduration_ms = 60000\n");
  CHECK(complaint_of([&] { (void)root.section("scenario").number("duration_s"); }) ==
        "a.toml:2:1: scenario.duration_ms: wrong unit, this key is duration_s | "
        "rename it to duration_s and convert the value to s");
  const Section without = section_of("duration = 60\n");
  CHECK(complaint_of([&] { (void)without.number("duration_s"); }) ==
        "a.toml:1:1: duration: unit missing, this key is duration_s | rename it to duration_s: the value is in s");
  const Section optional = section_of("flow_g_per_s = 1\n");
  (void)optional.number_or("flow_kg_per_h", 1);
  CHECK_THAT(complaint_of([&] { optional.finish(); }), Contains("wrong unit, this key is flow_kg_per_h"));
}

TEST_CASE("Section: a missing key is reported at its table, a misspelt one where it stands", "[config]") {
  const Section root = section_of("a = 1\n[scenario]\nname = \"x\"\n");
  CHECK(complaint_of([&] { (void)root.section("scenario").number("duration_s"); }) ==
        "a.toml:2:1: scenario.duration_s is missing | write duration_s = ... under [scenario]");
  const Section misspelt = section_of("duratoin_s = 1\n");
  CHECK(complaint_of([&] { (void)misspelt.number("duration_s"); }) ==
        "a.toml:1:1: duratoin_s: unknown key | did you mean duration_s?");
}

TEST_CASE("Section: out of range shows the value, the bound and a hint", "[config]") {
  const Section root = section_of("[zone.die]\nmax_power_W = 0\nx_m = 0.2\nn = 128\n");
  const Section die = root.section("zone").section("die");
  CHECK(complaint_of([&] {
          (void)die.number("max_power_W", above(0, "the heater band's rated power, e.g. max_power_W = 450"));
        }) ==
        "a.toml:2:15: zone.die.max_power_W = 0, must be > 0 | the heater band's rated power, e.g. max_power_W = 450");
  CHECK(complaint_of([&] { (void)die.number("x_m", inside(0, 0.2)); }) ==
        "a.toml:3:7: zone.die.x_m = 0.2, must be > 0 and < 0.2 | x_m is in m");
  CHECK_THAT(complaint_of([&] { (void)die.integer("n", between(1, 127)); }),
             Contains("n = 128, must be >= 1 and <= 127"));
}

TEST_CASE("Section: range ends belong to the range or not, as said", "[config]") {
  const Section root = section_of("x = 1\n");
  CHECK(complaint_of([&] { (void)root.number("x", above_up_to(0, 1)); }).empty());
  CHECK(complaint_of([&] { (void)root.number("x", at_least(1)); }).empty());
  CHECK_FALSE(complaint_of([&] { (void)root.number("x", above(1)); }).empty());
  CHECK_FALSE(complaint_of([&] { (void)root.number("x", from_below(0, 1)); }).empty());
  CHECK_FALSE(complaint_of([&] { (void)root.number("x", above_up_to(1, 2)); }).empty());
}

TEST_CASE("Section: NaN and infinity are never numbers", "[config]") {
  const Section root = section_of("a = nan\nb = inf\nc = -inf\nd = [1.0, nan]\n");
  CHECK_THAT(complaint_of([&] { (void)root.number("a"); }), Contains("a = nan, must be a finite number"));
  CHECK_THAT(complaint_of([&] { (void)root.number("b"); }), StartsWith("a.toml:2:5"));
  CHECK_FALSE(complaint_of([&] { (void)root.number("c"); }).empty());
  CHECK_THAT(complaint_of([&] { (void)root.numbers("d"); }), StartsWith("a.toml:4:11"));
}

TEST_CASE("Section: a wrong type shows what is there and what is wanted", "[config]") {
  const Section root = section_of("a_s = \"60\"\nb = 1.5\nc = 1\nd = \"true\"\n[[e]]\n");
  CHECK(complaint_of([&] { (void)root.number("a_s"); }) ==
        "a.toml:1:7: a_s = \"60\", must be a number, not a text | write it without quotes");
  CHECK(complaint_of([&] { (void)root.integer("b"); }) == "a.toml:2:5: b = 1.5, must be a whole number, not a number");
  CHECK_THAT(complaint_of([&] { (void)root.text("c"); }), Contains("must be a text, not a whole number"));
  CHECK_THAT(complaint_of([&] { (void)root.boolean("d"); }), Contains("must be true or false, not a text"));
  CHECK_THAT(complaint_of([&] { (void)root.section("e"); }), Contains("write it as [e]"));
  CHECK_THAT(complaint_of([&] { (void)root.sections("c"); }), Contains("write each as [[c]]"));
}

TEST_CASE("Section: a choice names what there is and what may be meant", "[config]") {
  enum class Law { kOpenLoop, kExact };
  const Section root = section_of("law = \"exact_predctor\"\ngood = \"exact_predictor\"\n");
  const auto read = [&](std::string_view key) {
    return root.choice<Law>(key, {{"open_loop", Law::kOpenLoop}, {"exact_predictor", Law::kExact}});
  };
  CHECK(read("good") == Law::kExact);
  CHECK(complaint_of([&] { (void)read("law"); }) ==
        "a.toml:1:7: law = \"exact_predctor\", must be one of open_loop, exact_predictor | "
        "did you mean \"exact_predictor\"?");
}

TEST_CASE("Section: a duration too long for the time axis is refused, not wrapped", "[config]") {
  const Section root = section_of("a_s = 1e30\nb_h = 9e15\nc_ns = 1\n");
  CHECK_THAT(complaint_of([&] { (void)root.duration("a_s"); }), Contains("292 years"));
  CHECK_THAT(complaint_of([&] { (void)root.duration("b_h"); }), Contains("292 years"));
  CHECK(root.duration("c_ns") == 1ns);
}

TEST_CASE("Section: a path is relative to the file that says it, after merging too", "[config]") {
  Table base = parse_toml("[board]\neds = \"../boards/a.eds\"\n", "rigs/r.toml");
  merge(base, parse_toml("[board]\nother = \"x.eds\"\nroot = \"/x/y.eds\"\n", "scenarios/s.toml"));
  const Section board = Section{std::make_shared<const Table>(base)}.section("board");
  CHECK(board.path("eds") == "boards/a.eds");
  CHECK(board.path("other") == "scenarios/x.eds");
  CHECK(board.path("root") == "/x/y.eds");
}

TEST_CASE("Section: finish looks into every opened section and each table of a list", "[config]") {
  const Section root = section_of("[[event]]\nat_s = 1\n[[event]]\nat_s = 2\nvalu = 3\n");
  for (const Section& event : root.sections("event")) {
    (void)event.number("at_s");
    (void)event.number_or("value", 0);
  }
  CHECK(complaint_of([&] { root.finish(); }) == "a.toml:5:1: event[2].valu: unknown key | did you mean value?");
}

TEST_CASE("Section: what is peeked at or ignored is somebody else's", "[config]") {
  const Section root = section_of("[controller]\nnode_id = 1\nlaw = \"x\"\n[check]\nz = 1\n");
  (void)root.peek("controller").integer("node_id");
  root.ignore({"check"});
  root.finish();
  // The owner opens it: from now on it is checked, and what was peeked at counts as read.
  const Section owner = root.section("controller");
  CHECK_THAT(complaint_of([&] { root.finish(); }), StartsWith("a.toml:3:1: controller.law"));
  (void)owner.text("law");
  root.finish();
}

TEST_CASE("Section: opening a section twice shares what has been read", "[config]") {
  const Section root = section_of("[plant]\na = 1\nb = 2\n");
  (void)root.section("plant").number("a");
  (void)root.section("plant").number("b");
  root.finish();
}

TEST_CASE("Section: a rule of the reader's own points at the value", "[config]") {
  const Section root = section_of("[controller]\nset_point_m = 0.3\n");
  const Section controller = root.section("controller");
  CHECK(complaint_of([&] { controller.fail("set_point_m", "must lie inside the screw, 0..0.2 m", "e.g. 0.16"); }) ==
        "a.toml:2:15: controller.set_point_m = 0.3, must lie inside the screw, 0..0.2 m | e.g. 0.16");
  CHECK_THAT(complaint_of([&] { controller.fail_here("needs a set point"); }), StartsWith("a.toml:1:1: needs"));
}

TEST_CASE("Names: units are split off keys, and only units", "[config]") {
  CHECK(unit_of("duration_s") == "s");
  CHECK(unit_of("flow_kg_per_h") == "kg_per_h");
  CHECK(unit_of("omega_rad_per_s") == "rad_per_s");
  CHECK(unit_of("node_id").empty());
  CHECK(unit_of("v_max").empty());
  CHECK(unit_of("s").empty());
  CHECK(unit_of("").empty());
  CHECK(unit_of("_s").empty());
}

TEST_CASE("Names: a word that is like none has no nearest", "[config]") {
  CHECK(nearest("set_point_m", {"slope_margin", "law"}).empty());
  CHECK(nearest("lxy", {"slope_margin", "law"}).empty());   // Two letters of three differ.
  CHECK(nearest("lwa", {"slope_margin", "law"}) == "law");  // Neighbours swapped: one mistake.
  CHECK(nearest("lav", {"slope_margin", "law"}) == "law");
  CHECK(nearest(std::string(100'000, 'x'), {"law"}).empty());
}
