#include "bench/decode/wire_signals.hpp"

#include <catch2/catch.hpp>
#include <cmath>
#include <string>

#include "protocols/canopen/types.hpp"
#include "protocols/config/toml.hpp"

using namespace meltbench;
using namespace meltbench::decode;

namespace {

const std::string kBoards = std::string{MELTBENCH_SOURCE_DIR} + "/fixtures/boards/";

config::Rig read_rig(const std::string& more = "") {
  const std::string text =
      "[rig]\nname = 'lab'\n[board.feeder]\nkind = 'feeder'\nnode_id = 5\neds = '" + kBoards + "feeder.eds'\n" + more;
  return config::read_rig(config::Section{std::make_shared<config::Table>(config::parse_toml(text, "rig.toml"))});
}

/// Follows the feeder at node 5; what it does not follow is NaN, too.
class Followed {
 public:
  explicit Followed(const std::vector<std::string>& wanted = {}) : rig_{read_rig()}, wire_{rig_.boards, wanted} {}

  void frame(std::uint32_t id, std::initializer_list<std::uint8_t> data) { wire_.on_frame(can::make_frame(id, data)); }
  /// The feeder's report by its EDS: flow delivered, age, status, changes.
  void report(float flow_kg_per_h, std::uint8_t status = 0) {
    can::CanFrame frame = can::make_frame(0x185, {0, 0, 0, 0, 0, 0, status, 0});
    canopen::store(std::span{frame.bytes}, 0, flow_kg_per_h);
    wire_.on_frame(frame);
  }
  /// A master writes a number of so many bytes, and the feeder takes it.
  void write(std::uint16_t index, std::uint8_t sub, std::uint32_t value, unsigned size, bool answered = true) {
    const auto command = static_cast<std::uint8_t>(0x23U | (4U - size) << 2U);
    can::CanFrame frame = can::make_frame(0x605, {command, 0, 0, sub, 0, 0, 0, 0});
    canopen::store(std::span{frame.bytes}, 1, index);
    canopen::store(std::span{frame.bytes}, 4, value);
    wire_.on_frame(frame);
    frame.id = 0x585;
    frame.bytes[0] = answered ? 0x60 : 0x80;
    wire_.on_frame(frame);
  }
  [[nodiscard]] double operator[](const std::string& name) const {
    std::vector<double> values(wire_.signals().size());
    wire_.read(values);
    for (std::size_t i = 0; i < values.size(); ++i) {
      if (wire_.signals()[i].name == name) return values[i];
    }
    throw std::out_of_range{name};
  }

 private:
  config::Rig rig_;
  WireSignals wire_;
};

}  // namespace

TEST_CASE("Wire signals: what a PDO carries by the EDS is there from its first frame on", "[decode]") {
  Followed wire;
  CHECK(std::isnan(wire["wire.feeder.2001"]));
  wire.report(3.5F, 2);
  CHECK(wire["wire.feeder.2001"] == 3.5);
  CHECK(wire["wire.feeder.2003"] == 2);
  CHECK(std::isnan(wire["wire.feeder.2000"]));
  wire.frame(0x205, {0, 0, 0x80, 0x40});  // Set point: 4.0 as REAL32.
  CHECK(wire["wire.feeder.2000"] == 4.0);
  wire.frame(0x185, {1, 2});  // Shorter than the mapping: nothing of it is believed.
  CHECK(wire["wire.feeder.2001"] == 3.5);
}

TEST_CASE("Wire signals: a mapping that a master writes holds from the answer on, until the board boots", "[decode]") {
  Followed wire{{"wire.feeder.2008"}};
  const auto remap = [&wire](bool answered) {
    wire.write(0x1800, 1, 0x80000185, 4);  // Off.
    wire.write(0x1A00, 0, 0, 1);
    wire.write(0x1A00, 1, 0x20080020, 4, answered);  // Totalizer in kg instead of the flow.
    wire.write(0x1A00, 0, 4, 1);
    wire.write(0x1800, 1, 0x00000185, 4);  // On.
  };
  SECTION("taken") {
    remap(true);
    wire.report(7.0F);
    CHECK(wire["wire.feeder.2008"] == 7.0);
    CHECK(std::isnan(wire["wire.feeder.2001"]));
    wire.frame(0x705, {0});
    wire.report(8.0F);
    CHECK(wire["wire.feeder.2008"] == 7.0);
    CHECK(wire["wire.feeder.2001"] == 8.0);
  }
  SECTION("refused") {
    remap(false);
    wire.report(7.0F);
    CHECK(std::isnan(wire["wire.feeder.2008"]));
    CHECK(wire["wire.feeder.2001"] == 7.0);
  }
}

TEST_CASE("Wire signals: a value that a master writes by SDO is known once the board has taken it", "[decode]") {
  Followed wire{{"wire.feeder.2000"}};
  wire.write(0x2000, 0, 0x40A00000, 4, false);
  CHECK(std::isnan(wire["wire.feeder.2000"]));
  wire.write(0x2000, 0, 0x40A00000, 4);
  CHECK(wire["wire.feeder.2000"] == 5.0);
}

TEST_CASE("Wire signals: objects of an array have their sub-index in the name", "[decode]") {
  const config::Rig rig = read_rig("[board.heater]\nkind = 'heater'\nnode_id = 9\neds = '" + kBoards + "heater.eds'\n");
  const WireSignals wire{rig.boards, {}};
  const auto has = [&wire](const std::string& name) {
    return std::any_of(wire.signals().begin(), wire.signals().end(),
                       [&](const SignalInfo& signal) { return signal.name == name; });
  };
  CHECK(has("wire.heater.7130_2"));
  CHECK_FALSE(has("wire.heater.1001"));  // Of communication, not of the process.
}
