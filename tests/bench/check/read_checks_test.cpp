#include "bench/check/read_checks.hpp"

#include <catch2/catch.hpp>
#include <memory>

#include "protocols/config/toml.hpp"

namespace meltbench::check {
namespace {

CheckSet read(const std::string& toml) {
  return read_checks(config::Section{std::make_shared<const config::Table>(config::parse_toml(toml, "s.toml"))});
}

std::string complaint(const std::string& toml) {
  try {
    read(toml);
  } catch (const config::ConfigError& error) {
    return error.what();
  }
  return "";
}

constexpr const char* kSettle = R"(
[[check]]
name = "settles"
kind = "settle"
signal = "plant.x_m"
target = 0.16
tolerance = 0.00016
within_s = 12.9
)";

/// One of each kind, with every key.
constexpr const char* kAll = R"(
[[check]]
name = "a"
kind = "settle"
signal = "plant.x_m"
minus = "plant.y_m"
target = 0.16
tolerance = 0.001
not_before_s = 1
within_s = 2
until_s = 3
variants = ["one"]
[[check]]
name = "b"
kind = "never_settles"
signal = "plant.x_m"
target = 0.16
tolerance = 0.001
over_last_s = 2
[[check]]
name = "c"
kind = "band"
signal = "plant.x_m"
min = 0
max = 1
from_s = 1
to_s = 2
[[check]]
name = "d"
kind = "overshoot"
signal = "plant.x_m"
target = 0.16
max = 0.001
[[check]]
name = "e"
kind = "peak_to_peak"
signal = "plant.x_m"
min = 0.008
[[check]]
name = "f"
kind = "response"
signal = "plant.x_m"
level = 0.1
within_s = 2
[[check]]
name = "g"
kind = "frame_period"
cob_id = 0x80
period_ms = 10
max_deviation_ms = 0.5
percentile = 99.9
[[check]]
name = "h"
kind = "frame_jitter"
cob_id = 0x185
max_ms = 1
[[check]]
name = "load"
kind = "bus_load"
max = 0.3
over_ms = 50
from_s = 1
to_s = 2
[[check]]
name = "i"
kind = "reaction"
from = { cob_id = 0x085, data = "30 .. 81" }
to = { event = "safe-state", source = "controller" }
within_ms = 20
every = true
[[check]]
name = "j"
kind = "always"
signal = "plant.x_m"
above = 0
during = { signal = "plant.y_m", below = 1 }
[[check]]
name = "k"
kind = "never"
signal = "plant.x_m"
below = 0
[[check]]
name = "l"
kind = "event"
code = "law-refused"
source = "controller"
count = 1
[health]
expect = ["controller.law-refused", "emcy:feeder:8130", "lost-frames"]
)";

}  // namespace

TEST_CASE("Check tables: every kind is read with all its keys", "[check]") {
  const CheckSet set = read(kAll);
  REQUIRE(set.checks.size() == std::variant_size_v<Kind>);
  for (std::size_t i = 0; i < set.checks.size(); ++i) CHECK(set.checks[i].kind.index() == i);
  const auto& settle = std::get<Settle>(set.checks[0].kind);
  CHECK(settle.quantity.minus == "plant.y_m");
  CHECK(settle.not_before == Instant{1s});
  CHECK(settle.until == Instant{3s});
  const auto& period = std::get<FramePeriod>(set.checks[6].kind);
  CHECK(period.max_deviation == 500us);
  CHECK(period.percentile == 99.9);
  CHECK(std::get<BusLoad>(set.checks[8].kind).over == 50ms);
  const auto& reaction = std::get<Reaction>(set.checks[9].kind);
  CHECK(reaction.within == 20ms);
  const auto& frame = std::get<Moment::OnFrame>(reaction.from.what);
  CHECK(frame.data == std::vector<std::optional<std::uint8_t>>{0x30, std::nullopt, 0x81});
  CHECK(set.health.expect.size() == 3);
}

