#pragma once
/// Writes a run's folder while the run goes, and keeps the same in memory for the checks.

#include <filesystem>
#include <memory>
#include <span>
#include <string_view>
#include <vector>

#include "bench/record/recording.hpp"

namespace meltbench::record {

/// Records one run.
///
/// Files, all UTF-8 text, none of which holds anything that differs between two equal runs in virtual time:
///   bus.log       candump -l: "(0000000012.340000) bench 185#11223344", and nothing else: a comment line would keep
///                 python-can and Wireshark from reading it; what was run is in events.jsonl. What a program
///                 outside the run has sent has the device "tap" instead of "bench"
///   signals.csv   "t_s,<names>"; time with nine decimals (whole nanoseconds), values as shortest exact decimals
///   serial.log    only if the rig has serial lines: "(0000000012.340000) line sender 0103000000C5DA", one gap-free
///                 piece of bytes a line, stamped when its last byte was there
///   events.jsonl  one object a line: {"type":"run",...} first, {"type":"event",...}, and {"type":"end",...} last
/// Each write(2) ends at the end of a line and takes up to 64 KiB: what a killed bench loses is the block in memory,
/// never half a line. Events are written at once.
///
/// The loop's calls do not throw for a full disk: the files stop, the memory goes on, and finish() adds a fault event
/// "recording-failed", which the health gate sees.
/// Cost on one core of a small VM: 1.0 us per row of 25 values of which 15 move, 60 ns per frame
/// (record_benchmark.cpp).
class RunRecorder {
 public:
  /// @param folder  created if missing; an older run's files in it are replaced. Empty: keep in memory only.
  /// @throws std::system_error naming the path if the folder or a file cannot be made.
  /// @throws std::invalid_argument for a signal name that is empty, doubled, or holds a comma, a quote or a line end.
  RunRecorder(RunInfo info, std::vector<SignalInfo> signals, const std::filesystem::path& folder = {});
  ~RunRecorder();
  RunRecorder(const RunRecorder&) = delete;
  RunRecorder& operator=(const RunRecorder&) = delete;

  /// @param sender  number of the participant that sent it; kTapSender or kUnknownSender for a stranger.
  void frame(const can::StampedFrame& stamped, std::uint8_t sender);

  /// Bytes that came over a serial line without a gap. They are in the file only, not in the recording.
  /// @param line  name of the line.  @param sender  name of the participant.  @param at  when the last one was there.
  void serial(std::string_view line, std::string_view sender, Instant at, std::span<const std::uint8_t> bytes);

  /// @pre values.size() == number of signals; at not before the previous row.
  void row(Instant at, std::span<const double> values);

  /// @param source  name of the participant, or "bench".
  void event(std::string_view source, const Event& event);

  /// What a bit-timed bus has counted in the whole run; before finish().
  void bus_timing(BusTiming timing) { recording_.bus_timing = std::move(timing); }

  /// Hands everything recorded so far to the kernel. For wall-clock paces: call it about once per second.
  void flush();

  /// What is recorded so far. Its `ending` is not yet known.
  [[nodiscard]] const Recording& recording() const;

  /// Ends the run: writes the end record, closes the files, gives the recording away. Call once, last.
  [[nodiscard]] Recording finish(Ending ending);

 private:
  struct Files;
  Recording recording_;
  std::unique_ptr<Files> files_;  ///< Null: memory only.
};

}  // namespace meltbench::record
