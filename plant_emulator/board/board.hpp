#pragma once
/// What all field boards have in common: a CANopen node in front, the process behind, firmware in between.

#include <algorithm>
#include <cstddef>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "plant_emulator/board/device.hpp"
#include "plant_emulator/board/quantise.hpp"
#include "protocols/canopen/node.hpp"
#include "protocols/participant/participant.hpp"
#include "protocols/time/instant.hpp"

namespace meltbench::board {

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

/// A field board on CAN. It has two sides that the emulator serves: the process (Device), and the *bus*: start(),
/// on_frame(), on_time(), next_deadline(), as a CANopen node. SDO is answered in the same instant. Values for the bus
/// are put into the dictionary when they are asked for (SYNC, TPDO, SDO read), as of that instant.
///
/// What is possible in which NMT state, the board and its drive being powered in all of them:
/// - Pre-operational: everything can be read and commanded by SDO
/// - Operational: and by PDO
/// - Stopped: only the heartbeat can be read, nothing commanded; the feeder's watchdog then acts
///
/// Real time: no allocation in the steady state.
class Board : public Device, protected canopen::NodeListener {
 public:
  Board(std::string name, canopen::ObjectDictionary dictionary, std::uint8_t node_id, Process& process);

  // @pre the process and all touches are at `now`.
  void start(Instant now, canopen::Frames& out) { node_.start(now, out); }
  void on_frame(Instant now, const can::CanFrame& frame, canopen::Frames& out) { node_.on_frame(now, frame, out); }
  void on_time(Instant now, canopen::Frames& out) {
    if (!hangs_) run_timers(now);
    node_.on_time(now, out);
  }
  [[nodiscard]] Instant next_deadline() const {
    return hangs_ ? node_.next_deadline() : std::min(node_.next_deadline(), own_deadline_);
  }
  /// The firmware does nothing any more, its timers included; what it has put into the dictionary stays.
  void hang(bool on) { hangs_ = on; }

  [[nodiscard]] canopen::Node& node() { return node_; }
  [[nodiscard]] const canopen::Node& node() const { return node_; }

 protected:
  /// Does what is due at `now` and sets own_deadline_ anew.
  virtual void run_timers(Instant now) = 0;
  /// Puts what is known at `now` into the dictionary.
  virtual void refresh(Instant now) = 0;

  [[nodiscard]] canopen::ObjectDictionary& dictionary() { return node_.dictionary(); }

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
  bool hangs_ = false;
  canopen::Node node_;
};

}  // namespace meltbench::board
