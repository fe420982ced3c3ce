#include "protocols/config/toml.hpp"

#include <catch2/catch.hpp>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <limits>

#include "tests/protocols/config/complaint.hpp"

using namespace meltbench;
using namespace meltbench::config;

namespace {

const Value& value_at(const Table& table, std::string_view key) {
  const Entry* entry = table.find(key);
  REQUIRE(entry != nullptr);
  return entry->value;
}

std::string parse_complaint(std::string_view toml) {
  return complaint_of([&] { (void)parse_toml(toml, "a.toml"); });
}

}  // namespace

TEST_CASE("TOML: every value knows its file, line and column, every key too", "[config]") {
  const Table table = parse_toml("a = 1\n\n[b]\n  long_key = \"x\"\n", "dir/a.toml");
  CHECK(value_at(table, "a").origin.text() == "dir/a.toml:1:5");
  const auto& b = std::get<Table>(value_at(table, "b").data);
  CHECK(value_at(b, "long_key").origin.text() == "dir/a.toml:4:14");
  CHECK(b.find("long_key")->key_origin.text() == "dir/a.toml:4:3");
}

TEST_CASE("TOML: tables keep the order of the file, not of the alphabet", "[config]") {
  const Table table = parse_toml("z = 1\na = 2\n[m]\n[b]\n", "a.toml");
  std::vector<std::string> keys;
  for (const Entry& entry : table.entries()) keys.push_back(entry.key);
  CHECK(keys == std::vector<std::string>{"z", "a", "m", "b"});
}

TEST_CASE("TOML: what is written reads back equal, doubles bit for bit", "[config]") {
  const double doubles[] = {0.1,
                            1.0 / 3.0,
                            -0.0,
                            5e-324,
                            1.7976931348623157e308,
                            1e22,
                            123456789.0,
                            -1e-7,
                            1e16,
                            6.02e23,
                            60.0,
                            0.2527760223891,
                            std::numeric_limits<double>::infinity()};
  Table table;
  Array numbers;
  for (const double number : doubles) numbers.push_back(Value{number, {}});
  table.set("numbers", Value{numbers, {}});
  const Table again = parse_toml(write_toml(table), "again.toml");
  const auto& items = std::get<Array>(value_at(again, "numbers").data);
  REQUIRE(items.size() == std::size(doubles));
  for (std::size_t i = 0; i < items.size(); ++i) {
    const double read = std::get<double>(items[i].data);
    CHECK(std::memcmp(&read, &doubles[i], sizeof read) == 0);
  }
}

TEST_CASE("TOML: texts, keys, integers, lists of tables and empty things survive the round trip", "[config]") {
  const std::string_view text = R"(
whole = -9223372036854775808
flag = true
"key with space" = "quote \" back \\ line \n bell \u0007 nul \u0000 smile ☺"
none = []
mixed = [1, 2.0, "x", [true], {a = 1, "b c" = {}}]
inline = {x.y = 1}
[empty]
[[event]]
at_s = 1
[[event.deep]]
x = 1
[[event]]
)";
  const Table table = parse_toml(text, "a.toml");
  const std::string written = write_toml(table);
  CHECK(parse_toml(written, "b.toml") == table);
  CHECK(write_toml(parse_toml(written, "b.toml")) == written);
}

TEST_CASE("TOML: bad syntax is reported with file, line, column and a hint", "[config]") {
  CHECK_THAT(parse_complaint("a = 1\nb = \n"), Catch::StartsWith("a.toml:2:5: not valid TOML: "));
  CHECK_THAT(parse_complaint("[x\n"), Catch::StartsWith("a.toml:1:"));
  CHECK_THAT(parse_complaint("name = abc\n"), Catch::Contains("texts in quotes"));
  CHECK_THAT(parse_complaint("a = \"\xFF\"\n"), Catch::StartsWith("a.toml:1:"));
}

