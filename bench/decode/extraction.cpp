#include "bench/decode/extraction.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <map>

#include "bench/decode/bus_trouble.hpp"

namespace meltbench::decode {
namespace {

using config::BoardKind;
using config::Table;
using config::Value;

constexpr Nanos kBehindLast = 1ms;          // A board is cut off so long after its last frame: before the next is due.
constexpr Nanos kStarting = 1s;             // After a boot-up: what is not valid yet is no fault.
constexpr Nanos kExplains = 500ms;          // A fault and its EMCY are not further apart.
constexpr Nanos kBootsWithin = 20ms;        // Of the first heartbeat after a silence.
constexpr Nanos kRecovers = 1s;             // What was held up by a dead bus comes within so long after it.
constexpr double kUsedShare = 0.3;          // Of a bus, on which errors can be seen; an estimate.
constexpr std::uint64_t kSecondSender = 3;  // So many heartbeats too early: there are two senders.
constexpr std::size_t kMost = 500;          // Faults, checks, notes: nobody reads more.
constexpr std::uint16_t kHeartbeatOfMaster = 0x8130;
constexpr std::uint16_t kSetPointsLost = 0xFF01;

template <typename T>
void set(Table& table, std::string_view key, T value) {
  table.set(key, Value{std::move(value), {}});
}

/// To the microsecond, as logs have it: no tail of binary digits in the file.
double seconds(Nanos span) {
  return std::round(to_s(span) * 1e6) / 1e6;
}
double seconds(Instant at) {
  return seconds(at.since_start);
}

/// The end of a fault behind which the next frame comes.
Instant just_before(std::optional<Instant> next) {
  return next ? Instant{*next - kBehindLast} : Instant::never();
}

/// Name of the sensor behind an analogue input of a board; empty if no fault is for it.
std::string sensor_name(BoardKind kind, std::uint8_t sub) {
  switch (kind) {
    case BoardKind::kMeltPressure:
      return sub == 1 ? "melt_pressure" : "melt_temperature";
    case BoardKind::kHeater:
      return sub == 5 ? std::string{"nozzle"} : fmt::format("zone{}", sub);
    case BoardKind::kMeltCamera:
      return sub == 1 ? "" : "inlet_temperature";  // A front that cannot be seen has many causes.
    case BoardKind::kPreconditioner:
      return "inlet_temperature";
    default:
      return {};
  }
}

/// Findings of one kind, by node, in the order of their beginning: what belongs together is found by its time.
class ByNode {
 public:
  ByNode(std::span<const Finding> findings, FindingKind kind) {
    for (const Finding& finding : findings) {
      if (finding.kind == kind) lists_[finding.node % lists_.size()].push_back(&finding);
    }
  }

  /// The last of a node that begins no later than `at`.
  [[nodiscard]] const Finding* find_last(std::uint8_t node, Instant at) const {
    const std::vector<const Finding*>& list = lists_[node % lists_.size()];
    const auto next = std::ranges::upper_bound(list, at, {}, &Finding::at);
    return next == list.begin() ? nullptr : *std::prev(next);
  }

  /// The first of a node that fits, of those that begin in [from, to].
  template <typename Fits>
  [[nodiscard]] const Finding* find(std::uint8_t node, Instant from, Instant to, const Fits& fits) const {
    const std::vector<const Finding*>& list = lists_[node % lists_.size()];
    auto place = std::ranges::lower_bound(list, from, {}, &Finding::at);
    for (; place != list.end() && (*place)->at <= to; ++place) {
      if (fits(**place)) return *place;
    }
    return nullptr;
  }

