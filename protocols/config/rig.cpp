#include "protocols/config/rig.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>

namespace meltbench::config {
namespace {

constexpr Range kNodeId = between(1, 127, "CANopen has the node ids 1..127");
constexpr Range kUnit = between(1, 247, "Modbus has the unit addresses 1..247; 0 is broadcast");

/// Who owns which node id of the bus, or which unit address of a line, to name the first one when the second comes.
class Addresses {
 public:
  Addresses(std::string_view key, std::string_view hint) : key_{key}, hint_{hint} {}
  std::uint8_t take(const Section& section, std::string_view owner, std::uint8_t address) {
    std::string& holder = holders_[address];
    if (!holder.empty()) section.fail(key_, fmt::format("already taken by {}", holder), hint_);
    holder = owner;
    return address;
  }

 private:
  std::string_view key_;
  std::string_view hint_;
  std::array<std::string, 248> holders_;
};

/// Lower-case letters, digits and _.
bool is_part_name(std::string_view name) {
  return !name.empty() && std::all_of(name.begin(), name.end(), [](char letter) {
    return (letter >= 'a' && letter <= 'z') || (letter >= '0' && letter <= '9') || letter == '_';
  });
}

std::uint32_t read_data_bit_rate(const Section& bus, std::uint32_t bit_rate_bit_per_s) {
  if (!bus.has("data_bit_rate_kbit_per_s")) return bit_rate_bit_per_s;
  static constexpr std::array<std::int64_t, 6> kRates_kbit_per_s{500, 1000, 2000, 4000, 5000, 8000};
  const std::int64_t rate = bus.integer("data_bit_rate_kbit_per_s");
  const bool known = std::find(kRates_kbit_per_s.begin(), kRates_kbit_per_s.end(), rate) != kRates_kbit_per_s.end();
  if (!known || rate * 1000 < bit_rate_bit_per_s) {
    bus.fail("data_bit_rate_kbit_per_s", "must be one of 500, 1000, 2000, 4000, 5000, 8000, and not below the bit rate",
             "the rate of the data phase of CAN FD frames");
  }
  return static_cast<std::uint32_t>(rate * 1000);
}

void read_bit_timing(const Section& bus, RigBus& result) {
  result.fidelity = bus.choice_or<BusFidelity>("fidelity", BusFidelity::kIdeal,
                                               {{"ideal", BusFidelity::kIdeal}, {"bit-timed", BusFidelity::kBitTimed}});
  for (const char* key : {"data_bit_rate_kbit_per_s", "tx_queue", "tx_order", "restart_ms"}) {
    if (result.fidelity == BusFidelity::kIdeal && bus.has(key)) {
      bus.fail(key, "means nothing on an ideal bus", "add fidelity = \"bit-timed\", or take this key out");
    }
  }
  result.data_bit_rate_bit_per_s = read_data_bit_rate(bus, result.bit_rate_bit_per_s);
  result.tx_queue = static_cast<std::size_t>(bus.integer_or("tx_queue", 10, between(1, 1000)));
  result.tx_order = bus.choice_or<RigTxOrder>("tx_order", RigTxOrder::kPriority,
                                              {{"priority", RigTxOrder::kPriority}, {"fifo", RigTxOrder::kFifo}});
  if (bus.has("restart_ms")) result.restart_after = bus.duration("restart_ms", between(0, 60'000));
}

RigBus read_bus(const Section& bus) {
  RigBus result;
  static constexpr std::array<std::int64_t, 8> kRates_kbit_per_s{10, 20, 50, 125, 250, 500, 800, 1000};
  const std::int64_t rate = bus.integer_or("bit_rate_kbit_per_s", 500);
  if (std::find(kRates_kbit_per_s.begin(), kRates_kbit_per_s.end(), rate) == kRates_kbit_per_s.end()) {
    bus.fail("bit_rate_kbit_per_s", "must be one of 10, 20, 50, 125, 250, 500, 800, 1000",
             "these are the bit rates of CiA 301");
  }
  result.bit_rate_bit_per_s = static_cast<std::uint32_t>(rate * 1000);
  result.sync_period = bus.duration_or("sync_period_ms", 10, between(0.1, 10'000));
  read_bit_timing(bus, result);
  return result;
}

std::filesystem::path read_eds_path(const Section& board) {
  const std::filesystem::path eds = board.path("eds");
  std::error_code error;
  if (!std::filesystem::is_regular_file(eds, error)) {
    board.fail("eds", fmt::format("there is no such file ({})", eds.string()),
               "the path is relative to the folder of the file that says it");
  }
  return eds;
}

RigLine read_line(const Section& line, const std::string& name) {
  if (!is_part_name(name)) {
    line.fail_here(fmt::format("line name \"{}\" must be lower-case letters, digits and _", name),
                   "boards and options name it, e.g. [line.feeder_line]");
  }
  static constexpr std::array<std::int64_t, 8> kRates{1200, 2400, 4800, 9600, 19200, 38400, 57600, 115200};
  RigLine result{name, {}};
  const std::int64_t rate = line.integer_or("baud_rate", result.settings.baud_rate);
  if (std::find(kRates.begin(), kRates.end(), rate) == kRates.end()) {
    line.fail("baud_rate", fmt::format("must be one of {}", fmt::join(kRates, ", ")), "what all serial ports can do");
  }
  result.settings.baud_rate = static_cast<std::uint32_t>(rate);
  const std::string format = line.choice_or("format", "8E1", {"8E1", "8N1", "8O1", "8N2"});
  result.settings = *serial::with_format(result.settings, format);
  return result;
}

/// A line, and who has which unit address on it.
struct LineAddresses {
  std::string line;
  Addresses units{"unit", "every unit on a line needs its own address, 1..247"};
};

void put_on_line(RigBoard& board, std::vector<LineAddresses>& lines) {
  for (const char* key : {"node_id", "eds", "heartbeat_ms", "clock_drift_ppm"}) {
    if (board.section.has(key)) {
      board.section.fail(key, "goes with CAN, but this board is on a line",
                         "a board has either node_id and eds, or line and unit");
    }
  }
  board.line = board.section.text("line");
  const auto found = std::find_if(lines.begin(), lines.end(), [&](const auto& one) { return one.line == board.line; });
  if (found == lines.end()) {
    board.section.fail("line", "is no line of this rig", fmt::format("it needs a table [line.{}]", board.line));
  }
  board.unit = static_cast<std::uint8_t>(board.section.integer("unit", kUnit));
  found->units.take(board.section, "board." + board.name, board.unit);
}

/// Within +-5000 ppm: beyond it receivers would lose step within a frame, which the bit-timed bus does not do.
double read_clock_drift(const Section& node, BusFidelity fidelity) {
  if (node.has("clock_drift_ppm") && fidelity == BusFidelity::kIdeal) {
    node.fail("clock_drift_ppm", "means nothing on an ideal bus", "set bus.fidelity = \"bit-timed\"");
  }
  return node.number_or("clock_drift_ppm", 0, between(-5000, 5000));
}

void put_on_bus(RigBoard& board, Addresses& ids, BusFidelity fidelity) {
  const auto node_id = static_cast<std::uint8_t>(board.section.integer("node_id", kNodeId));
  board.node_id = ids.take(board.section, "board." + board.name, node_id);
  board.eds = read_eds_path(board.section);
  board.heartbeat = board.section.duration_or("heartbeat_ms", 100, between(1, 65'535));
  board.clock_drift_ppm = read_clock_drift(board.section, fidelity);
}

RigBoard read_board(const Section& board, const std::string& name) {
  if (!is_part_name(name)) {
    board.fail_here(fmt::format("board name \"{}\" must be lower-case letters, digits and _", name),
                    "it becomes a part of signal names, e.g. [board.feeder]");
  }
  const auto kind = board.choice<BoardKind>("kind", {{"feeder", BoardKind::kFeeder},
                                                     {"screw_drive", BoardKind::kScrewDrive},
                                                     {"melt_pressure", BoardKind::kMeltPressure},
                                                     {"heater", BoardKind::kHeater},
                                                     {"preconditioner", BoardKind::kPreconditioner},
                                                     {"melt_camera", BoardKind::kMeltCamera}});
  const bool is_real = board.choice_or<bool>("part", false, {{"emulated", false}, {"real", true}});
  return RigBoard{.name = name, .kind = kind, .is_real = is_real, .section = board};
}

}  // namespace

std::string_view name_of(BoardKind kind) {
  switch (kind) {
    case BoardKind::kFeeder:
      return "feeder";
    case BoardKind::kScrewDrive:
      return "screw_drive";
    case BoardKind::kMeltPressure:
      return "melt_pressure";
    case BoardKind::kHeater:
      return "heater";
    case BoardKind::kPreconditioner:
      return "preconditioner";
    case BoardKind::kMeltCamera:
      return "melt_camera";
  }
  return "?";
}

std::string read_name(const Section& section, std::string_view key) {
  constexpr std::size_t kMaxName = 100;
  std::string name = section.text(key);
  const bool legal = !name.empty() && name.size() <= kMaxName && name.front() != '.' && name.front() != '-' &&
                     std::all_of(name.begin(), name.end(), [](char letter) {
                       return (letter >= 'a' && letter <= 'z') || (letter >= 'A' && letter <= 'Z') ||
                              (letter >= '0' && letter <= '9') || letter == '_' || letter == '-' || letter == '.';
                     });
  if (!legal) section.fail(key, "must be letters, digits, _, - and .", "it becomes the name of a folder");
  return name;
}

bool Rig::has_real_board() const {
  return std::any_of(boards.begin(), boards.end(), [](const RigBoard& board) { return board.is_real; });
}

bool Rig::has_emulated_board() const {
  return std::any_of(boards.begin(), boards.end(), [](const RigBoard& board) { return !board.is_real; });
}

Rig read_rig(const Section& root) {
  root.ignore({"rig", "bus", "plant", "controller", "board", "scenario", "event", "fault", "check", "health", "repro"});
  Rig rig;
  const Section about = root.section("rig");
  rig.name = read_name(about, "name");
  rig.title = about.text_or("title", rig.name);
  rig.bus = read_bus(root.section_or_empty("bus"));

  Addresses ids{"node_id", "every node on the bus needs its own id, 1..127"};
  const Section controller = root.peek("controller");
  const auto controller_id = static_cast<std::uint8_t>(controller.integer_or("node_id", 127, kNodeId));
  rig.controller_node_id = ids.take(controller, "controller", controller_id);
  rig.controller_clock_drift_ppm = read_clock_drift(controller, rig.bus.fidelity);
  rig.controller_is_external = controller.boolean_or("external", false);
  std::vector<LineAddresses> units;
  const Section lines = root.section_or_empty("line");
  for (const std::string& name : lines.keys()) {
    rig.lines.push_back(read_line(lines.section(name), name));
    units.push_back({name});
  }
  const Section boards = root.peek("board");
  for (const std::string& name : boards.keys()) {
    RigBoard board = read_board(boards.peek(name), name);
    if (board.section.has("line"))
      put_on_line(board, units);
    else
      put_on_bus(board, ids, rig.bus.fidelity);
    rig.boards.push_back(std::move(board));
  }
  if (rig.boards.empty()) root.fail_here("no [board.NAME]: a rig has at least one board", "e.g. [board.feeder]");
  return rig;
}

std::vector<TimelineEvent> read_events(const Section& root, const Rig& rig, std::string_view target) {
  std::vector<std::string> targets{"controller", "plant", "bus"};
  for (const RigBoard& board : rig.boards) targets.push_back("board." + board.name);

  std::vector<TimelineEvent> events;
  for (const Section& event : root.peek_all("event")) {
    TimelineEvent read{.at = Instant{event.duration("at_s")},
                       .target = event.text("target"),
                       .action = event.text("action"),
                       .section = event};
    if (std::find(targets.begin(), targets.end(), read.target) == targets.end()) {
      event.fail("target", fmt::format("must be one of {}", fmt::join(targets, ", ")),
                 "a board is named as in the rig: \"board.feeder\"");
    }
    if (target.empty() || read.target == target) events.push_back(std::move(read));
  }
  std::stable_sort(events.begin(), events.end(),
                   [](const TimelineEvent& left, const TimelineEvent& right) { return left.at < right.at; });
  return events;
}

}  // namespace meltbench::config
