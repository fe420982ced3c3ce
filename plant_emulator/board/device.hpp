#pragma once
/// What all field devices have in common, whatever wire they hang on: a process behind them, and what is recorded.

#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "plant_emulator/board/process.hpp"
#include "protocols/participant/participant.hpp"
#include "protocols/time/instant.hpp"

namespace meltbench::board {

/// The side of a field device that faces the process.
///
/// next_touch() says when the device samples or moves something; the emulator advances the process to exactly that
/// instant and calls touch(). Nobody on the wire sees that instant, so it needs no wake-up: touches are caught up on
/// when something is due or arrives. Instants never go back.
class Device {
 public:
  /// @param process  must outlive the device.
  Device(std::string name, Process& process) : name_{std::move(name)}, process_{process} {}
  Device(const Device&) = delete;
  Device& operator=(const Device&) = delete;
  virtual ~Device() = default;

  [[nodiscard]] const std::string& name() const { return name_; }

  /// The next instant at or before `until` at which touch() must be called, else Instant::never().
  [[nodiscard]] virtual Instant next_touch(Instant until) const = 0;
  /// Samples or moves. @pre the process is at `at` = next_touch(...).
  virtual void touch(Instant at) = 0;
  /// Called at the end of a wake-up, when nothing is left to touch: sums up to `now` for read_signals().
  virtual void settle(Instant /*now*/) {}

  /// For the recording: names without the device's own, e.g. "set_point_kg_per_h".
  [[nodiscard]] virtual std::span<const std::string_view> signal_names() const = 0;
  /// As of the last settle(), in the order of signal_names().
  virtual void read_signals(std::span<double> values) const = 0;

  /// What has happened since the last call and is worth a line in the recording.
  [[nodiscard]] bool has_events() const { return !events_.empty(); }
  [[nodiscard]] std::vector<Event> take_events() { return std::exchange(events_, {}); }

 protected:
  /// The text is preceded by the device's name.
  void report(Severity severity, Instant at, std::string code, std::string_view text);
  [[nodiscard]] Process& process() { return process_; }
  [[nodiscard]] const Process& process() const { return process_; }

 private:
  std::string name_;
  Process& process_;
  std::vector<Event> events_;
};

}  // namespace meltbench::board