 private:
  std::array<std::vector<const Finding*>, 128> lists_;
};

bool is_any(const Finding& /*finding*/) {
  return true;
}

bool is_safe_state(const Reaction& reaction) {
  return reaction.kind == Reaction::Kind::kSafeState;
}

bool is_unasked(const Finding& boot) {
  return boot.code == 1;
}

class Extractor {
 public:
  Extractor(std::span<const Finding> findings, Instant end, const config::Rig& rig)
      : findings_{findings},
        end_{end},
        rig_{rig},
        boots_{findings, FindingKind::kBoot},
        silences_{findings, FindingKind::kHeartbeatLost},
        emcys_{findings, FindingKind::kEmcy},
        invalids_{findings, FindingKind::kInvalid},
        too_often_{findings, FindingKind::kTooOften},
        states_{findings, FindingKind::kErrorState},
        node_states_{findings, FindingKind::kState},
        commands_{findings, FindingKind::kNmt},
        gaps_{findings, FindingKind::kGap},
        troubles_{find_bus_troubles(findings, rig)} {}

  Extraction run() {
    for (const BusTrouble& trouble : troubles_) on_trouble(trouble);
    for (const Finding& finding : findings_) take(finding);
    result_.reactions = list_reactions(findings_, end_, rig_);
    result_.needs_ideal = has_second_node_ && !result_.needs_bit_timed;
    result_.checks = make_checks(result_.reactions, rig_, style_of(result_));
    result_.is_unexplained = result_.faults.empty() && std::ranges::any_of(result_.reactions, is_safe_state);
    tidy();
    return std::move(result_);
  }

 private:
  void take(const Finding& finding) {
    switch (finding.kind) {
      case FindingKind::kBoot:
        return on_boot(finding);
      case FindingKind::kHeartbeatLost:
        return is_of_trouble(finding) ? void() : on_heartbeat_lost(finding);
      case FindingKind::kGap:
        return is_of_trouble(finding) || is_controllers(finding) ? void() : drop(finding, finding.id, 0x7FF);
      case FindingKind::kInvalid:
        return on_invalid(finding);
      case FindingKind::kEmcy:
        return on_emcy(finding);
      case FindingKind::kTooOften:
        return is_of_trouble(finding) ? void() : on_too_often(finding);
      case FindingKind::kErrorState:
        return on_error_state(finding);
      case FindingKind::kUnknown:
        return is_of_trouble(finding) ? void() : note(finding);
      case FindingKind::kSdoFailed:
        return is_starting(finding.node, finding.at) ? void() : note(finding);  // A master asks what it does not know.
      default:
        return;
    }
  }

  /// In the order of time, expectations once, and no more of anything than somebody would read.
  void tidy() {
    std::ranges::stable_sort(result_.faults, {},
                             [](const Table& fault) { return std::get<double>(fault.find("at_s")->value.data); });
    std::ranges::sort(result_.expect);
    result_.expect.erase(std::unique(result_.expect.begin(), result_.expect.end()), result_.expect.end());
    if (left_out_ > 0) result_.notes.push_back(fmt::format("{} more of all this", left_out_));
  }

  [[nodiscard]] bool has_room(std::size_t used) {
    if (used < kMost) return true;
    ++left_out_;
    return false;
  }

  void note(const Finding& finding) {
    if (!has_room(result_.notes.size())) return;
    result_.notes.push_back(fmt::format("{:.6f} s: {}", to_s(finding.at), finding.text));
  }

  void expect(std::initializer_list<std::string_view> codes) {
    for (const std::string_view code : codes) result_.expect.emplace_back(code);
  }

  /// @param until  never(): to the end.
  Table& add_fault(std::string target, std::string_view kind, Instant at, Instant until) {
    Table fault;
    set(fault, "target", std::move(target));
    set(fault, "kind", std::string{kind});
    set(fault, "at_s", seconds(at));
    if (until != Instant::never() && until > at) set(fault, "for_s", seconds(until - at));
    if (!has_room(result_.faults.size())) return spare_ = std::move(fault);
    result_.faults.push_back(std::move(fault));
    return result_.faults.back();
  }

  void drop(const Finding& finding, std::uint32_t id, std::uint32_t mask) {
    Table& fault = add_fault("frame", "drop", finding.at + kBehindLast, just_before(finding.until));
    set(fault, "id", static_cast<std::int64_t>(id));
    set(fault, "mask", static_cast<std::int64_t>(mask));
    expect({"controller.tpdos_missed", "controller.syncs_missed", "controller.heartbeats_lost",
            "controller.heartbeat-lost", "plant.master-lost"});
    expect_late_values();
  }

