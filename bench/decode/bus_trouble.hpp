#pragma once
/// What error frames, and identifiers that never end, say of the wire.

#include <span>
#include <string>
#include <vector>

#include "bench/decode/story.hpp"

namespace meltbench::decode {

/// A stretch of a log in which the wire itself was ill.
struct BusTrouble {
  enum class Kind : std::uint8_t {
    kShortCircuit,   ///< Nobody comes through, and dominant bits come back as recessive.
    kStuckDominant,  ///< Nobody comes through, nobody can even begin.
    kCorrupted,      ///< A few frames were destroyed, the others came through.
    kNoise,          ///< Many were.
    kBabble,         ///< One identifier again and again.
  };
  Kind kind{};
  Instant at;  ///< Between the last frame that came through and the first sign.
  std::optional<Instant>
      until;  ///< Between the last sign and the first frame that came through. None: not before the end of the log.
  std::uint64_t count = 0;  ///< Error frames, or frames of the identifier.
  std::uint32_t id = 0;     ///< kBabble.
  std::string text;         ///< For people: of the first finding.
};

/// In the order of time. What boards and controller miss meanwhile is part of it.
[[nodiscard]] std::vector<BusTrouble> find_bus_troubles(std::span<const Finding> findings, const config::Rig& rig);

/// How long nodes stayed bus-off before they were restarted: the kernel's restart-ms, in whole milliseconds.
[[nodiscard]] std::optional<Nanos> find_restart_delay(std::span<const Finding> findings);

}  // namespace meltbench::decode
