#include "bench/decode/extraction.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

namespace meltbench::decode {
namespace {

using config::BoardKind;
using config::Table;
using config::Value;

constexpr Nanos kBehindLast = 1ms;    // A board is cut off so long after its last frame: before the next is due.
constexpr Nanos kStarting = 1s;       // After a boot-up: what is not valid yet is no fault.
constexpr Nanos kExplains = 500ms;    // A fault and its EMCY are not further apart.
constexpr Nanos kBootsWithin = 20ms;  // Of the first heartbeat after a silence.
constexpr Nanos kStands = 200ms;      // A feed that moved in every cycle and does not for so long stands still.
constexpr std::uint64_t kMoves = 10;  // So many changes in a row: it moves.
constexpr std::uint16_t kHeartbeatOfMaster = 0x8130;

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

const config::RigBoard* find_board(const config::Rig& rig, std::uint8_t node) {
  const auto found = std::ranges::find(rig.boards, node, &config::RigBoard::node_id);
  return node == 0 || found == rig.boards.end() ? nullptr : &*found;
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

/// Whether this set point of the controller goes to zero in its safe state, and only there.
bool is_release(BoardKind kind, canopen::ObjectAddress address) {
  return (kind == BoardKind::kPreconditioner && address == canopen::ObjectAddress{0x2002, 0}) ||
         (kind == BoardKind::kHeater && address == canopen::ObjectAddress{0x2000, 0});
}

class Extractor {
 public:
  Extractor(std::span<const Finding> findings, Instant end, const config::Rig& rig)
      : findings_{findings}, end_{end}, rig_{rig} {}

  Extraction run() {
    for (const Finding& finding : findings_) {
      switch (finding.kind) {
        case FindingKind::kBoot:
          on_boot(finding);
          break;
        case FindingKind::kHeartbeatLost:
          on_heartbeat_lost(finding);
          break;
        case FindingKind::kGap:
          drop(finding, finding.id, 0x7FF);
          break;
        case FindingKind::kInvalid:
          on_invalid(finding);
          break;
        case FindingKind::kEmcy:
          on_emcy(finding);
          break;
        case FindingKind::kErrorFrames:
        case FindingKind::kErrorState:
        case FindingKind::kUnknown:
        case FindingKind::kTooOften:
        case FindingKind::kSdoFailed:
          note(finding);
          break;
        default:
          break;
      }
    }
    check_safe_state();
    std::ranges::sort(result_.expect);
    const auto repeated = std::ranges::unique(result_.expect);
    result_.expect.erase(repeated.begin(), repeated.end());
    return std::move(result_);
  }

 private:
  void note(const Finding& finding) {
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
    result_.faults.push_back(std::move(fault));
    return result_.faults.back();
  }

  void drop(const Finding& finding, std::uint32_t id, std::uint32_t mask) {
    Table& fault = add_fault("frame", "drop", finding.at + kBehindLast, just_before(finding.until));
    set(fault, "id", static_cast<std::int64_t>(id));
    set(fault, "mask", static_cast<std::int64_t>(mask));
    expect({"controller.tpdos_missed", "controller.syncs_missed", "controller.heartbeats_lost",
            "controller.heartbeat-lost", "controller.measurement-stale", "controller.screw-stale",
            "controller.feed-stale", "controller.front-stale", "controller.inlet-stale", "controller.zone-stale",
            "plant.master-lost"});
  }

  /// Whether a node boots up at the end of a silence.
  [[nodiscard]] const Finding* find_boot(std::uint8_t node, Instant at) const {
    for (const Finding& finding : findings_) {
      const Nanos apart = finding.at - at;
      if (finding.kind == FindingKind::kBoot && finding.node == node && apart >= -kBootsWithin && apart <= kBootsWithin)
        return &finding;
    }
    return nullptr;
  }

  void on_boot(const Finding& finding) {
    const config::RigBoard* board = find_board(rig_, finding.node);
    if (finding.code != 1 || board == nullptr) return;
    check_frame(fmt::format("{} boots up", board->name), finding, "00");
    expect({"controller.node-reset", "controller.node-not-operational", "controller.heartbeat-lost",
            "controller.heartbeats_lost", "controller.tpdos_missed"});
    const bool ends_silence = std::ranges::any_of(findings_, [&](const Finding& other) {
      return other.kind == FindingKind::kHeartbeatLost && other.node == finding.node && other.until == finding.at;
    });
    if (!ends_silence) add_fault("board." + board->name, "reboot", finding.at, Instant::never());
  }

  void on_heartbeat_lost(const Finding& finding) {
    const config::RigBoard* board = find_board(rig_, finding.node);
    if (board == nullptr) return drop(finding, finding.id, 0x7FF);
    if (find_reboot_in(finding)) return;  // A board that has been reset sends nothing until it is configured again.
    expect({"controller.heartbeat-lost", "controller.heartbeats_lost", "controller.tpdos_missed"});
    const Instant from = finding.at + kBehindLast;
    if (finding.code == 0) {
      add_fault("board." + board->name, "heartbeat_lost", from, just_before(finding.until));
    } else if (!finding.until || find_boot(finding.node, *finding.until) != nullptr) {
      add_fault("board." + board->name, "off", from, finding.until.value_or(Instant::never()));
    } else {
      drop(finding, finding.node, 0x7F);
    }
  }

  [[nodiscard]] bool find_reboot_in(const Finding& silence) const {
    return std::ranges::any_of(findings_, [&](const Finding& boot) {
      return boot.kind == FindingKind::kBoot && boot.node == silence.node && boot.code == 1 && boot.at < silence.at &&
             silence.at - boot.at < kStarting;
    });
  }

  [[nodiscard]] bool is_starting(std::uint8_t node, Instant at) const {
    return std::ranges::any_of(findings_, [&](const Finding& boot) {
      return boot.kind == FindingKind::kBoot && boot.node == node && boot.at <= at && at - boot.at < kStarting;
    });
  }

  void on_invalid(const Finding& finding) {
    const config::RigBoard* board = find_board(rig_, finding.node);
    if (board == nullptr || is_starting(finding.node, finding.at)) return;
    const std::string sensor = sensor_name(board->kind, finding.address.sub);
    if (sensor.empty()) return note(finding);
    // Thermocouples that break read high, loops of 4-20 mA low; the other way round is a short circuit, or too much.
    constexpr std::uint16_t kAbove = 2;
    const bool reads_high = (finding.code & kAbove) != 0;
    const bool is_short = board->kind == BoardKind::kMeltPressure && reads_high;
    // It was well one cycle before. An EMCY may have told it sooner than the next report.
    Instant at = finding.at;
    for (const Finding& emcy : findings_) {
      if (emcy.kind == FindingKind::kEmcy && emcy.node == finding.node && emcy.at < at && at - emcy.at < kExplains)
        at = emcy.at;
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
    if (emcy.code == kHeartbeatOfMaster) return true;
    return std::ranges::any_of(findings_, [&](const Finding& other) {
      const Nanos apart = other.at - emcy.at;
      return other.kind == FindingKind::kInvalid && other.node == emcy.node && apart < kExplains && -apart < kExplains;
    });
  }

  void on_emcy(const Finding& finding) {
    const config::RigBoard* board = find_board(rig_, finding.node);
    if (finding.code == 0 || board == nullptr) return;
    check_frame(fmt::format("{} sends EMCY {:04X}", board->name, finding.code), finding,
                fmt::format("{:02X} {:02X}", finding.code & 0xFFU, finding.code >> 8U));
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

  // --- checks

  std::string unique_name(std::string name) {
    for (int number = 2; std::ranges::any_of(
             result_.checks,
             [&](const Table& check) { return std::get<std::string>(check.find("name")->value.data) == name; });
         ++number) {
      name = fmt::format("{} ({})", name.substr(0, name.find(" (")), number);
    }
    return name;
  }

  /// A frame that begins with `data` comes at its time in the log.
  void check_frame(std::string name, const Finding& finding, std::string data) {
    Table from;
    set(from, "at_s", seconds(std::max(Instant{}, Instant{finding.at - kReactionTolerance})));
    Table to;
    set(to, "cob_id", static_cast<std::int64_t>(finding.id));
    set(to, "data", std::move(data));
    Table check;
    set(check, "name", unique_name(std::move(name)));
    set(check, "kind", std::string{"reaction"});
    set(check, "from", std::move(from));
    set(check, "to", std::move(to));
    set(check, "within_ms", seconds(2 * kReactionTolerance) * 1e3);
    result_.checks.push_back(std::move(check));
  }

  /// When the controller gave up: the first release that goes to zero, else when a feed that moved stands still.
  [[nodiscard]] std::optional<Instant> find_safe_state() const {
    for (const Finding& finding : findings_) {
      const config::RigBoard* board = find_board(rig_, finding.node);
      if (finding.kind != FindingKind::kSetPoint || board == nullptr) continue;
      const bool falls = finding.before != 0.0 && finding.after == 0.0;
      if (falls && is_release(board->kind, finding.address)) return finding.until;
    }
    for (const Finding& finding : findings_) {
      const config::RigBoard* board = find_board(rig_, finding.node);
      if (finding.kind != FindingKind::kSetPoint || board == nullptr || board->kind != BoardKind::kFeeder) continue;
      if (finding.count >= kMoves && end_ - *finding.until > kStands) return finding.until;
    }
    return std::nullopt;
  }

  /// @pre all faults have been found.
  void check_safe_state() {
    constexpr double kBelowSafe = 3.5;  // controller.state: running is 3, safe 4.
    const auto safe_at = find_safe_state();
    Table check;
    set(check, "name", std::string{safe_at ? "the controller goes to its safe state when it did" : "no safe state"});
    set(check, "kind", std::string{safe_at ? "response" : "always"});
    set(check, "signal", std::string{"controller.state"});
    if (safe_at && result_.faults.empty()) {
      result_.notes.push_back(fmt::format("{:.6f} s: why the controller went to its safe state", to_s(*safe_at)));
    }
    if (safe_at) {
      set(check, "level", kBelowSafe);
      set(check, "not_before_s", seconds(std::max(Instant{}, Instant{*safe_at - kReactionTolerance})));
      set(check, "within_s", seconds(*safe_at + kReactionTolerance));
    } else {
      set(check, "below", kBelowSafe);
    }
    result_.checks.push_back(std::move(check));
  }

  std::span<const Finding> findings_;
  Instant end_;
  const config::Rig& rig_;
  Extraction result_;
};

}  // namespace

Extraction extract(std::span<const Finding> findings, Instant end, const config::Rig& rig) {
  return Extractor{findings, end, rig}.run();
}

}  // namespace meltbench::decode