  void expect_late_values() {
    expect({"controller.measurement-stale", "controller.screw-stale", "controller.feed-stale", "controller.front-stale",
            "controller.inlet-stale", "controller.zone-stale"});
  }

  // --- the wire

  /// Whether what stays away, comes too often or is nobody's belongs to a trouble of the wire itself.
  [[nodiscard]] bool is_of_trouble(const Finding& finding) const {
    return std::ranges::any_of(troubles_, [&](const BusTrouble& trouble) {
      if (trouble.kind == BusTrouble::Kind::kCorrupted || trouble.kind == BusTrouble::Kind::kNoise) return false;
      if (trouble.kind == BusTrouble::Kind::kBabble && trouble.id == finding.id) return true;
      const Instant over = trouble.until.value_or(end_) + kRecovers;
      return finding.at <= over && finding.until.value_or(end_) >= trouble.at;
    });
  }

  void on_trouble(const BusTrouble& trouble) {
    result_.needs_bit_timed = true;
    if (!result_.restart_after) result_.restart_after = find_restart_delay(findings_);
    expect_bus_trouble();
    const Instant until = trouble.until.value_or(Instant::never());
    switch (trouble.kind) {
      case BusTrouble::Kind::kShortCircuit:
        add_fault("bus", "short_circuit", trouble.at, until);
        return;
      case BusTrouble::Kind::kStuckDominant:
        add_fault("bus", "stuck_dominant", trouble.at, until);
        return;
      case BusTrouble::Kind::kCorrupted:
        set(add_fault("frame", "corrupt", std::max(Instant{}, Instant{trouble.at - kBehindLast}), Instant::never()),
            "count", static_cast<std::int64_t>(trouble.count));
        return;
      case BusTrouble::Kind::kNoise: {
        const double bits = to_s(until - trouble.at) * rig_.bus.bit_rate_bit_per_s * kUsedShare;
        set(add_fault("bus", "noise", trouble.at, until), "bit_error_rate",
            std::clamp(static_cast<double>(trouble.count) / std::max(bits, 1.0), 1e-9, 1.0));
        return;
      }
      case BusTrouble::Kind::kBabble:
        set(add_fault("bus." + find_babbler(trouble), "babble", trouble.at, until), "id",
            static_cast<std::int64_t>(trouble.id));
        return;
    }
  }

  /// Who babbles holds up his own frames most, and does not complain; he is not silent either. Of several: the first.
  [[nodiscard]] std::string find_babbler(const BusTrouble& trouble) const {
    const Instant until = trouble.until.value_or(end_);
    std::string name = "controller";
    int best = -1;
    for (const config::RigBoard& board : rig_.boards) {
      if (board.is_on_line()) continue;
      const bool complains = emcys_.find(board.node_id, trouble.at, until, is_any) != nullptr;
      const bool is_silent = silences_.find(board.node_id, Instant{trouble.at - 1s}, until, is_any) != nullptr;
      const int score = (complains ? 0 : 2) + (is_silent ? 0 : 1);
      if (score <= best) continue;
      best = score;
      name = board.name;
    }
    return name;
  }

  void expect_bus_trouble() {
    expect({"error-frames", "lost-frames", "bench.error-passive", "bench.error-warning", "bench.bus-off",
            "bench.bus-restarted", "controller.bus-off", "controller.bus-passive", "controller.bus-warning",
            "controller.bus-restarted", "controller.heartbeat-lost", "controller.heartbeats_lost",
            "controller.tpdos_missed", "controller.sdo_timeouts", "plant.master-lost"});
    expect_late_values();
  }

  /// The state of one node's bus controller: a node that is bus-off is silent, the rest is of a trouble of all.
  void on_error_state(const Finding& finding) {
    result_.needs_bit_timed = true;
    expect_bus_trouble();
    const bool is_known = std::ranges::any_of(troubles_, [&](const BusTrouble& trouble) {
      return finding.at >= trouble.at && finding.at <= trouble.until.value_or(end_) + kRecovers;
    });
    if (!is_known && finding.code != 1) note(finding);
  }