TEST_CASE("TOML: a key or table given twice is refused where it is given again", "[config]") {
  CHECK_THAT(parse_complaint("a = 1\na = 2\n"), Catch::StartsWith("a.toml:2:") && Catch::Contains("'a'"));
  CHECK_THAT(parse_complaint("[t]\n[t]\n"), Catch::StartsWith("a.toml:2:") && Catch::Contains("[[name]]"));
}

TEST_CASE("TOML: letters outside of ASCII are fine in texts and comments, and refused elsewhere", "[config]") {
  CHECK(parse_complaint("a = \"\u00e9\"  # \u00e9\n").empty());
  CHECK_THAT(parse_complaint("a = \u00e9\n"), Catch::StartsWith("a.toml:1:5: not valid TOML"));
  CHECK_THAT(parse_complaint("a = [1, \u0207 2]\n"), Catch::StartsWith("a.toml:1:9: not valid TOML"));
}

TEST_CASE("TOML: dates are refused", "[config]") {
  CHECK_THAT(parse_complaint("a = 2020-01-01\n"), Catch::StartsWith("a.toml:1:5: a date"));
}

TEST_CASE("TOML: nesting that would exhaust the stack is refused", "[config]") {
  CHECK_FALSE(parse_complaint("a = " + std::string(100'000, '[')).empty());
  std::string dotted = "a";
  for (int i = 0; i < 100'000; ++i) dotted += ".a";
  CHECK_THAT(parse_complaint("x = 1\n" + dotted + " = 1\n"), Catch::StartsWith("a.toml:2:1: more than 64 dots"));
  CHECK_FALSE(parse_complaint("[" + dotted + "]\n").empty());
}

TEST_CASE("TOML: a file that cannot be read is an error that names it, at the place that asked for it", "[config]") {
  CHECK(complaint_of([] { (void)read_toml_file("no/such.toml"); }) ==
        "cannot read \"no/such.toml\": No such file or directory | the path is relative to the current folder");
  const Origin asked_by{std::make_shared<const std::string>("s.toml"), 3, 7};
  CHECK_THAT(complaint_of([&] { (void)read_toml_file("no/such.toml", asked_by); }),
             Catch::StartsWith("s.toml:3:7: cannot read"));
  CHECK_THAT(complaint_of([] { (void)read_toml_file("/"); }), Catch::Contains("it is a folder"));
}

TEST_CASE("TOML: a file without end is refused, not read for ever", "[config]") {
  CHECK_THAT(complaint_of([] { (void)read_toml_file("/dev/zero"); }), Catch::Contains("more than"));
}

TEST_CASE("Merge: tables key by key, all else replaced, and every value keeps its own place", "[config]") {
  Table base = parse_toml("[plant]\npreset = \"slow\"\nx0_m = 0.1\n[[event]]\nat_s = 1\n", "rig.toml");
  const Table over = parse_toml("[plant]\nx0_m = 0.12\nepsilon = 0.4\n[[event]]\nat_s = 2\n[bus]\n", "scenario.toml");
  merge(base, over);
  const auto& plant = std::get<Table>(value_at(base, "plant").data);
  CHECK(value_at(plant, "preset").origin.text() == "rig.toml:2:10");
  CHECK(std::get<double>(value_at(plant, "x0_m").data) == 0.12);
  CHECK(value_at(plant, "x0_m").origin.text() == "scenario.toml:2:8");
  CHECK(plant.entries().size() == 3);
  CHECK(std::get<Array>(value_at(base, "event").data).size() == 1);
  CHECK(base.find("bus") != nullptr);
}

TEST_CASE("Merge: a table over a number, or a number over a table, replaces it", "[config]") {
  Table base = parse_toml("a = 1\n[b]\nc = 1\n", "x.toml");
  merge(base, parse_toml("b = 2\n[a]\nd = 1\n", "y.toml"));
  CHECK(std::holds_alternative<Table>(value_at(base, "a").data));
  CHECK(std::get<std::int64_t>(value_at(base, "b").data) == 2);
}
