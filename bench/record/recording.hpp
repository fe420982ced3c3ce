#pragma once
/// What a run left behind: signals, frames, events and how it ended, in memory, ready to be judged and plotted.

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "bench/record/bus_timing.hpp"
#include "protocols/can/frame.hpp"
#include "protocols/participant/participant.hpp"
#include "protocols/time/instant.hpp"
#include "protocols/time/log_histogram.hpp"

namespace meltbench::record {

/// The sender of a frame that came from outside the bench, or from a log (candump text does not name senders).
inline constexpr std::uint8_t kUnknownSender = 0xFF;
/// The sender of a frame that a program outside the run has put on the embedded bus. bus.log has it under the device
/// kTapDevice, all others under kBenchDevice.
inline constexpr std::uint8_t kTapSender = 0xFE;
inline constexpr std::string_view kBenchDevice = "bench";
inline constexpr std::string_view kTapDevice = "tap";

/// A CANopen node of this run, so that a report can say "feeder" where the wire says 5.
struct NodeName {
  std::uint8_t node_id = 0;  ///< 1..127.
  std::string name;
};

/// What was run. Everything that a reader needs to run it again; nothing that differs between two equal runs.
struct RunInfo {
  std::string scenario;  ///< Short name, "delay_compensation".
  std::string variant;   ///< Empty if the scenario has none.
  std::string title;     ///< For people; ends with that of the variant, if it has one.
  std::string text;      ///< For people: what the scenario shows. May be empty.
  std::uint64_t seed = 0;
  Nanos duration{};                       ///< As asked for; Ending::at says how far it came.
  std::string pace = "lockstep";          ///< "lockstep", "in-process", "realtime" or "realtime:F".
  std::vector<std::string> unseen;        ///< Parts that the bench only knows by their frames: "plant", "feeder" where
                                          ///< boards are real, "controller" if it is external. First words of names.
  std::vector<std::string> participants;  ///< Position = participant number = sender of a frame.
  std::vector<NodeName> nodes;
  bool has_serial_lines = false;                    ///< The rig has some: what goes over them is recorded.
  std::optional<std::uint32_t> bit_rate_bit_per_s;  ///< Of the bus, if it has one; makes bus load known.
  std::string version;                              ///< "meltbench 0.1.0".
  std::string repeat_command;                       ///< Shell command that repeats the run.

  /// True for a signal or an event source of a part that the bench cannot look into: missing by nature, not by mistake.
  [[nodiscard]] bool is_unseen(std::string_view name) const;
  /// True for the paces whose time has nothing to do with the wall clock, so that equal seeds give equal bytes.
  [[nodiscard]] bool in_virtual_time() const { return !pace.starts_with("realtime"); }
  /// "scenario" or "scenario.variant".
  [[nodiscard]] std::string label() const { return variant.empty() ? scenario : scenario + "." + variant; }
};

/// Why a run is over.
enum class EndReason : std::uint8_t {
  kCompleted,        ///< Ran for its whole duration.
  kInterrupted,      ///< By the user.
  kParticipantLost,  ///< A process or a link died or hung; Ending::text names it.
  kCutShort,         ///< The bench itself was killed: the recording has no end record.
};
[[nodiscard]] std::string_view to_text(EndReason reason);

/// How late the wake-ups of a participant were: at its deadlines, at wall-clock pace.
struct WakeupTiming {
  std::string participant;
  LogHistogram lateness;
};

/// How a run ended, as the runner saw it.
struct Ending {
  EndReason reason = EndReason::kCompleted;
  std::string text;                        ///< For people: which participant was lost and how. Empty if completed.
  Instant at;                              ///< Last instant of the run.
  std::uint64_t lost_frames = 0;           ///< Sent or received, but dropped by a full queue or a link that was down.
  std::optional<double> real_time_factor;  ///< Only for wall-clock paces: a virtual run must give the same bytes again.
  std::vector<WakeupTiming> wakeups;       ///< Likewise.
};

struct RecordedFrame {
  Instant at;  ///< Whole microseconds, see FrameLog.
  std::uint8_t sender = kUnknownSender;
  can::CanFrame frame;
};

/// Frames in the order of the wire, 24 bytes each (FD payloads apart).
///
/// Stamps are cut to whole microseconds, because that is what a candump log holds: a run judged at once and a run
/// judged again from its folder then give the same result to the last bit.
class FrameLog {
 public:
  void push_back(Instant at, const can::CanFrame& frame, std::uint8_t sender);
  [[nodiscard]] std::size_t size() const { return frames_.size(); }
  [[nodiscard]] bool empty() const { return frames_.empty(); }
  [[nodiscard]] RecordedFrame operator[](std::size_t index) const;

  /// Cheap looks at one frame, for scans over all of them.
  [[nodiscard]] Instant at(std::size_t index) const { return frames_[index].at; }
  [[nodiscard]] std::uint32_t id(std::size_t index) const { return frames_[index].id; }
  [[nodiscard]] bool is_error(std::size_t index) const;
  /// True for a data frame with this 11-bit identifier.
  [[nodiscard]] bool is_standard_data(std::size_t index, std::uint32_t cob_id) const;

 private:
  struct Packed {
    Instant at;
    std::uint32_t id = 0;
    std::uint8_t flags = 0;
    std::uint8_t length = 0;
    std::uint8_t raw_dlc = 0;
    std::uint8_t sender = kUnknownSender;
    std::array<std::uint8_t, can::kMaxClassicLength> data{};  ///< Longer FD data: its index in long_data_.
  };
  std::vector<Packed> frames_;
  std::vector<std::array<std::uint8_t, can::kMaxFdLength>> long_data_;
};

/// An event and the participant that reported it ("controller"), or "bench".
struct RecordedEvent {
  std::string source;
  Event event;
};

/// One run, whole. Rows are kept flat: value(row, column) of signal `column` at row_times[row].
struct Recording {
  RunInfo info;
  std::vector<SignalInfo> signals;
  std::vector<Instant> row_times;  ///< Not decreasing.
  std::vector<double> values;      ///< row_times.size() x signals.size(), row by row. NaN = no value.
  FrameLog frames;
  std::vector<RecordedEvent> events;
  Ending ending;
  std::optional<BusTiming> bus_timing;  ///< Of a bit-timed bus.
  std::vector<std::string> notes;       ///< What load_recording() had to drop or to guess.

  [[nodiscard]] std::size_t row_count() const { return row_times.size(); }
  [[nodiscard]] double value(std::size_t row, std::size_t column) const {
    return values[row * signals.size() + column];
  }
  /// Column of a signal by its full name.
  [[nodiscard]] std::optional<std::size_t> find_signal(std::string_view name) const;
};

/// SI unit at the end of a signal's name, for people: "plant.flow_kg_per_s" -> "kg/s", "plant.U" -> "".
[[nodiscard]] std::string unit_of_signal(std::string_view name);

}  // namespace meltbench::record
