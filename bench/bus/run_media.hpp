#pragma once

#include <optional>
#include <span>
#include <vector>

#include "bench/bus/bit_timed_medium.hpp"
#include "bench/bus/intervention.hpp"
#include "bench/bus/outside.hpp"
#include "protocols/config/rig.hpp"
#include "protocols/link/can_link.hpp"

namespace meltbench::bus {

/// What joins the participants of a run, and who else is there.
struct RunMedia {
  /// Every serial line that a participant speaks on; participants that name the same line share it.
  std::span<const config::RigLine> lines{};
  /// Who else is on the embedded bus; outlives the run; null: nobody. What they send makes the run depend on the wall
  /// clock: in virtual time it enters at the next instant at which somebody is due.
  Outside* outside = nullptr;
  /// A bus behind an adapter that is to be one with the embedded bus; outlives the run; null: none. At wall-clock pace
  /// only.
  link::CanLink* adapter = nullptr;
  /// Stands between the bus and the participants; outlives the run. Null: nobody does. On a kernel's bus it sees the
  /// frames, but cannot hold them up.
  Intervention* intervention = nullptr;
  /// The embedded CAN bus in bit times; nothing: the ideal bus. A bus of a kernel or behind an adapter has its own.
  std::optional<BitTimedSettings> bit_timed{};
  /// Of its nodes' clocks; a node that is not here is right.
  std::vector<ClockDrift> clock_drifts{};
};

/// The lines and the CAN bus that a rig describes, and nobody else on them. @param rig  outlives the run.
[[nodiscard]] RunMedia make_media(const config::Rig& rig);

}  // namespace meltbench::bus
