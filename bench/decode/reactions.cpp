#include "bench/decode/reactions.hpp"

#include <fmt/format.h>

#include <algorithm>

namespace meltbench::decode {
namespace {

using config::BoardKind;

constexpr Nanos kStands = 200ms;      // A feed that moved in every cycle and does not for so long stands still.
constexpr std::uint64_t kMoves = 10;  // So many changes in a row: it moves.
constexpr Nanos kStopsWith = 1s;      // An ordered stop of the screw and what is let go for it are not further apart.
constexpr canopen::ObjectAddress kScrewSpeed{0x60FF, 0};

/// Whether this set point of the controller goes to zero in its safe state.
bool is_release(BoardKind kind, canopen::ObjectAddress address) {
  return (kind == BoardKind::kPreconditioner && address == canopen::ObjectAddress{0x2002, 0}) ||
         (kind == BoardKind::kHeater && address == canopen::ObjectAddress{0x2000, 0});
}

/// The set points of the screw, in the order of time.
std::vector<const Finding*> list_screw_set_points(std::span<const Finding> findings, const config::Rig& rig) {
  std::vector<const Finding*> list;
  for (const Finding& finding : findings) {
    const config::RigBoard* board = find_board(rig, finding.node);
    if (finding.kind == FindingKind::kSetPoint && board != nullptr && board->kind == BoardKind::kScrewDrive &&
        finding.address == kScrewSpeed)
      list.push_back(&finding);
  }
  return list;
}

/// Whether the screw is being stopped in steps at this time, or stands since such a stop.
bool is_ordered_stop(std::span<const Finding* const> screw, Instant at) {
  const auto next = std::ranges::upper_bound(screw, Instant{at + kStopsWith}, {}, &Finding::at);
  if (next == screw.begin()) return false;
  const Finding& last = **std::prev(next);
  return last.after == 0.0 && (last.count >= kMoves || last.count == 1);
}

}  // namespace

const config::RigBoard* find_board(const config::Rig& rig, std::uint8_t node) {
  const auto found = std::ranges::find(rig.boards, node, &config::RigBoard::node_id);
  return node == 0 || found == rig.boards.end() ? nullptr : &*found;
}

std::string Reaction::text(const config::Rig& rig) const {
  const config::RigBoard* board = find_board(rig, node);
  const std::string who = board != nullptr                 ? board->name
                          : node == rig.controller_node_id ? std::string{"controller"}
                                                           : fmt::format("node {}", node);
  switch (kind) {
    case Kind::kBoot:
      return who + " boots up";
    case Kind::kEmcy:
      return fmt::format("{} sends EMCY {:04X}", who, code);
    case Kind::kSafeState:
      break;
  }
  return "the controller goes to its safe state";
}

std::optional<Reaction> find_safe_state(std::span<const Finding> findings, Instant end, const config::Rig& rig) {
  const std::vector<const Finding*> screw = list_screw_set_points(findings, rig);
  for (const Finding& finding : findings) {
    const config::RigBoard* board = find_board(rig, finding.node);
    if (finding.kind != FindingKind::kSetPoint || board == nullptr) continue;
    const bool falls = finding.before != 0.0 && finding.after == 0.0;
    if (falls && is_release(board->kind, finding.address) && !is_ordered_stop(screw, *finding.until)) {
      return Reaction{Reaction::Kind::kSafeState, *finding.until, 0, 0, 0, finding.node, finding.address};
    }
  }
  const bool has_release = std::ranges::any_of(rig.boards, [](const config::RigBoard& board) {
    return !board.is_on_line() && (board.kind == BoardKind::kPreconditioner || board.kind == BoardKind::kHeater);
  });
  if (has_release) return std::nullopt;
  for (const Finding& finding : findings) {
    const config::RigBoard* board = find_board(rig, finding.node);
    if (finding.kind != FindingKind::kSetPoint || board == nullptr || board->kind != BoardKind::kFeeder) continue;
    const bool moved = finding.code == 1 && end - *finding.until > kStands;
    if (moved && !is_ordered_stop(screw, *finding.until)) {
      return Reaction{Reaction::Kind::kSafeState, *finding.until, 0, 0, 0, 0, {}};
    }
  }
  return std::nullopt;
}

std::vector<Reaction> list_reactions(std::span<const Finding> findings, Instant end, const config::Rig& rig) {
  std::vector<Reaction> reactions;
  for (const Finding& finding : findings) {
    const bool is_known = finding.node == rig.controller_node_id || find_board(rig, finding.node) != nullptr;
    if (!is_known) continue;
    const bool is_boot = finding.kind == FindingKind::kBoot && finding.code == 1;
    const bool is_emcy = finding.kind == FindingKind::kEmcy && finding.code != 0;
    if (!is_boot && !is_emcy) continue;
    const auto kind = is_boot ? Reaction::Kind::kBoot : Reaction::Kind::kEmcy;
    reactions.push_back({kind, finding.at, finding.node, finding.id, is_emcy ? finding.code : std::uint16_t{0}, 0, {}});
  }
  if (const auto safe = find_safe_state(findings, end, rig)) reactions.push_back(*safe);
  std::ranges::stable_sort(reactions, {}, &Reaction::at);
  return reactions;
}

namespace {

bool is_same(const Reaction& one, const Reaction& other) {
  return one.kind == other.kind && one.node == other.node && one.code == other.code;
}

/// Pairs each recorded reaction with one of the run, in the order of time. False: it has none.
struct Pairs {
  std::vector<bool> recorded, again;
  Pairs(std::span<const Reaction> wanted, std::span<const Reaction> came, Nanos tolerance)
      : recorded(wanted.size()), again(came.size()) {
    std::size_t first = 0;  // All before came too early for whatever is still wanted.
    for (std::size_t i = 0; i < wanted.size(); ++i) {
      while (first < came.size() && came[first].at < wanted[i].at - tolerance) ++first;
      for (std::size_t k = first; k < came.size() && came[k].at - wanted[i].at <= tolerance; ++k) {
        if (again[k] || !is_same(wanted[i], came[k])) continue;
        recorded[i] = again[k] = true;
        break;
      }
    }
  }
};

}  // namespace

std::string describe_difference(std::span<const Reaction> recorded, std::span<const Reaction> again,
                                const config::Rig& rig, Nanos tolerance) {
  const Pairs pairs{recorded, again, tolerance};
  if (const auto lost = std::ranges::find(pairs.recorded, false); lost != pairs.recorded.end()) {
    const Reaction& wanted = recorded[static_cast<std::size_t>(lost - pairs.recorded.begin())];
    const auto other = std::ranges::find_if(again, [&](const Reaction& one) { return is_same(wanted, one); });
    const std::string instead = other == again.end() ? "not again" : fmt::format("now at {:.6f} s", to_s(other->at));
    return fmt::format("{:.6f} s: {}, {}", to_s(wanted.at), wanted.text(rig), instead);
  }
  const auto extra = std::ranges::find(pairs.again, false);
  if (extra == pairs.again.end()) return {};
  const Reaction& more = again[static_cast<std::size_t>(extra - pairs.again.begin())];
  return fmt::format("{:.6f} s: {}, which is not in the log", to_s(more.at), more.text(rig));
}

std::vector<Reaction> find_repeated(std::span<const Reaction> recorded, std::span<const Reaction> again,
                                    Nanos tolerance) {
  const Pairs pairs{recorded, again, tolerance};
  std::vector<Reaction> repeated;
  for (std::size_t i = 0; i < recorded.size(); ++i) {
    if (pairs.recorded[i]) repeated.push_back(recorded[i]);
  }
  return repeated;
}

}  // namespace meltbench::decode
