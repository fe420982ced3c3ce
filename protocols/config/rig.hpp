#pragma once
/// The part of a rig that everyone on the bus reads: bus settings, boards, events of the timeline.
///
/// One TOML text describes a whole run. Who reads what:
///   [rig] [bus] [line.NAME]       all (here)
///   [board.NAME]                  kind, part, node_id, eds, heartbeat_ms, clock_drift_ppm, line, unit here;
///                                 the rest by the emulator
///   [plant]                       the emulator
///   [controller]                  node_id, external, clock_drift_ppm here; the rest by the controller
///   [scenario] [[check]] [health] the bench
///   [[event]]                     at_s, target, action here; the rest by the target
/// A program opens the sections that are its own, and then calls finish() on the root: its own sections are checked key
/// by key, those of others are left alone, and a top-level name that belongs to nobody is an error.

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "protocols/config/section.hpp"
#include "protocols/serial/line_settings.hpp"
#include "protocols/time/instant.hpp"

namespace meltbench::config {

enum class BoardKind : std::uint8_t { kFeeder, kScrewDrive, kMeltPressure, kHeater, kPreconditioner, kMeltCamera };
inline constexpr std::size_t kBoardKinds = 6;

/// "feeder", "screw_drive", "melt_pressure", "heater", "preconditioner", "melt_camera".
[[nodiscard]] std::string_view name_of(BoardKind kind);

/// How true the embedded bus is. A kernel's bus is what it is.
enum class BusFidelity : std::uint8_t {
  kIdeal,     ///< Frames cross at once.
  kBitTimed,  ///< Frames take their bits, with arbitration, queues and errors.
};
/// In which order a node offers its frames: by identifier, as mailboxes do, or as they were queued.
enum class RigTxOrder : std::uint8_t { kPriority, kFifo };

struct RigBus {
  std::uint32_t bit_rate_bit_per_s =
      500'000;                    ///< bit_rate_kbit_per_s: one of CiA 301's 10, 20, 50, 125, 250, 500, 800, 1000.
  Nanos sync_period{10'000'000};  ///< sync_period_ms: 0.1..10000, default 10.
  BusFidelity fidelity = BusFidelity::kIdeal;  ///< fidelity: "ideal" (default) or "bit-timed"; the rest is for that.
  /// data_bit_rate_kbit_per_s: of FD frames with bit rate switch, one of 500, 1000, 2000, 4000, 5000, 8000 and not
  /// below the bit rate; default: the bit rate.
  std::uint32_t data_bit_rate_bit_per_s = 500'000;
  std::size_t tx_queue = 10;                    ///< tx_queue: frames that a node can hold, 1..1000, default 10.
  RigTxOrder tx_order = RigTxOrder::kPriority;  ///< tx_order: "priority" (default) or "fifo".
  std::optional<Nanos> restart_after{};         ///< restart_ms: 0..60000; without it bus-off lasts.
};

/// A serial line between the controller and boards, [line.NAME].
struct RigLine {
  std::string name;               ///< NAME: lower-case letters, digits and _.
  serial::LineSettings settings;  ///< baud_rate: one of the usual, 1200..115200, default 19200; format: default 8E1.
};

/// A board is on the CAN bus (it has a node_id), or on a serial line, where it speaks Modbus RTU (it has a line).
struct RigBoard {
  std::string name;  ///< NAME of [board.NAME]: lower-case letters, digits and _.
  BoardKind kind = BoardKind::kFeeder;
  std::uint8_t node_id = 0;     ///< CAN: 1..127, once on the bus. Else 0.
  std::filesystem::path eds{};  ///< CAN: exists. Relative to the file that says it. Else empty.
  Nanos heartbeat{};           ///< CAN: heartbeat_ms, the heartbeat that the manager asks of it, 1..65535, default 100.
  double clock_drift_ppm = 0;  ///< CAN: how much too fast its CAN controller's clock is, -5000..5000; bit-timed bus.
  bool is_real = false;        ///< part = "real": a device of its own; "emulated" (the default): ours.
  std::string line{};          ///< Serial: name of one of the rig's lines. Else empty.
  std::uint8_t unit = 0;       ///< Serial: Modbus address 1..247, once on the line. Else 0.
  Section section;             ///< For the emulator's own keys; its finish() counts the keys read here as known.

  [[nodiscard]] bool is_on_line() const { return !line.empty(); }
};

struct Rig {
  std::string name;   ///< Letters, digits, '_', '-', '.'.
  std::string title;  ///< One line for people; the name if not given.
  RigBus bus;
  std::uint8_t controller_node_id = 127;  ///< controller.node_id: 1..127, default 127.
  double controller_clock_drift_ppm = 0;  ///< controller.clock_drift_ppm: as that of a board.
  bool controller_is_external = false;    ///< controller.external: the bench does not start it; default false.
  std::vector<RigBoard> boards;           ///< In the order of the file; at least one.
  std::vector<RigLine> lines;             ///< In the order of the file.

  /// Whether a board is not ours: the model then does not know what the machine does.
  [[nodiscard]] bool has_real_board() const;
  /// Whether there is anything to emulate.
  [[nodiscard]] bool has_emulated_board() const;
};

/// Reads the common part, and marks the top-level names that others read.
/// @throws ConfigError: a node id twice or out of 1..127, an EDS file that is not there, a line that is not there, a
/// unit twice on a line or out of 1..247, no board.
[[nodiscard]] Rig read_rig(const Section& root);

/// One [[event]] of the timeline. Its target reads the rest from `section` and calls section.finish().
struct TimelineEvent {
  Instant at;
  std::string target;  ///< "controller", "plant", "bus", or "board.NAME".
  std::string action;  ///< E.g. "set_point".
  Section section;
};

/// Events of one target ("controller"), or of all if `target` is empty, in the order of time; equal times keep their
/// order.
/// @throws ConfigError for a target that the rig does not have.
[[nodiscard]] std::vector<TimelineEvent> read_events(const Section& root, const Rig& rig, std::string_view target = {});

/// @throws ConfigError unless the text is a name that can be a folder: letters, digits, '_', '-', '.', not first '.' or
/// '-'.
[[nodiscard]] std::string read_name(const Section& section, std::string_view key);

}  // namespace meltbench::config