  /// Whether a node went bus-off behind its last frame.
  [[nodiscard]] bool is_bus_off(const Finding& silence) const {
    constexpr std::uint16_t kBusOff = 1;
    return states_.find(0, silence.at, silence.until.value_or(end_),
                        [](const Finding& state) { return state.code == kBusOff; }) != nullptr;
  }

  // --- boards

  void on_boot(const Finding& finding) {
    if (finding.code != 1) return;
    if (finding.node == rig_.controller_node_id) return on_controller_boot(finding);
    const config::RigBoard* board = find_board(rig_, finding.node);
    if (board == nullptr) return;
    expect({"controller.node-reset", "controller.node-not-operational", "controller.heartbeat-lost",
            "controller.heartbeats_lost", "controller.tpdos_missed"});
    if (is_second_node(finding.node, finding.at)) return;  // on_too_often() has it.
    const Finding* silence = silences_.find_last(finding.node, finding.at);
    if (silence != nullptr && silence->until == finding.at) return;
    if (goes_on(finding)) {
      add_fault("board." + board->name, "same_node_id", finding.at, Instant::never());
      return expect_second_node();
    }
    add_fault("board." + board->name, "reboot", finding.at, Instant::never());
  }

  /// A controller that starts anew boots up by itself, and resets all boards, which then were asked.
  void on_controller_boot(const Finding& boot) {
    const Finding* silence = silences_.find_last(boot.node, boot.at);
    if (silence != nullptr && silence->until.value_or(end_) >= boot.at - kBootsWithin)
      return;  // Told with the silence.
    add_fault("program.controller", "restart", boot.at, Instant::never());
    expect_no_controller();
  }

  void expect_no_controller() {
    expect({"plant.master-lost", "controller.emcy", "controller.emcys", "controller.tpdos_missed"});
    expect_late_values();
  }

  /// Whether heartbeats of two senders come around this time.
  [[nodiscard]] bool is_second_node(std::uint8_t node, Instant at) const {
    const Finding* row = too_often_.find_last(node, Instant{at + kStarting});
    return row != nullptr && row->count >= kSecondSender && *row->until >= at - kStarting;
  }

  /// Whether a node that boots up says that it is operational, and nobody has started it: that is another one.
  [[nodiscard]] bool goes_on(const Finding& boot) const {
    constexpr auto kOperational = static_cast<std::uint16_t>(canopen::NmtState::kOperational);
    const Finding* state = node_states_.find(boot.node, boot.at, Instant{boot.at + kStarting}, is_any);
    if (state == nullptr || state->code != kOperational) return false;
    const auto starts_it = [&](const Finding& command) {
      constexpr unsigned kStart = 1;
      const unsigned whom = command.code & 0xFFU;
      return command.code >> 8U == kStart && (whom == 0 || whom == boot.node);
    };
    return commands_.find(0, boot.at, state->at, starts_it) == nullptr;
  }

  void expect_second_node() {
    has_second_node_ = true;
    expect({"controller.node-reset", "controller.node-doubled", "controller.node-not-operational",
            "controller.heartbeat-lost", "controller.heartbeats_lost", "controller.tpdos_missed"});
    expect_late_values();
  }

  void on_too_often(const Finding& finding) {
    const config::RigBoard* board = find_board(rig_, finding.node);
    if (board == nullptr || finding.count < kSecondSender) return note(finding);
    const Instant until{*finding.until + kBehindLast};
    // Its first heartbeat came a period after it did.
    const Instant from = std::max(Instant{}, Instant{finding.at - Nanos{std::llround(finding.before * 1e9)}});
    Table& fault = add_fault("board." + board->name, "same_node_id", from, until);
    set(fault, "running", std::int64_t{1});
    expect_second_node();
  }

