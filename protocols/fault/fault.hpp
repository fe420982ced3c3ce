#pragma once
/// One fault of a run: what fails, how, when and for how long. [[fault]] of a scenario, or given to a running bench.

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "protocols/can/frame.hpp"
#include "protocols/config/rig.hpp"
#include "protocols/config/section.hpp"
#include "protocols/fault/vocabulary.hpp"
#include "protocols/time/instant.hpp"

namespace meltbench::fault {

/// Which frames: those whose identifier agrees with `id` in the bits of `mask`.
struct FrameMatch {
  std::uint32_t id = 0;
  std::uint32_t mask = 0;  ///< 0: every identifier.
  bool extended = false;   ///< 29-bit identifiers; else 11-bit ones.
  [[nodiscard]] bool matches(const can::CanFrame& frame) const {
    return frame.kind != can::FrameKind::kError && frame.extended == extended && ((frame.id ^ id) & mask) == 0;
  }
};

/// When a fault begins.
struct Trigger {
  enum class On : std::uint8_t { kTime, kFrame, kSignal };
  On on = On::kTime;
  Instant at;             ///< kTime.
  FrameMatch frame;       ///< kFrame: with the nth one that matches, itself included.
  std::uint64_t nth = 1;  ///< From 1.
  std::string signal;     ///< kSignal: in the row in which it becomes true.
  std::optional<double> above;
  std::optional<double> below;
  Instant armed_at;  ///< kFrame, kSignal: nothing before counts.
};

struct Fault {
  std::string name;  ///< For messages and `clear`; by default "target kind".
  Target target{};
  std::string object;  ///< What stands behind the dot: NAME of a board, "melt_pressure"; may be empty.
  const KindInfo* info = nullptr;
  std::vector<double> values;  ///< Of info->parameters, in their order and unit.
  Trigger trigger;
  std::optional<Nanos> duration;      ///< None: until it is cleared, or to the end of the run.
  std::optional<Instant> cleared_at;  ///< Ends then at the latest, or does not begin any more.
  std::uint64_t seed = 1;

  // target = "frame" only
  FrameMatch frames;
  double probability = 1.0;            ///< That it hits a frame that matches.
  std::optional<std::uint64_t> count;  ///< It ends after so many hits.

  // kind = "same_node_id" only: of the board
  std::uint8_t node_id = 0;
  Nanos heartbeat{};
  std::filesystem::path eds;

  config::Table table;  ///< As it was written, for repro.toml and for whoever carries it out.

  [[nodiscard]] Kind kind() const { return info->kind; }
  /// @pre `name` is a parameter of this kind.
  [[nodiscard]] double value(std::string_view parameter) const;
};

/// The machine that faults are for.
struct Scope {
  const config::Rig& rig;
  std::string plant_kind;  ///< [plant] kind: "bizone", "melt" or "coupled".
};

/// Reads the scope of a run.
[[nodiscard]] Scope make_scope(const config::Section& root, const config::Rig& rig);

/// Everything that can fail: "frame", "board.feeder", "sensor.melt_pressure" ...
[[nodiscard]] std::vector<std::string> list_targets(const Scope& scope);
/// How it can. @param target  one of list_targets().
[[nodiscard]] std::vector<const KindInfo*> list_kinds(std::string_view target, const Scope& scope);
/// The quantity behind a target; null for a board, a frame, the plant and a clock.
[[nodiscard]] const ObjectInfo* object_of(std::string_view target);

/// Keys of [[fault]]; key, range, (default), what:
/// - target       one of list_targets(): fixtures/scenarios/FAULTS.md
/// - kind         what this target can do: fixtures/scenarios/FAULTS.md; anything else is refused with the list
/// - the parameters of the kind
/// - at_s         >= 0                  begins then; or
/// - at_frame     { id, mask (all bits), extended (false), n (1) }   with the nth such frame; or
/// - when         { signal, above and/or below }   when that becomes true, looked at once per recorded row
/// - armed_at_s   >= 0 (0)              with at_frame or when: what was before does not count
/// - for_s        > 0 (to the end)      how long
/// - cleared_at_s >= 0 (never)          ends then at the latest, or does not begin any more
/// - name         ("target kind")       for messages
/// - seed         >= 0 (1)              of its chance, together with the run's seed
/// target = "frame": id (any), mask (all bits), extended (false), probability 0..1 (1), count >= 1 (no end)
///
/// @returns all faults of a run, in the order of the file.
/// @throws config::ConfigError: also for what the target cannot do.
[[nodiscard]] std::vector<Fault> read_faults(const config::Section& root, const Scope& scope);

/// One fault that is given to a running bench: the same keys, in one line with commas between them or in several, and
/// it may come without a trigger: it then begins at once.
/// @throws config::ConfigError as read_faults(), and for a text that is no TOML.
[[nodiscard]] Fault read_live_fault(std::string_view text, const Scope& scope);

/// What the bench tells who carries a fault out: TOML text, the same for a scripted and a live fault.
[[nodiscard]] std::string write_order(std::size_t number, bool begins, const Fault& fault);

struct FaultOrder {
  std::size_t number = 0;  ///< The same when it ends.
  bool begins = false;
  Fault fault;
};
/// @returns nothing if the text is no such order.
[[nodiscard]] std::optional<FaultOrder> read_order(std::string_view text);

}  // namespace meltbench::fault
