#include "protocols/fault/fault.hpp"

#include <fmt/format.h>

#include <catch2/catch.hpp>
#include <fstream>
#include <iterator>
#include <memory>

#include "protocols/config/toml.hpp"

using namespace meltbench;
using Catch::Contains;

namespace {

struct Bench {
  explicit Bench(const std::string& rig_file)
      : root{config::read_toml_file(std::string{MELTBENCH_SOURCE_DIR "/fixtures/rigs/"} + rig_file)},
        rig{config::read_rig(root)} {}

  [[nodiscard]] fault::Fault read(const std::string& text) const {
    return fault::read_live_fault(text, fault::make_scope(root, rig));
  }
  [[nodiscard]] std::string refusal(const std::string& text) const {
    try {
      static_cast<void>(read(text));
    } catch (const config::ConfigError& error) {
      return std::string{error.what()} + " | " + error.hint();
    }
    return "accepted";
  }

  config::Section root;
  config::Rig rig;
};

std::string read_file(const std::string& name) {
  std::ifstream file{std::string{MELTBENCH_SOURCE_DIR "/"} + name};
  return {std::istreambuf_iterator<char>{file}, {}};
}

}  // namespace

TEST_CASE("A fault is read with its parameters in the unit of what fails", "[fault]") {
  const Bench bench{"coupled.toml"};
  const auto drift = bench.read("target = 'sensor.zone2'\nkind = 'drift'\ndrift_K_per_s = 0.5\nat_s = 20\nfor_s = 3");
  CHECK(drift.kind() == fault::Kind::kDrift);
  CHECK(drift.object == "zone2");
  CHECK(drift.value("drift") == 0.5);
  CHECK(drift.trigger.at == Instant{20s});
  CHECK(drift.duration == Nanos{3s});
  CHECK(drift.name == "sensor.zone2 drift");
  const auto noise = bench.read("target = 'sensor.melt_pressure'\nkind = 'noise'\nnoise_Pa = 40");
  CHECK(noise.value("noise") == 40);
  CHECK_THAT(bench.refusal("target = 'sensor.melt_pressure'\nkind = 'noise'\nnoise_K = 40"), Contains("noise_Pa"));
}

TEST_CASE("What a target cannot do is refused with the list of what it can", "[fault]") {
  const Bench coupled{"coupled.toml"};
  CHECK_THAT(coupled.refusal("target = 'actuator.zone1'\nkind = 'babble'"),
             Contains("it can: stuck, saturated, lagging, dead, welded_on"));
  CHECK_THAT(coupled.refusal("target = 'board.nobody'\nkind = 'off'"), Contains("board.heater"));
  const Bench bizone{"bizone.toml"};
  CHECK_THAT(bizone.refusal("target = 'sensor.zone1'\nkind = 'stuck'"),
             Contains("on this rig can:") && Contains("sensor.melt_pressure") && !Contains("sensor.front"));
  CHECK_THAT(bizone.refusal("target = 'plant'\nkind = 'cold_start'\nat_s = 0"),
             Contains("it can: feeder_bridging, hopper_empty"));
  CHECK_THAT(bizone.refusal("target = 'frame'\nkind = 'drop'\nwhere = 3"), Contains("where"));
}

TEST_CASE("A board on a serial line fails as a whole by power, firmware and delay alone", "[fault]") {
  const Bench bench{"coupled_serial.toml"};
  CHECK(bench.refusal("target = 'board.heater'\nkind = 'off'") == "accepted");
  CHECK(bench.refusal("target = 'board.feeder'\nkind = 'slow'\ndelay_ms = 5") == "accepted");
  CHECK_THAT(bench.refusal("target = 'board.feeder'\nkind = 'emcy_storm'"),
             Contains("it can: off, reboot, hang, slow"));
  CHECK(bench.refusal("target = 'board.melt_camera'\nkind = 'emcy_storm'") == "accepted");
}

