#pragma once
/// What all field boards have in common: a CANopen node in front, the process behind, firmware in between.

#include <algorithm>
#include <cstddef>
#include <limits>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "plant_emulator/model/inlet_flux.hpp"
#include "plant_emulator/model/melt_inlet.hpp"
#include "protocols/canopen/node.hpp"
#include "protocols/participant/participant.hpp"
#include "protocols/time/instant.hpp"

namespace meltbench::board {

/// What the boards measure and drive, at the instant to which it has been advanced.
///
/// Not every plant has everything: one that does not melt says kNothing (not a number) for what it has not, and takes
/// no notice of what would drive it. A broken thermocouple reads kNothing too.
class Process {
 public:
  static constexpr double kNothing = std::numeric_limits<double>::quiet_NaN();

  virtual ~Process() = default;
  [[nodiscard]] virtual double pressure_Pa() const = 0;          ///< Over the nozzle.
  [[nodiscard]] virtual double encoder_rev() const = 0;          ///< Turns of the screw since the start.
  [[nodiscard]] virtual double encoder_rev_per_s() const = 0;    ///< Its rate.
  virtual void set_feed_kg_per_s(double feed_kg_per_s) = 0;      ///< Held until set again.
  virtual void set_screw_rev_per_s(double screw_rev_per_s) = 0;  ///< Held until set again.

  // Not const: a plant may solve for its temperature field only when it is asked.
  [[nodiscard]] virtual double front_m() { return kNothing; }               ///< Melting front, from the inlet.
  [[nodiscard]] virtual double T_inlet_degC() { return kNothing; }          ///< Surface of the granules at the inlet.
  [[nodiscard]] virtual double T_melt_degC() { return kNothing; }           ///< Melt at the nozzle.
  virtual void set_inlet(const plant::MeltInlet& /*inlet*/) {}              ///< Held until set again.
  [[nodiscard]] virtual plant::InletFlux inlet_flux() const { return {}; }  ///< Up to now.
  /// Thermocouple of a heated zone; channels 0..3 are the barrel from the feed throat on, 4 is the nozzle.
  [[nodiscard]] virtual double T_zone_degC(std::size_t /*channel*/) const { return kNothing; }
  /// Share of its full power that a heater band gets, 0..1; held until set again.
  virtual void set_heater(std::size_t /*channel*/, double /*share*/) {}
};

/// Bits of object 6150 of an analogue input, CiA 404.
enum InputStatus : std::uint8_t {
  kNotValid = 0x01,          ///< Nothing measured, or out of span.
  kPositiveOverload = 0x02,  ///< Above the span; the value is cut to it.
  kNegativeOverload = 0x04,  ///< Below the span; the value is cut to it.
};

/// A value that the rig gives to an object in place of the EDS's default.
struct DefaultValue {
  canopen::ObjectAddress address;
  std::vector<std::uint8_t> bytes;
};

template <class T>
[[nodiscard]] DefaultValue make_default(std::uint16_t index, std::uint8_t sub, T value) {
  return {{index, sub}, canopen::to_bytes(value)};
}

/// Copy of a dictionary in which these objects have other defaults, so that a reset comes back to what the rig says.
/// @throws std::out_of_range naming the object if there is no such one, std::invalid_argument if the size is wrong.
[[nodiscard]] canopen::ObjectDictionary with_defaults(const canopen::ObjectDictionary& dictionary,
                                                      const std::vector<DefaultValue>& defaults);

/// A field board. It has two sides that the emulator serves:
///
/// The *bus*: start(), on_frame(), on_time(), next_deadline(), as a CANopen node. SDO is answered in the same instant.
///
/// The *process*: next_touch() says when the board samples or moves something; the emulator advances the process to
/// exactly that instant and calls touch(). Nobody on the bus sees that instant, so it needs no wake-up: touches are
/// caught up on when something is due or arrives. Values for the bus are put into the dictionary when they are asked
/// for (SYNC, TPDO, SDO read), as of that instant.
///
/// What is possible in which NMT state, the board and its drive being powered in all of them:
/// - Pre-operational: everything can be read and commanded by SDO
/// - Operational: and by PDO
/// - Stopped: only the heartbeat can be read, nothing commanded; the feeder's watchdog then acts
///
/// Real time: no allocation in the steady state. Instants never go back.
class Board : protected canopen::NodeListener {
 public:
  /// @param process  must outlive the board.
  Board(std::string name, canopen::ObjectDictionary dictionary, std::uint8_t node_id, Process& process);
  Board(const Board&) = delete;
  Board& operator=(const Board&) = delete;
  ~Board() override = default;

