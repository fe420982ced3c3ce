#pragma once
/// Makes the faults of a run happen: watches their triggers, acts on frames itself, and orders the rest.

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "bench/bus/intervention.hpp"
#include "bench/fault/faulty_port.hpp"
#include "bench/fault/twin.hpp"
#include "bench/fault/wire_faults.hpp"
#include "protocols/fault/fault.hpp"
#include "protocols/participant/participant.hpp"

namespace meltbench::fault {

/// Stands between the bus and the participants. Faults of boards, sensors, actuators and the plant go as orders to the
/// emulator; faults of a program and of its clock to that participant's FaultyPort.
///
/// On the ideal bus a frame whose bits are flipped fails its CRC in every receiver and is lost; there is no repetition.
/// On the bit-timed bus a bit of it is flipped on the wire: an error frame, and the sender repeats.
/// Devices with a node id that is taken are on the bus here; on the bit-timed bus they share one CAN controller.
/// Chance depends on the run's seed, the fault's seed, its place in the list and the number of the frame alone: equal
/// seeds give equal runs. Every begin and end is an event of the bench, "fault-on" and "fault-off".
/// Cost: a comparison per fault and frame; no allocation but at begin and end, and for frames that are held back.
class Injector final : public bus::Intervention {
 public:
  using Report = std::function<void(const Event&)>;

  struct Setup {
    std::uint64_t seed = 1;                          ///< Of the run.
    std::span<const SignalInfo> signals;             ///< Of all participants, as rows have them.
    std::span<const std::string_view> participants;  ///< By number.
    std::size_t emulator = 0;                        ///< Number of the participant that carries out orders.
    Report report;
    std::vector<std::string> emulator_lines{};  ///< Its serial lines, by its own numbers.
  };

  /// @throws config::ConfigError if a trigger names a signal that is not there.
  Injector(std::vector<Fault> faults, const Setup& setup);

  /// How a fault stands.
  struct Standing {
    std::string_view name;
    bool is_on = false;              ///< False: still to come.
    Instant due = Instant::never();  ///< Of its end, or its beginning, if that is known.
  };

  /// Adds a fault to a running bench, at an instant at which on_time() is still to be called. Without a trigger of its
  /// own it begins at `now`.
  /// @throws config::ConfigError as the constructor, and for an at_s that is over; nothing is added then.
  void add(Fault fault, Instant now);
  /// Ends all faults of this name that are on or still to come, at such an instant. @returns how many.
  std::size_t clear(std::string_view name, Instant now);
  /// All faults as they are to be written down, so that they happen again at the same instants: [[fault]].
  [[nodiscard]] config::Array write() const;
  /// Of those that are not over.
  [[nodiscard]] std::vector<Standing> standing() const;

  /// Of a participant, for its FaultyPort.
  [[nodiscard]] const ProgramCondition& condition_of(std::size_t participant) const { return programs_[participant]; }

  [[nodiscard]] Instant next_deadline() const override { return deadline_; }
  void on_time(Instant now, bus::RunControl& run) override;
  [[nodiscard]] bool on_frame(const can::StampedFrame& frame, std::size_t sender, bus::RunControl& run) override;
  void on_row(Instant at, std::span<const double> values) override;

 private:
  enum class Phase : std::uint8_t { kWaiting, kOn, kOver };

  struct Planned {
    Fault fault;
    std::uint64_t seed = 0;
    std::size_t signal = 0;  ///< Of its trigger.
    Phase phase = Phase::kWaiting;
    Instant due = Instant::never();  ///< Of its beginning, then of its end.
    std::uint64_t seen = 0;          ///< Frames that its trigger looked for,
    std::uint64_t matched = 0;       ///< that it could hit,
    std::uint64_t hits = 0;          ///< and has hit.
    bool on_wire = false;            ///< Bits are flipped by the bus, not frames taken here.
    std::unique_ptr<Twin> twin{};    ///< Of a node id that is there twice.
  };
  /// A frame that comes later than it was sent.
  struct Held {
    Instant due;
    std::size_t behind = 0;  ///< Comes as soon as so many others have passed; 0: only when due.
    std::size_t sender = 0;
    can::CanFrame frame;
  };

  void plan(Fault fault);
  void obey_clearing(Planned& planned, Instant now) const;
  void begin(std::size_t number, Instant now, bus::RunControl& run);
  void end(std::size_t number, Instant now, bus::RunControl& run);
  void begin_program(const Fault& fault, Instant now, bus::RunControl& run);
  void end_program(const Fault& fault, Instant now, bus::RunControl& run);
  [[nodiscard]] std::size_t find_participant(std::string_view name) const;
  [[nodiscard]] bool hits(Planned& planned, const can::CanFrame& frame) const;
  [[nodiscard]] bool apply(Planned& planned, const can::StampedFrame& frame, std::size_t sender);
  void pass_held(Instant now);
  [[nodiscard]] bool flip_on_wire(std::size_t number, Instant now, bus::RunControl& run) const;
  void release_held(Instant now, bus::RunControl& run);
  void tell_twins(const can::StampedFrame& frame, std::size_t sender, bus::RunControl& run);
  void run_twins(Instant now, bus::RunControl& run);
  void plug_twin(Planned& planned, bool in, Instant now, bus::RunControl& run);
  void send_for_twins(Instant now, bus::RunControl& run);
  void tell(Instant now, std::string_view code, const Planned& planned, std::string_view more) const;
  void update_deadline();

  std::uint64_t seed_;
  std::vector<SignalInfo> signals_;
  std::vector<std::string> participants_;
  std::size_t emulator_;
  Report report_;
  std::vector<Planned> faults_;
  std::vector<ProgramCondition> programs_;
  WireFaults wires_;
  canopen::Frames from_twins_;
  std::vector<Held> held_;  ///< In the order in which they were taken.
  Instant deadline_ = Instant::never();
};

}  // namespace meltbench::fault
