#include "protocols/fault/fault.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <memory>
#include <utility>

#include "protocols/config/toml.hpp"

namespace meltbench::fault {

namespace {

using config::Section;

constexpr config::Range kProbability = config::between(0, 1);
constexpr double kLongest_s = 1e6;

const ObjectInfo* find_object(Target target, std::string_view name) {
  const auto known = objects();
  const auto found = std::find_if(known.begin(), known.end(), [&](const ObjectInfo& object) {
    return object.target == target && object.name == name;
  });
  return found == known.end() ? nullptr : &*found;
}

bool has_board(const config::Rig& rig, std::string_view kind) {
  return std::any_of(rig.boards.begin(), rig.boards.end(), [&](const config::RigBoard& board) {
    return !board.is_real && config::name_of(board.kind) == kind;
  });
}

bool plant_can(Kind kind, const Scope& scope) {
  switch (kind) {
    case Kind::kFeederBridging:
    case Kind::kHopperEmpty:
      return has_board(scope.rig, "feeder");
    case Kind::kMaterial:
    case Kind::kNozzleClog:
      return scope.plant_kind != "melt";
    case Kind::kColdStart:
      return scope.plant_kind == "coupled";
    default:
      return true;
  }
}

/// Whether the word stands in a list that is separated by blanks.
bool is_in(std::string_view list, std::string_view word) {
  while (!list.empty()) {
    const std::size_t end = std::min(list.find(' '), list.size());
    if (list.substr(0, end) == word) return true;
    list.remove_prefix(std::min(end + 1, list.size()));
  }
  return false;
}

struct SplitTarget {
  Target target{};
  std::string object;
};

/// The wire fails for all, or one node on it.
bool is_of_node(Kind kind) {
  return kind == Kind::kOpenCircuit || kind == Kind::kBabble || kind == Kind::kWrongBitRate || kind == Kind::kBusOff;
}

bool board_can(Kind kind, std::string_view board, const Scope& scope) {
  const bool is_on_line = std::any_of(scope.rig.boards.begin(), scope.rig.boards.end(),
                                      [&](const auto& each) { return each.name == board && each.is_on_line(); });
  return !is_on_line || kind == Kind::kOff || kind == Kind::kReboot || kind == Kind::kHang || kind == Kind::kSlow;
}

/// @param where  the target that has the kind. @param object  the quantity behind it, or null.
bool can_do(const KindInfo& info, const SplitTarget& where, const ObjectInfo* object, const Scope* scope) {
  if (info.target != where.target) return false;
  if (info.target == Target::kBus && is_of_node(info.kind) == where.object.empty()) return false;
  if (object != nullptr && !is_in(object->kinds, info.name)) return false;
  if (scope == nullptr) return true;
  if (info.target == Target::kBoard) return board_can(info.kind, where.object, *scope);
  return info.target != Target::kPlant || plant_can(info.kind, *scope);
}

SplitTarget split(std::string_view text) {
  const std::size_t dot = text.find('.');
  const std::string_view head = text.substr(0, dot);
  std::size_t target = 0;
  while (target < kTargets && name_of(static_cast<Target>(target)) != head) ++target;
  return {static_cast<Target>(target),
          dot == std::string_view::npos ? std::string{} : std::string{text.substr(dot + 1)}};
}

SplitTarget read_target(const Section& section, const Scope* scope) {
  const std::string text = section.text("target");
  if (scope != nullptr) {
    const std::vector<std::string> targets = list_targets(*scope);
    if (std::find(targets.begin(), targets.end(), text) == targets.end()) {
      section.fail("target", "cannot fail here", fmt::format("on this rig can: {}", fmt::join(targets, ", ")));
    }
  }
  SplitTarget result = split(text);
  if (static_cast<std::size_t>(result.target) == kTargets) section.fail("target", "is none");
  return result;
}

const KindInfo& read_kind(const Section& section, const SplitTarget& where, const Scope* scope) {
  const std::string kind = section.text("kind");
  const ObjectInfo* object = find_object(where.target, where.object);
  std::vector<std::string_view> possible;
  for (const KindInfo& info : vocabulary()) {
    if (!can_do(info, where, object, scope)) continue;
    if (info.name == kind) return info;
    possible.push_back(info.name);
  }
  section.fail("kind", "is not what this target can do", fmt::format("it can: {}", fmt::join(possible, ", ")));
}

FrameMatch read_match(const Section& section) {
  FrameMatch match;
  match.extended = section.boolean_or("extended", false);
  const double highest = match.extended ? can::kMaxExtendedId : can::kMaxStandardId;
  const bool any = !section.has("id");
  match.id = static_cast<std::uint32_t>(section.integer_or("id", 0, config::between(0, highest)));
  const auto all_bits = static_cast<std::int64_t>(highest);
  match.mask = static_cast<std::uint32_t>(section.integer_or("mask", any ? 0 : all_bits, config::between(0, highest)));
  return match;
}

void read_bounds(const Section& section, Trigger& trigger) {
  if (section.has("above")) trigger.above = section.number("above");
  if (section.has("below")) trigger.below = section.number("below");
  if (!trigger.above && !trigger.below) section.fail_here("a signal needs above, below or both");
}

Trigger read_trigger(const Section& section, bool live) {
  Trigger trigger;
  const int given = int{section.has("at_s")} + int{section.has("at_frame")} + int{section.has("when")};
  if (given > 1 || (given == 0 && !live)) {
    section.fail_here(
        "a fault begins once: at_s, at_frame or when",
        "e.g. at_s = 20, or at_frame = { id = 0x187, n = 100 }, or when = { signal = \"plant.x_m\", above = 0.1 }");
  }
  if (section.has("at_frame")) {
    const Section frame = section.section("at_frame");
    trigger.on = Trigger::On::kFrame;
    trigger.frame = read_match(frame);
    trigger.nth = static_cast<std::uint64_t>(frame.integer_or("n", 1, config::at_least(1)));
  } else if (section.has("when")) {
    const Section when = section.section("when");
    trigger.on = Trigger::On::kSignal;
    trigger.signal = when.text("signal");
    read_bounds(when, trigger);
  } else {
    if (section.has("armed_at_s")) section.fail("armed_at_s", "is for at_frame and when", "at_s says when it begins");
    if (given == 1) trigger.at = Instant{section.duration("at_s", config::between(0, kLongest_s))};
  }
  trigger.armed_at = Instant{section.duration_or("armed_at_s", 0, config::between(0, kLongest_s))};
  return trigger;
}

/// The board whose node id somebody else has, too.
void describe_board(Fault& fault, const Scope& scope) {
  const auto& boards = scope.rig.boards;
  const auto board = std::find_if(boards.begin(), boards.end(),
                                  [&](const config::RigBoard& each) { return each.name == fault.object; });
  fault.node_id = board->node_id;
  fault.heartbeat = board->heartbeat;
  fault.eds = board->eds;
}

void read_frame_keys(const Section& section, Fault& fault) {
  fault.frames = read_match(section);
  fault.probability = section.number_or("probability", 1.0, kProbability);
  if (section.has("count")) fault.count = static_cast<std::uint64_t>(section.integer("count", config::at_least(1)));
}

Fault read_fault(const Section& section, const Scope* scope, bool live) {
  Fault fault;
  const SplitTarget where = read_target(section, scope);
  fault.target = where.target;
  fault.object = where.object;
  fault.info = &read_kind(section, where, scope);
  const ObjectInfo* object = find_object(where.target, where.object);
  for (std::size_t i = 0; i < fault.info->parameter_count; ++i) {
    const Parameter& parameter = fault.info->parameters[i];
    const std::string key = key_of(parameter, object);
    const config::Range range = config::between(parameter.min, parameter.max);
    fault.values.push_back(parameter.fallback ? section.number_or(key, *parameter.fallback, range)
                                              : section.number(key, range));
  }
  fault.trigger = read_trigger(section, live);
  if (section.has("for_s")) fault.duration = section.duration("for_s", config::above_up_to(0, kLongest_s));
  if (section.has("cleared_at_s")) {
    fault.cleared_at = Instant{section.duration("cleared_at_s", config::between(0, kLongest_s))};
  }
  if (fault.target == Target::kFrame) read_frame_keys(section, fault);
  if (fault.kind() == Kind::kSameNodeId && scope != nullptr) describe_board(fault, *scope);
  fault.seed = static_cast<std::uint64_t>(section.integer_or("seed", 1, config::at_least(0)));
  fault.name = section.text_or("name", fmt::format("{} {}", section.text("target"), fault.info->name));
  fault.table = section.table();
  if (fault.kind() == Kind::kColdStart &&
      (live || fault.trigger.on != Trigger::On::kTime || fault.trigger.at != Instant{})) {
    section.fail("kind", "acts before the run: at_s must be 0", "an extruder does not become cold in a moment");
  }
  section.finish();
  return fault;
}

Fault read_live_table(config::Table table, const Scope& scope) {
  const Section section{std::make_shared<const config::Table>(std::move(table)), "fault"};
  return read_fault(section, &scope, true);
}

}  // namespace

std::vector<std::string> list_targets(const Scope& scope) {
  std::vector<std::string> targets{"frame", "plant", "clock.controller", "clock.plant"};
  if (scope.rig.bus.fidelity == config::BusFidelity::kBitTimed) {
    targets.insert(targets.end(), {"bus", "bus.controller"});
    for (const config::RigBoard& board : scope.rig.boards) {
      if (!board.is_real && !board.is_on_line()) targets.push_back("bus." + board.name);
    }
  }
  if (!scope.rig.controller_is_external) targets.emplace_back("program.controller");
  for (const config::RigLine& line : scope.rig.lines) targets.push_back("line." + line.name);
  for (const config::RigBoard& board : scope.rig.boards) {
    if (!board.is_real) targets.push_back("board." + board.name);
  }
  for (const ObjectInfo& object : objects()) {
    if (has_board(scope.rig, object.board_kind)) {
      targets.push_back(fmt::format("{}.{}", name_of(object.target), object.name));
    }
  }
  return targets;
}

std::vector<const KindInfo*> list_kinds(std::string_view target, const Scope& scope) {
  const SplitTarget where = split(target);
  const ObjectInfo* object = find_object(where.target, where.object);
  std::vector<const KindInfo*> kinds;
  for (const KindInfo& info : vocabulary()) {
    if (can_do(info, where, object, &scope)) kinds.push_back(&info);
  }
  return kinds;
}

const ObjectInfo* object_of(std::string_view target) {
  const SplitTarget where = split(target);
  return find_object(where.target, where.object);
}

double Fault::value(std::string_view parameter) const {
  std::size_t index = 0;
  while (info->parameters[index].name != parameter) ++index;
  return values[index];
}

Scope make_scope(const config::Section& root, const config::Rig& rig) {
  const Section plant = root.peek("plant");
  return {rig, plant.has("kind") ? plant.text("kind") : "bizone"};
}

std::vector<Fault> read_faults(const Section& root, const Scope& scope) {
  std::vector<Fault> faults;
  for (const Section& section : root.sections("fault")) faults.push_back(read_fault(section, &scope, false));
  return faults;
}

Fault read_live_fault(std::string_view text, const Scope& scope) {
  if (text.find('\n') != std::string_view::npos) return read_live_table(config::parse_toml(text, "fault"), scope);
  const config::Table line = config::parse_toml(fmt::format("fault = {{ {} }}", text), "fault");
  return read_live_table(std::get<config::Table>(line.entries().front().value.data), scope);
}

std::string write_order(std::size_t number, bool begins, const Fault& fault) {
  config::Table order;
  order.set("fault", config::Value{static_cast<std::int64_t>(number), {}});
  order.set("begins", config::Value{begins, {}});
  order.set("what", config::Value{fault.table, {}});
  return config::write_toml(order);
}

std::optional<FaultOrder> read_order(std::string_view text) {
  try {
    const Section root{std::make_shared<const config::Table>(config::parse_toml(text, "order"))};
    if (!root.has("fault")) return {};
    FaultOrder order;
    order.number = static_cast<std::size_t>(root.integer("fault", config::at_least(0)));
    order.begins = root.boolean("begins");
    order.fault = read_fault(root.section("what"), nullptr, true);
    return order;
  } catch (const config::ConfigError&) {
    return {};
  }
}

}  // namespace meltbench::fault
