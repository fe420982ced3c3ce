#include "bench/decode/bus_trouble.hpp"

#include <linux/can/error.h>

#include <algorithm>
#include <cmath>

#include "protocols/can/frame_length.hpp"

namespace meltbench::decode {
namespace {

constexpr Nanos kOneTrouble = 1s;          // Signs closer than this are of one trouble.
constexpr std::int64_t kSilentCycles = 3;  // Of SYNC, that a bus is silent behind an error: it is dead.
constexpr std::uint64_t kFew = 3;          // So many error frames are told one by one.
constexpr std::uint64_t kBabbles = 20;     // Frames of one identifier,
constexpr Nanos kBabblePeriod = 5ms;       // closer than this on the average: no device sends like that.
constexpr std::size_t kMost = 200;         // Troubles of a log; what has more is no bus.
constexpr std::uint32_t kDestroyed = CAN_ERR_PROT | CAN_ERR_BUSERROR | CAN_ERR_ACK;  // Not: a counter has risen.
constexpr std::uint32_t kHighestStandard = 0x7FF;
constexpr std::int64_t kFrameBits = 135;  // Of a classic frame with eight bytes, stuffed, and the pause behind it.

bool is_sign(const Finding& finding) {
  return finding.kind == FindingKind::kErrorFrames || finding.kind == FindingKind::kErrorState;
}

bool is_babble(const Finding& finding) {
  const bool may_be = finding.kind == FindingKind::kUnknown || finding.kind == FindingKind::kNmt ||
                      finding.kind == FindingKind::kTooOften;
  if (!may_be || finding.count < kBabbles || finding.id > kHighestStandard) return false;
  return (*finding.until - finding.at) / static_cast<std::int64_t>(finding.count) <= kBabblePeriod;
}

/// All signs of one trouble.
struct Signs {
  Instant first, last;
  Instant last_before;                 ///< Frame that came through,
  std::optional<Instant> first_after;  ///< and the first one again.
  bool came_between = false;           ///< Some did all the time.
  Instant last_error;                  ///< Frame; the states of nodes go on changing behind it.
  std::uint64_t errors = 0;
  bool has_lost_bits = false;
  bool has_bus_off = false;
  std::string text;
};

Nanos from_seconds(double span_s) {
  return Nanos{std::llround(span_s * 1e9)};
}

void take_error_frames(Signs& signs, const Finding& row) {
  const Instant last = *row.until;
  if (signs.errors == 0) signs.last_before = Instant{row.at - from_seconds(row.before)};
  signs.errors += row.count;
  signs.has_lost_bits |= (row.code & 1U) != 0;
  signs.came_between |= (row.code & 2U) != 0;
  if (last < signs.last_error) return;
  signs.last_error = last;
  signs.first_after.reset();
  if (row.after > 0.0) signs.first_after = Instant{last + from_seconds(row.after)};
}

std::vector<Signs> gather(std::span<const Finding> findings) {
  std::vector<Signs> all;
  for (const Finding& finding : findings) {
    if (!is_sign(finding)) continue;
    const Instant last = finding.until.value_or(finding.at);
    if (all.empty() || finding.at - all.back().last > kOneTrouble) {
      if (all.size() >= kMost) return all;
      Signs& signs = all.emplace_back();
      signs.first = finding.at;
      signs.text = finding.text;
    }
    Signs& signs = all.back();
    signs.last = std::max(signs.last, last);
    if (finding.kind == FindingKind::kErrorState) signs.has_bus_off |= finding.code == 1;
    const bool is_destroyed = (finding.id & kDestroyed) != 0;
    if (finding.kind == FindingKind::kErrorFrames && is_destroyed) take_error_frames(signs, finding);
  }
  return all;
}

}  // namespace

std::vector<BusTrouble> find_bus_troubles(std::span<const Finding> findings, const config::Rig& rig) {
  const Nanos frame_time = kFrameBits * Nanos{1'000'000'000LL / rig.bus.bit_rate_bit_per_s};
  std::vector<BusTrouble> troubles;
  for (const Signs& signs : gather(findings)) {
    const Nanos silent = signs.first_after.value_or(Instant::never()) - signs.last_before;
    const bool is_dead = signs.errors > 0 && !signs.came_between &&
                         (signs.errors > kFew || silent > kSilentCycles * rig.bus.sync_period);
    BusTrouble trouble{BusTrouble::Kind::kNoise, signs.first, signs.last, signs.errors, 0, signs.text};
    if (is_dead) {
      trouble.kind = signs.has_lost_bits ? BusTrouble::Kind::kShortCircuit : BusTrouble::Kind::kStuckDominant;
      trouble.at = Instant{signs.last_before + (signs.first - signs.last_before) / 2};
      trouble.until.reset();
      // Whoever had tried between the last error and the first frame would have left one or the other.
      if (signs.first_after) {
        const Instant begins = std::max(Instant{*signs.first_after - frame_time}, signs.last_error);
        // A wire that is held dominant is not tried at all.
        const bool is_tried = trouble.kind == BusTrouble::Kind::kShortCircuit;
        trouble.until = is_tried ? Instant{signs.last_error + (begins - signs.last_error) / 2} : begins;
      }
    } else if (signs.errors == 0) {
      continue;  // The state of one node; its silence tells the rest.
    } else if (signs.errors <= kFew) {
      trouble.kind = BusTrouble::Kind::kCorrupted;
    }
    troubles.push_back(std::move(trouble));
  }
  for (const Finding& finding : findings) {
    if (!is_babble(finding) || troubles.size() >= 2 * kMost) continue;
    troubles.push_back({BusTrouble::Kind::kBabble, std::max(Instant{}, Instant{finding.at - frame_time}), finding.until,
                        finding.count, finding.id, finding.text});
  }
  std::ranges::stable_sort(troubles, {}, &BusTrouble::at);
  return troubles;
}

std::optional<Nanos> find_restart_delay(std::span<const Finding> findings) {
  constexpr std::uint16_t kBusOff = 1, kRestarted = 2;
  std::optional<Instant> off_at;
  for (const Finding& finding : findings) {
    if (finding.kind != FindingKind::kErrorState) continue;
    if (finding.code == kBusOff && !off_at) off_at = finding.at;
    if (finding.code == kRestarted && off_at) {
      return std::chrono::round<std::chrono::milliseconds>(finding.at - *off_at);
    }
  }
  return std::nullopt;
}

}  // namespace meltbench::decode
