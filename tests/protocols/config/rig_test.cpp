#include "protocols/config/rig.hpp"

#include <unistd.h>

#include <catch2/catch.hpp>
#include <filesystem>
#include <fstream>
#include <string>

#include "tests/protocols/config/complaint.hpp"

using namespace meltbench;
using namespace meltbench::config;
using Catch::Contains;

namespace {

/// A folder with an EDS file in it, gone at the end of the test.
class RigFolder {
 public:
  RigFolder() : path_{std::filesystem::temp_directory_path() / ("meltbench_rig_" + std::to_string(::getpid()))} {
    std::filesystem::create_directories(path_);
    std::ofstream{path_ / "b.eds"} << "[FileInfo]\n";
  }
  ~RigFolder() { std::filesystem::remove_all(path_); }
  RigFolder(const RigFolder&) = delete;
  RigFolder& operator=(const RigFolder&) = delete;

  [[nodiscard]] Section root(std::string_view toml) const {
    return Section{std::make_shared<const Table>(parse_toml(toml, (path_ / "r.toml").string()))};
  }
  [[nodiscard]] std::string complaint(std::string_view toml) const {
    return complaint_of([&] {
      const Section section = root(toml);
      const Rig rig = read_rig(section);
      (void)read_events(section, rig);
      section.finish();
    });
  }
  [[nodiscard]] const std::filesystem::path& path() const { return path_; }

 private:
  std::filesystem::path path_;
};

const std::string kRig = R"([rig]
name = "lab"
[board.feeder]
kind = "feeder"
node_id = 5
eds = "b.eds"
latency_ms = 2
[board.drive]
kind = "screw_drive"
node_id = 6
eds = "b.eds"
)";

}  // namespace

TEST_CASE("Rig: a board is ours unless it says that it is real, and so is the controller", "[config]") {
  const RigFolder folder;
  const Rig ours = read_rig(folder.root(kRig));
  CHECK_FALSE(ours.has_real_board());
  CHECK_FALSE(ours.controller_is_external);
  const Rig mixed = read_rig(folder.root(kRig + "part = \"real\"\n[controller]\nexternal = true\n"));
  CHECK_FALSE(mixed.boards[0].is_real);
  CHECK(mixed.boards[1].is_real);
  CHECK(mixed.has_real_board());
  CHECK(mixed.has_emulated_board());
  CHECK(mixed.controller_is_external);
  CHECK_THAT(folder.complaint(kRig + "part = \"virtual\"\n"), Contains("emulated"));
}