  void on_heartbeat_lost(const Finding& finding) {
    const config::RigBoard* board = find_board(rig_, finding.node);
    if (board == nullptr) return on_controller_silent(finding);
    if (is_starting_unasked(finding))
      return;  // A board that has been reset sends nothing until it is configured again.
    expect({"controller.heartbeat-lost", "controller.heartbeats_lost", "controller.tpdos_missed"});
    const Instant from = finding.at + kBehindLast;
    const Instant until = finding.until.value_or(Instant::never());
    if (finding.code == 0) {
      add_fault("board." + board->name, "heartbeat_lost", from, just_before(finding.until));
    } else if (is_bus_off(finding)) {
      add_fault("bus." + board->name, "bus_off", from, until);
    } else if (!finding.until || boots_.find(finding.node, Instant{until - kBootsWithin}, Instant{until + kBootsWithin},
                                             is_any) != nullptr) {
      add_fault("board." + board->name, "off", from, until);
    } else {
      drop(finding, finding.node, 0x7F);
    }
  }

  /// SYNC that stays away together with the controller's heartbeat, and until it is back; null if it does not.
  [[nodiscard]] const Finding* find_sync_gap(const Finding& silence) const {
    const Finding* gap = gaps_.find_last(0, Instant{silence.at + kStarting});
    if (gap == nullptr || gap->at < silence.at - kStarting || gap->until.has_value() != silence.until.has_value()) {
      return nullptr;
    }
    return !gap->until || std::chrono::abs(*gap->until - *silence.until) <= kStarting ? gap : nullptr;
  }

  /// The controller's heartbeat alone is a frame that was lost. With SYNC it was the controller itself.
  void on_controller_silent(const Finding& finding) {
    const Finding* gap = find_sync_gap(finding);
    if (gap == nullptr || finding.node != rig_.controller_node_id) return drop(finding, finding.id, 0x7FF);
    const Instant over = finding.until.value_or(end_);
    const Finding* boot =
        boots_.find(finding.node, Instant{over - kBootsWithin}, Instant{over + kStarting}, is_unasked);
    const Instant from{std::max(finding.at, gap->at) + kBehindLast};
    if (!finding.until || boot != nullptr) {
      add_fault("program.controller", "killed", from, boot != nullptr ? boot->at : Instant::never());
      return expect_no_controller();
    }
    drop(finding, finding.id, 0x7FF);
    drop(*gap, gap->id, 0x7FF);
  }

  /// A gap of SYNC that is told with the controller's silence.
  [[nodiscard]] bool is_controllers(const Finding& gap) const {
    if (gap.node != 0) return false;
    const Finding* silence = silences_.find_last(rig_.controller_node_id, Instant{gap.at + kStarting});
    return silence != nullptr && find_sync_gap(*silence) == &gap;
  }

  [[nodiscard]] bool is_starting_unasked(const Finding& silence) const {
    return boots_.find(silence.node, Instant{silence.at - kStarting}, Instant{silence.at - Nanos{1}}, is_unasked) !=
           nullptr;
  }

  [[nodiscard]] bool is_starting(std::uint8_t node, Instant at) const {
    return boots_.find(node, Instant{at - kStarting}, at, is_any) != nullptr;
  }

  void on_invalid(const Finding& finding) {
    const config::RigBoard* board = find_board(rig_, finding.node);
    if (board == nullptr || is_starting(finding.node, finding.at) || is_second_node(finding.node, finding.at)) return;
    const std::string sensor = sensor_name(board->kind, finding.address.sub);
    if (sensor.empty()) return note(finding);
    // Thermocouples that break read high, loops of 4-20 mA low; the other way round is a short circuit, or too much.
    constexpr std::uint16_t kAbove = 2;
    const bool reads_high = (finding.code & kAbove) != 0;
    const bool is_short = board->kind == BoardKind::kMeltPressure && reads_high;
    // It was well one cycle before. An EMCY may have told it sooner than the next report.
    Instant at = finding.at;
    if (const Finding* emcy = emcys_.find(finding.node, Instant{at - kExplains}, Instant{at - Nanos{1}}, is_any)) {
      at = emcy->at;
    }
    if (has_fault("sensor." + sensor)) return;  // Two boards show the same.
    at = std::max(Instant{}, Instant{at - rig_.bus.sync_period + kBehindLast});
    add_fault("sensor." + sensor, is_short ? "short_circuit" : "open_circuit", at,
              finding.until.value_or(Instant::never()));
    expect({"controller.measurement-implausible", "controller.zone-sensor-open", "controller.inlet-stale",
            "plant.zone-alarm", "controller.emcy", "controller.emcys"});
  }