  [[nodiscard]] const std::string& name() const { return name_; }

  // --- the bus. @pre the process and all touches are at `now`.
  void start(Instant now, canopen::Frames& out) { node_.start(now, out); }
  void on_frame(Instant now, const can::CanFrame& frame, canopen::Frames& out) { node_.on_frame(now, frame, out); }
  void on_time(Instant now, canopen::Frames& out) {
    run_timers(now);
    node_.on_time(now, out);
  }
  [[nodiscard]] Instant next_deadline() const { return std::min(node_.next_deadline(), own_deadline_); }

  // --- the process
  /// The next instant at or before `until` at which touch() must be called, else Instant::never().
  [[nodiscard]] virtual Instant next_touch(Instant until) const = 0;
  /// Samples or moves. @pre the process is at `at` = next_touch(...).
  virtual void touch(Instant at) = 0;
  /// Called at the end of a wake-up, when nothing is left to touch: sums up to `now` for read_signals().
  virtual void settle(Instant /*now*/) {}

  // --- for the recording
  /// Names without the board's own, e.g. "set_point_kg_per_h".
  [[nodiscard]] virtual std::span<const std::string_view> signal_names() const = 0;
  /// As of the last settle(), in the order of signal_names().
  virtual void read_signals(std::span<double> values) const = 0;

  /// What has happened since the last call and is worth a line in the recording.
  [[nodiscard]] bool has_events() const { return !events_.empty(); }
  [[nodiscard]] std::vector<Event> take_events() { return std::exchange(events_, {}); }

  [[nodiscard]] canopen::Node& node() { return node_; }
  [[nodiscard]] const canopen::Node& node() const { return node_; }

 protected:
  /// Does what is due at `now` and sets own_deadline_ anew.
  virtual void run_timers(Instant now) = 0;
  /// Puts what is known at `now` into the dictionary.
  virtual void refresh(Instant now) = 0;

  void report(Severity severity, Instant at, std::string code, std::string text);
  [[nodiscard]] canopen::ObjectDictionary& dictionary() { return node_.dictionary(); }
  [[nodiscard]] Process& process() { return process_; }
  [[nodiscard]] const Process& process() const { return process_; }

  /// What refresh() has written is no longer true although no time has passed.
  void invalidate() { refreshed_at_ = kNotRefreshed; }
  /// True if RPDO `number` carries this object as it is mapped now. Costs a search: for set-up, not for the loop.
  [[nodiscard]] bool carries(unsigned rpdo_number, canopen::ObjectAddress address) const;

  void on_sync(Instant now, std::uint8_t /*counter*/) override { refresh_once(now); }
  void before_tpdo(Instant now, unsigned /*number*/) override { refresh_once(now); }
  canopen::AbortCode on_read(Instant now, canopen::OdEntry& entry) override;
  void on_state(Instant now, canopen::NmtState from, canopen::NmtState to) override;

  Instant own_deadline_ = Instant::never();  // Of run_timers().

 private:
  void refresh_once(Instant now);

  static constexpr Instant kNotRefreshed{Nanos{-1}};
  Instant refreshed_at_ = kNotRefreshed;
  std::string name_;
  Process& process_;
  std::vector<Event> events_;
  canopen::Node node_;
};

/// Nearest multiple of `step`; 0 leaves the value as it is.
[[nodiscard]] double quantise(double value, double step);

/// A span as a count of `unit`, rounded, held within 0..0xFFFF: ages on the wire.
[[nodiscard]] std::uint16_t to_age(Nanos age, Nanos unit);

}  // namespace meltbench::board