TEST_CASE("Rig: bus, boards and defaults are read, other people's keys are left alone", "[config]") {
  const RigFolder folder;
  const Section root = folder.root(kRig + "[plant]\nanything = 1\n[controller]\nlaw = \"x\"\n[[check]]\nk = 1\n");
  const Rig rig = read_rig(root);
  root.finish();
  CHECK(rig.name == "lab");
  CHECK(rig.title == "lab");
  CHECK(rig.bus.bit_rate_bit_per_s == 500'000);
  CHECK(rig.bus.sync_period == 10ms);
  CHECK(rig.controller_node_id == 127);
  REQUIRE(rig.boards.size() == 2);
  CHECK(rig.boards[0].name == "feeder");
  CHECK(rig.boards[0].kind == BoardKind::kFeeder);
  CHECK(rig.boards[0].eds == folder.path() / "b.eds");
  CHECK(rig.boards[0].heartbeat == 100ms);
  CHECK(rig.boards[1].node_id == 6);
  CHECK(rig.boards[0].section.number("latency_ms") == 2.0);
  rig.boards[0].section.finish();
}

TEST_CASE("Rig: the owner of a board's keys gets complaints about unknown ones", "[config]") {
  const RigFolder folder;
  const Rig rig = read_rig(folder.root(kRig));
  (void)rig.boards[0].section.number_or("watchdog_ms", 1);
  CHECK_THAT(complaint_of([&] { rig.boards[0].section.finish(); }), Contains("board.feeder.latency_ms: unknown key"));
}

TEST_CASE("Rig: a node id may be used once on the bus, the controller's included", "[config]") {
  const RigFolder folder;
  const std::string third = "[board.p]\nkind = \"melt_pressure\"\neds = \"b.eds\"\n";
  CHECK_THAT(folder.complaint(kRig + third + "node_id = 6\n"),
             Contains("r.toml:15:11: board.p.node_id = 6, already taken by board.drive"));
  CHECK_THAT(folder.complaint(kRig + third + "node_id = 127\n"), Contains("already taken by controller"));
  CHECK(folder.complaint(kRig + third + "node_id = 7\n").empty());
}

TEST_CASE("Rig: node ids outside 1..127 are refused", "[config]") {
  const RigFolder folder;
  const std::string board = "[rig]\nname=\"r\"\n[board.p]\nkind = \"melt_pressure\"\neds = \"b.eds\"\nnode_id = ";
  CHECK(folder.complaint(board + "1\n").empty());
  CHECK_THAT(folder.complaint(board + "0\n"), Contains("node_id = 0, must be >= 1 and <= 127"));
  CHECK_THAT(folder.complaint(board + "128\n"), Contains("node_id = 128, must be"));
  CHECK_THAT(folder.complaint(board + "4294967301\n"), Contains("must be"));  // 2^32 + 5 must not wrap to 5.
}

TEST_CASE("Rig: an EDS file that is not there is refused where it is named", "[config]") {
  const RigFolder folder;
  CHECK_THAT(folder.complaint("[rig]\nname=\"r\"\n[board.p]\nkind = \"feeder\"\nnode_id = 1\neds = \"c.eds\"\n"),
             Contains("r.toml:6:7: board.p.eds = \"c.eds\", there is no such file ("));
}

TEST_CASE("Rig: a board given twice, an unknown kind, no board, an unknown table are refused", "[config]") {
  const RigFolder folder;
  CHECK_THAT(complaint_of([&] { (void)folder.root(kRig + "[board.feeder]\n"); }), Contains("r.toml:12:"));
  CHECK_THAT(folder.complaint("[rig]\nname=\"r\"\n[board.p]\nkind = \"feder\"\n"),
             Contains("must be one of feeder, screw_drive, melt_pressure, heater, preconditioner, melt_camera | did "
                      "you mean \"feeder\"?"));
  CHECK_THAT(folder.complaint("[rig]\nname=\"r\"\n"), Contains("at least one board"));
  CHECK_THAT(folder.complaint(kRig + "[plnat]\n"), Contains("r.toml:12:2: plnat: unknown key | did you mean plant?"));
}

TEST_CASE("Rig: only the bit rates of CiA 301 are accepted", "[config]") {
  const RigFolder folder;
  CHECK_THAT(folder.complaint(kRig + "[bus]\nbit_rate_kbit_per_s = 300\n"), Contains("must be one of 10, 20, 50"));
  CHECK(folder.complaint(kRig + "[bus]\nbit_rate_kbit_per_s = 1000\nsync_period_ms = 1\n").empty());
}

TEST_CASE("Timeline: events are sorted by time, equal times keep their order", "[config]") {
  const RigFolder folder;
  const Section root = folder.root(kRig + R"(
[[event]]
at_s = 2
target = "controller"
action = "second"
[[event]]
at_s = 1
target = "board.feeder"
action = "first"
[[event]]
at_s = 2
target = "controller"
action = "third"
set_point_m = 0.1
)");
  const Rig rig = read_rig(root);
  const auto all = read_events(root, rig);
  REQUIRE(all.size() == 3);
  CHECK(all[0].action == "first");
  CHECK(all[0].at == Instant{1s});
  CHECK(all[1].action == "second");
  CHECK(all[2].action == "third");
  CHECK(read_events(root, rig, "board.feeder").size() == 1);
  CHECK_THAT(complaint_of([&] { all[2].section.finish(); }), Contains("event[3].set_point_m: unknown key"));
}

TEST_CASE("Timeline: a target that the rig does not have is refused", "[config]") {
  const RigFolder folder;
  CHECK_THAT(folder.complaint(kRig + "[[event]]\nat_s = 1\ntarget = \"board.heater\"\naction = \"x\"\n"),
             Contains("target = \"board.heater\", must be one of controller, plant, bus, board.feeder, board.drive"));
}

TEST_CASE("Rig: a board on a serial line has a unit instead of a node id", "[config]") {
  const RigFolder folder;
  const Section root = folder.root(
      "[rig]\nname = \"lab\"\n[line.hopper]\nformat = \"8N1\"\nbaud_rate = 115200\n[line.other]\n"
      "[board.feeder]\nkind = \"feeder\"\nline = \"hopper\"\nunit = 7\n");
  const Rig rig = read_rig(root);
  root.finish();
  REQUIRE(rig.lines.size() == 2);
  CHECK(rig.lines[0].name == "hopper");
  CHECK(rig.lines[0].settings == serial::LineSettings{115'200, serial::Parity::kNone, 1});
  CHECK(rig.lines[1].settings == serial::LineSettings{19'200, serial::Parity::kEven, 1});
  REQUIRE(rig.boards.size() == 1);
  CHECK(rig.boards[0].is_on_line());
  CHECK(rig.boards[0].line == "hopper");
  CHECK(rig.boards[0].unit == 7);
  CHECK(rig.boards[0].node_id == 0);
}

TEST_CASE("Rig: mistakes about serial lines are told", "[config]") {
  const RigFolder folder;
  const std::string start = "[rig]\nname = \"lab\"\n";
  const std::string feeder = "[board.feeder]\nkind = \"feeder\"\nline = \"hopper\"\n";
  CHECK_THAT(
      folder.complaint(start + feeder + "unit = 1\n"),
      Contains("r.toml:5:8: board.feeder.line = \"hopper\", is no line of this rig") && Contains("[line.hopper]"));
  CHECK_THAT(folder.complaint(start + "[line.hopper]\n" + feeder + "unit = 248\n"), Contains("unit = 248"));
  CHECK_THAT(folder.complaint(start + "[line.hopper]\n" + feeder), Contains("unit"));
  CHECK_THAT(folder.complaint(start + "[line.hopper]\nbaud_rate = 12345\n" + feeder + "unit = 1\n"),
             Contains("must be one of 1200, 2400"));
  CHECK_THAT(folder.complaint(start + "[line.hopper]\nformat = \"7E1\"\n" + feeder + "unit = 1\n"),
             Contains("format") && Contains("8E1"));
  CHECK_THAT(folder.complaint(start + "[line.hopper]\nbaud = 9600\n" + feeder + "unit = 1\n"), Contains("baud_rate"));
  CHECK_THAT(folder.complaint(start + "[line.Hopper]\n" + feeder + "unit = 1\n"), Contains("lower-case"));
  CHECK_THAT(folder.complaint(start + "[line.hopper]\n" + feeder + "unit = 1\nnode_id = 5\n"),
             Contains("goes with CAN"));
  CHECK_THAT(folder.complaint(start + "[line.hopper]\n" + feeder +
                              "unit = 1\n[board.zone]\nkind = \"heater\"\nline = \"hopper\"\nunit = 1\n"),
             Contains("already taken by board.feeder"));
}

TEST_CASE("Rig: [bus] says how true the embedded bus is, and its keys are refused on an ideal one", "[config]") {
  const RigFolder folder;
  const auto read = [&](const std::string& bus) { return read_rig(folder.root(kRig + "[bus]\n" + bus)).bus; };
  CHECK(read("").fidelity == BusFidelity::kIdeal);
  const RigBus bus = read(
      "fidelity = \"bit-timed\"\nbit_rate_kbit_per_s = 250\ntx_queue = 3\ntx_order = \"fifo\"\nrestart_ms = 100\n");
  CHECK(bus.fidelity == BusFidelity::kBitTimed);
  CHECK(bus.tx_queue == 3);
  CHECK(bus.tx_order == RigTxOrder::kFifo);
  CHECK(bus.restart_after == std::optional{Nanos{100ms}});
  const std::string drift = "clock_drift_ppm = -50\n";
  const std::string drifting = kRig + drift + "[controller]\nclock_drift_ppm = 200\n";
  const Rig rig = read_rig(folder.root(drifting + "[bus]\nfidelity = \"bit-timed\"\n"));
  CHECK(rig.boards[1].clock_drift_ppm == -50);
  CHECK(rig.controller_clock_drift_ppm == 200);
  CHECK_THAT(folder.complaint(kRig + drift), Contains("board.") && Contains("clock_drift_ppm") && Contains("ideal"));
  CHECK(bus.data_bit_rate_bit_per_s == 250'000);
  CHECK_THAT(folder.complaint(kRig + "[bus]\ntx_queue = 3\n"), Contains("bus.tx_queue") && Contains("ideal"));
  CHECK_THAT(folder.complaint(kRig + "[bus]\nfidelity = \"exact\"\n"), Contains("bit-timed"));
  CHECK_THAT(folder.complaint(kRig + "[bus]\nfidelity = \"bit-timed\"\ntx_queue = 0\n"), Contains("tx_queue"));
  CHECK_THAT(folder.complaint(kRig + "[bus]\nfidelity = \"bit-timed\"\nbit_rate_kbit_per_s = 1000\n"
                                     "data_bit_rate_kbit_per_s = 500\n"),
             Contains("data_bit_rate_kbit_per_s"));
}