  [[nodiscard]] bool has_fault(const std::string& target) const {
    return std::ranges::any_of(result_.faults, [&](const Table& fault) {
      return std::get<std::string>(fault.find("target")->value.data) == target;
    });
  }

  [[nodiscard]] bool is_explained(const Finding& emcy) const {
    const bool misses_master = emcy.code == kHeartbeatOfMaster || emcy.code == kSetPointsLost;
    return misses_master ||
           invalids_.find(emcy.node, Instant{emcy.at - kExplains}, Instant{emcy.at + kExplains}, is_any) != nullptr;
  }

  void on_emcy(const Finding& finding) {
    const config::RigBoard* board = find_board(rig_, finding.node);
    if (finding.code == 0 || board == nullptr) return;
    expect({"controller.emcy", "controller.emcys"});
    result_.expect.push_back(fmt::format("emcy:{}:{:04X}", board->name, finding.code));
    if (is_explained(finding)) return;
    const Nanos lasted = *finding.until - finding.at;
    const double period_ms =
        finding.count > 1 ? seconds(lasted) * 1e3 / static_cast<double>(finding.count - 1) : 10'000.0;
    const Nanos half = finding.count > 1 ? lasted / static_cast<std::int64_t>(2 * (finding.count - 1)) : kBehindLast;
    Table& fault = add_fault("board." + board->name, "emcy_storm", finding.at, *finding.until + half);
    set(fault, "code", static_cast<std::int64_t>(finding.code));
    set(fault, "period_ms", std::max(period_ms, 0.1));
  }

  std::span<const Finding> findings_;
  Instant end_;
  const config::Rig& rig_;
  ByNode boots_, silences_, emcys_, invalids_, too_often_, states_, node_states_, commands_, gaps_;
  std::vector<BusTrouble> troubles_;
  Table spare_;  ///< A fault beyond kMost.
  std::uint64_t left_out_ = 0;
  bool has_second_node_ = false;
  Extraction result_;
};

/// Writes the checks that a list of reactions asks for.
class CheckWriter {
 public:
  CheckWriter(const config::Rig& rig, CheckStyle style) : rig_{rig}, style_{style} {}

  std::vector<Table> write(std::span<const Reaction> reactions) {
    for (const Reaction& reaction : reactions.first(std::min(reactions.size(), kMost))) check_reaction(reaction);
    if (!style_.on_wire && std::ranges::none_of(reactions, is_safe_state)) check_no_safe_state();
    return std::move(checks_);
  }

 private:
  std::string unique_name(const std::string& name) {
    const unsigned number = ++names_[name];
    return number == 1 ? name : fmt::format("{} ({})", name, number);
  }

  void check_reaction(const Reaction& reaction) {
    if (reaction.kind == Reaction::Kind::kSafeState) return check_safe_state(reaction);
    const bool is_boot = reaction.kind == Reaction::Kind::kBoot;
    check_frame(reaction, is_boot ? "00" : fmt::format("{:02X} {:02X}", reaction.code & 0xFFU, reaction.code >> 8U));
  }

  /// A frame that begins with `data` comes at its time in the log.
  void check_frame(const Reaction& reaction, std::string data) {
    Table from;
    set(from, "at_s", seconds(std::max(Instant{}, Instant{reaction.at - kReactionTolerance})));
    Table to;
    set(to, "cob_id", static_cast<std::int64_t>(reaction.id));
    set(to, "data", std::move(data));
    Table check;
    set(check, "name", unique_name(reaction.text(rig_)));
    set(check, "kind", std::string{"reaction"});
    set(check, "from", std::move(from));
    set(check, "to", std::move(to));
    set(check, "within_ms", seconds(2 * kReactionTolerance) * 1e3);
    checks_.push_back(std::move(check));
  }