TEST_CASE("Our own controller can be killed, one that is external cannot", "[fault]") {
  Bench bench{"coupled.toml"};
  const std::string text = "target = 'program.controller'\nkind = ";
  CHECK(bench.refusal(text + "'killed'\nfor_s = 3") == "accepted");
  CHECK_THAT(bench.refusal(text + "'off'"), Contains("it can: killed, restart"));
  CHECK_THAT(bench.refusal("target = 'program.plant'\nkind = 'killed'"), Contains("cannot fail here"));
  bench.rig.controller_is_external = true;
  CHECK_THAT(bench.refusal(text + "'killed'"), Contains("cannot fail here") && !Contains("program.controller,"));
}

TEST_CASE("A fault of a scenario begins by exactly one trigger", "[fault]") {
  const Bench bench{"bizone.toml"};
  CHECK_THAT(bench.refusal("target = 'frame'\nkind = 'drop'\nat_s = 1\nat_frame = { id = 0x80 }"),
             Contains("begins once"));
  CHECK_THAT(bench.refusal("target = 'frame'\nkind = 'drop'\nwhen = { signal = 'plant.x_m' }"), Contains("above"));
  const auto nth =
      bench.read("target = 'frame'\nkind = 'drop'\nid = 0x187\nat_frame = { id = 0x180, mask = 0x780, n = 7 }");
  CHECK(nth.trigger.on == fault::Trigger::On::kFrame);
  CHECK(nth.trigger.nth == 7);
  CHECK(nth.trigger.frame.matches(can::make_frame(0x1FF, {})));
  CHECK_FALSE(nth.trigger.frame.matches(can::make_frame(0x200, {})));
  CHECK(nth.frames.matches(can::make_frame(0x187, {})));
  CHECK_FALSE(nth.frames.matches(can::make_frame(0x186, {})));
}

TEST_CASE("A fault of a running bench may come in one line, and alone", "[fault]") {
  const Bench bench{"bizone.toml"};
  const auto drop = bench.read("target = 'frame', kind = 'drop', at_frame = { id = 0x80, n = 7 }, armed_at_s = 2.5");
  CHECK(drop.trigger.nth == 7);
  CHECK(drop.trigger.armed_at == Instant{2500ms});
  CHECK(bench.read("target = 'frame'\nkind = 'drop'\ncleared_at_s = 3").cleared_at == Instant{3s});
  CHECK_THAT(bench.refusal("target = 'frame', kind = 'drop', at_s = 1, armed_at_s = 2"), Contains("armed_at_s"));
  CHECK_THAT(bench.refusal("target = 'frame', kind = 'drop' }, second = { x = 1"), Contains("TOML"));
  CHECK_THAT(bench.refusal("}\nx = {"), Contains("TOML"));
  CHECK_THAT(bench.refusal(""), Contains("target"));
  CHECK_THAT(bench.refusal("target = 'frame' kind = 'drop'"), Contains("TOML"));
}

TEST_CASE("An order carries a fault to whoever carries it out", "[fault]") {
  const Bench bench{"bizone.toml"};
  const auto slow = bench.read("target = 'board.feeder'\nkind = 'slow'\ndelay_ms = 30\nname = 'tired feeder'");
  const auto order = fault::read_order(fault::write_order(4, true, slow));
  REQUIRE(order);
  CHECK(order->number == 4);
  CHECK(order->begins);
  CHECK(order->fault.object == "feeder");
  CHECK(order->fault.value("delay_ms") == 30);
  CHECK(order->fault.name == "tired feeder");
  CHECK_FALSE(fault::read_order("action = \"start\""));
  CHECK_FALSE(fault::read_order("fault = \n"));
}

TEST_CASE("Every fault and every parameter stands in FAULTS.md", "[fault]") {
  const std::string text = read_file("fixtures/scenarios/FAULTS.md");
  for (const fault::KindInfo& info : fault::vocabulary()) {
    INFO(fault::name_of(info.target) << " " << info.name);
    CHECK_THAT(text, Contains(fmt::format("`{}`", info.name)));
    for (std::size_t i = 0; i < info.parameter_count; ++i) {
      CHECK_THAT(text, Contains(fmt::format("`{}", info.parameters[i].name)));
    }
  }
  for (const fault::ObjectInfo& object : fault::objects()) {
    CHECK_THAT(text, Contains(fmt::format("`{}`", object.name)));
  }
}
