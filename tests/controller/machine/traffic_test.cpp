#include "controller/machine/traffic.hpp"

#include <algorithm>
#include <catch2/catch.hpp>
#include <string>

#include "protocols/config/toml.hpp"

using namespace meltbench;
using namespace meltbench::machine;

namespace {

ControllerSettings read_rig(const char* name) {
  const std::string file = std::string{MELTBENCH_SOURCE_DIR} + "/fixtures/rigs/" + name;
  return read_settings(config::Section{config::read_toml_file(file)});
}

/// "185 8 10ms" for each frame, by identifier.
std::string describe(std::vector<PlannedFrame> traffic) {
  std::ranges::sort(traffic, {}, [](const PlannedFrame& planned) { return planned.frame.id; });
  std::string text;
  for (const PlannedFrame& planned : traffic) {
    constexpr const char* kHex = "0123456789ABCDEF";
    for (const unsigned shift : {8U, 4U, 0U}) text += kHex[(planned.frame.id >> shift) & 0xFU];
    text.append(" ").append(std::to_string(planned.frame.length));
    text.append(" ").append(std::to_string(planned.period / 1ms)).append("ms\n");
  }
  return text;
}

}  // namespace

TEST_CASE("Traffic: what the bizone rig's controller and boards send in operation", "[machine]") {
  // As bus.log of a run shows it: SYNC, three reports a cycle, the feeder's set point, the drive's control word,
  // heartbeats.
  CHECK(describe(plan_traffic(read_rig("bizone.toml"))) ==
        "080 0 10ms\n185 8 10ms\n187 7 10ms\n205 4 10ms\n206 2 10ms\n386 8 10ms\n"
        "705 1 100ms\n706 1 100ms\n707 1 100ms\n77F 1 50ms\n");
}