  void check_safe_state(const Reaction& reaction) {
    Table check;
    set(check, "name", std::string{"the controller goes to its safe state when it did"});
    set(check, "kind", std::string{"response"});
    if (style_.on_wire && reaction.released != 0) {
      set(check, "signal",
          fmt::format("wire.{}.{:04X}", find_board(rig_, reaction.released)->name, reaction.release.index));
      set(check, "level", kReleased);
      set(check, "from_s", seconds(std::max(Instant{}, Instant{reaction.at - kBeforeRelease})));
    } else {
      set(check, "signal", std::string{"controller.state"});
      set(check, "level", kBelowSafe);
    }
    set(check, "not_before_s", seconds(std::max(Instant{}, Instant{reaction.at - kReactionTolerance})));
    set(check, "within_s", seconds(reaction.at + kReactionTolerance));
    checks_.push_back(std::move(check));
  }

  void check_no_safe_state() {
    Table check;
    set(check, "name", std::string{"no safe state"});
    set(check, "kind", std::string{style_.without_values ? "never" : "always"});
    set(check, "signal", std::string{"controller.state"});
    set(check, style_.without_values ? "above" : "below", kBelowSafe);
    checks_.push_back(std::move(check));
  }

  static constexpr double kBelowSafe = 3.5;  // controller.state: running is 3, safe 4.
  static constexpr double kReleased = 0.5;
  static constexpr Nanos kBeforeRelease = 100ms;
  const config::Rig& rig_;
  CheckStyle style_;
  std::map<std::string, unsigned> names_;
  std::vector<Table> checks_;
};

}  // namespace

CheckStyle style_of(const Extraction& found) {
  const bool dies = std::ranges::any_of(found.faults, [](const Table& fault) {
    return fault.find("kind")->value == Value{std::string{"killed"}, {}};
  });
  return {found.needs_bit_timed, dies};
}

std::vector<config::Table> make_checks(std::span<const Reaction> reactions, const config::Rig& rig, CheckStyle style) {
  return CheckWriter{rig, style}.write(reactions);
}

void add_line_faults(Extraction& found, std::span<const LineReport> lines, Instant end) {
  for (const LineReport& report : lines) {
    if (report.troubles.empty()) continue;
    const std::string target = "line." + report.line;
    const auto add = [&](std::string_view kind, Instant at, Instant until) -> Table& {
      Table fault;
      set(fault, "target", target);
      set(fault, "kind", std::string{kind});
      set(fault, "at_s", seconds(at));
      if (until < end) set(fault, "for_s", seconds(until - at));
      found.faults.push_back(std::move(fault));
      return found.faults.back();
    };
    const Instant first = report.troubles.front().at;
    const bool lets_go = std::ranges::any_of(
        found.reactions, [&](const Reaction& reaction) { return is_safe_state(reaction) && reaction.at >= first; });
    const bool in_detail = lets_go && report.troubles.size() <= kMost;
    for (const LineTrouble& trouble : report.troubles) {
      const bool is_silent = trouble.kind == LineTrouble::Kind::kSilent;
      if (is_silent) add("unplugged", trouble.at, trouble.until);
      if (in_detail && !is_silent) set(add("noise", trouble.at, trouble.until), "share", 1.0);
    }
    if (report.garbled > 0 && !in_detail) {
      set(add("noise", first, report.troubles.back().until), "share", std::round(report.byte_share * 1e4) / 1e4);
    }
    for (const std::string_view code : {"controller.device-lost", "controller.line-down", "plant.master-lost"}) {
      found.expect.emplace_back(code);
    }
  }
  if (!found.faults.empty()) found.is_unexplained = false;
}

Extraction extract(std::span<const Finding> findings, Instant end, const config::Rig& rig) {
  return Extractor{findings, end, rig}.run();
}

}  // namespace meltbench::decode