TEST_CASE("Check tables: a complaint names the place and what is nearest", "[check]") {
  const std::string settle = kSettle;
  CHECK_THAT(complaint(settle + "withing_s = 3\n"), Catch::StartsWith("s.toml:9:1: ") && Catch::Contains("withing_s"));
  CHECK_THAT(complaint("[[check]]\nname = \"a\"\nkind = \"setle\"\n"), Catch::StartsWith("s.toml:3:"));
  CHECK_THAT(complaint("[[check]]\nkind = \"band\"\n"), Catch::Contains("name"));
  CHECK_THAT(complaint("[[check]]\nname = \"a\"\nkind = \"band\"\nsignal = \"x\"\n"),
             Catch::Contains("needs min, max or both"));
  CHECK_THAT(complaint("[[check]]\nname = \"a\"\nkind = \"band\"\nsignal = \"x\"\nmin = 2\nmax = 1\n"),
             Catch::StartsWith("s.toml:6:"));
  CHECK_THAT(complaint(settle + settle), Catch::Contains("given twice"));
  CHECK_THAT(complaint(settle + "not_before_s = 13\n"), Catch::Contains("within_s"));
  CHECK_THAT(complaint("[[check]]\nname=\"r\"\nkind=\"reaction\"\nwithin_ms=1\nfrom={}\nto={at_s=1}\n"),
             Catch::Contains("says no moment"));
  CHECK_THAT(
      complaint("[[check]]\nname=\"r\"\nkind=\"reaction\"\nwithin_ms=1\nfrom={cob_id=5,data=\"3\"}\nto={at_s=1}\n"),
      Catch::Contains("whole bytes"));
  CHECK_THAT(complaint("[[check]]\nname=\"p\"\nkind=\"frame_jitter\"\ncob_id=0x800\nmax_ms=1\n"),
             Catch::Contains("cob_id"));
  CHECK_THAT(complaint("[health]\nexpect = [\"nonsense\"]\n"), Catch::Contains("nonsense"));
  CHECK_THAT(complaint("[health]\nexpects = []\n"), Catch::StartsWith("s.toml:2:1: "));
}

TEST_CASE("Check set: a signal that does not exist is found before the run", "[check]") {
  const CheckSet set = read(kSettle);
  record::RunInfo info;
  CHECK_NOTHROW(set.require_signals({{"plant.x_m"}}, info));
  try {
    set.require_signals({{"plant.x_mm"}, {"plant.U"}}, info);
    FAIL("must throw");
  } catch (const config::ConfigError& error) {
    CHECK_THAT(error.what(), Catch::StartsWith("s.toml:2:"));
    CHECK_THAT(error.hint(), Catch::Contains("plant.x_mm"));
  }
  // Difference, condition and moment name signals too.
  CHECK_THROWS_AS(read(kAll).require_signals({{"plant.x_m"}}, info), config::ConfigError);
  // The bench cannot look into a real plant: its signals are missing by nature, those of others are not.
  info.unseen = {"plant"};
  CHECK_NOTHROW(set.require_signals({}, info));
  info.unseen = {"feeder"};
  CHECK_THROWS_AS(set.require_signals({}, info), config::ConfigError);
}

TEST_CASE("Check set: a time beyond the end of the run is refused, with the key that says it", "[check]") {
  const auto complaint_at = [](const std::string& text, Nanos duration) {
    try {
      read("[[check]]\nname=\"late\"\n" + text).require_times(duration);
    } catch (const config::ConfigError& error) {
      return std::string{error.what()};
    }
    return std::string{};
  };
  const std::string band = "kind=\"band\"\nsignal=\"x\"\nmin=0\n";
  CHECK(complaint_at(band + "from_s=60\nto_s=60\n", 60s).empty());
  CHECK_THAT(complaint_at(band + "from_s=61\n", 60s), Catch::Contains("from_s = 61") && Catch::Contains("ends at 60"));
  CHECK_THAT(complaint_at(band + "to_s=61\n", 60s), Catch::Contains("to_s"));
  const std::string settle = "kind=\"settle\"\nsignal=\"x\"\ntarget=1\ntolerance=1\n";
  CHECK_THAT(complaint_at(settle + "within_s=61\n", 60s), Catch::Contains("within_s"));
  CHECK_THAT(complaint_at(settle + "within_s=50\nuntil_s=70\n", 60s), Catch::Contains("until_s"));
  CHECK_THAT(complaint_at("kind=\"response\"\nsignal=\"x\"\nlevel=1\nwithin_s=70\n", 60s), Catch::Contains("within_s"));
  CHECK_THAT(complaint_at("kind=\"reaction\"\nfrom={at_s=70}\nto={cob_id=5}\nwithin_ms=1\n", 60s),
             Catch::Contains("at_s"));
  CHECK_THAT(complaint_at("kind=\"never_settles\"\nsignal=\"x\"\ntarget=1\ntolerance=1\nover_last_s=70\n", 60s),
             Catch::Contains("over_last_s"));
}

TEST_CASE("Check set: results come in order, with the health gate last", "[check]") {
  record::Recording recording;
  recording.signals = {{"plant.x_m"}};
  recording.row_times = {Instant{0s}, Instant{20s}};
  recording.values = {0.16, 0.16};
  const CheckResults results = read(kSettle).judge(recording);
  REQUIRE(results.checks.size() == 2);
  CHECK(results.checks[0].name == "settles");
  CHECK(results.checks[0].kind == "settle");
  CHECK(results.checks[1].name == "health");
  CHECK(results.held());
  recording.ending.lost_frames = 2;
  const CheckResults sick = read(kSettle).judge(recording);
  CHECK_FALSE(sick.held());
  CHECK(sick.failed_count() == 1);
  CHECK(sick.checks[1].margin == -1.0);
}

}  // namespace meltbench::check
