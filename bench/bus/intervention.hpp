#pragma once
/// The seam at which somebody may stand between the bus and the participants of a run.

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <string_view>

#include "protocols/can/frame.hpp"
#include "protocols/time/instant.hpp"

namespace meltbench::bus {

class BitTimedMedium;
class SerialLine;

/// What an intervention can do to a run.
class RunControl {
 public:
  virtual ~RunControl() = default;
  /// The frame reaches everybody but its sender now, and is recorded.
  virtual void deliver(const can::CanFrame& frame, std::size_t sender) = 0;
  /// Asks something of a participant, a TOML text: it is woken for it at once.
  virtual void post_order(std::size_t participant, std::string order) = 0;
  /// Pulls a participant's plug out of one of its serial lines, or puts it in again.
  virtual void plug_line(std::size_t participant, std::uint8_t own_line, bool in) = 0;
  /// A serial line of the run, to give it a fault; null if there is none of that name.
  [[nodiscard]] virtual SerialLine* find_line(std::string_view name) = 0;
  /// The bit-timed bus, to give it faults; null on the ideal bus.
  [[nodiscard]] virtual BitTimedMedium* medium() = 0;
};

/// Sees every frame after it has crossed the bus and before anybody gets it, and every recorded row.
class Intervention {
 public:
  virtual ~Intervention() = default;

  /// At a new instant, before anything else: looks whether somebody wants something of it from now on.
  /// @returns whether on_time() may have become due.
  virtual bool look(Instant /*now*/) { return false; }
  /// When on_time() must be called next; before anything else that is due then.
  [[nodiscard]] virtual Instant next_deadline() const = 0;
  /// Does what is due; next_deadline() is later than `now` afterwards.
  virtual void on_time(Instant now, RunControl& run) = 0;
  /// @returns false if nobody gets the frame now; whoever takes it may deliver() it later.
  [[nodiscard]] virtual bool on_frame(const can::StampedFrame& frame, std::size_t sender, RunControl& run) = 0;
  /// Values as RunObserver::on_row() gets them.
  virtual void on_row(Instant at, std::span<const double> values) = 0;
};

}  // namespace meltbench::bus
