#pragma once
/// The controller as master of a serial line: asks its devices one after the other.

#include <cstdint>
#include <string_view>
#include <vector>

#include "controller/machine/settings.hpp"
#include "protocols/modbus/rtu_client.hpp"
#include "protocols/participant/participant.hpp"

namespace meltbench::machine {

/// One Modbus unit that wants to be asked.
class SerialDevice {
 public:
  virtual ~SerialDevice() = default;
  [[nodiscard]] virtual std::uint8_t unit() const = 0;
  /// When it wants the line next; never() = not before something else happens to it.
  [[nodiscard]] virtual Instant next_request_at() const = 0;
  /// The line is its own now.
  [[nodiscard]] virtual modbus::Pdu make_request(Instant now) = 0;
  /// How that ended.
  virtual void on_result(Instant now, const modbus::ClientResult& result) = 0;
};

/// Times of one of the settings' lines. @pre it is there.
[[nodiscard]] modbus::LineTiming timing_of(const ControllerSettings& settings, std::string_view line);

/// Who has waited longest comes first. Real time: no allocation in the steady state.
class SerialMaster {
 public:
  /// @param number  of the line in Participant::lines().
  SerialMaster(std::uint8_t number, const modbus::LineTiming& timing, const modbus::ClientTimes& times)
      : number_{number}, client_{timing, times} {
    bytes_.reserve(2 * modbus::kMaxFrame);
  }

  /// @param device  must outlive this.
  void add(SerialDevice& device) { devices_.push_back(&device); }

  void on_bytes(Instant now, const SerialArrival& arrival);
  /// Time-outs, and requests that are due.
  void on_time(Instant now, Outbox& out);
  [[nodiscard]] Instant next_deadline() const;

  [[nodiscard]] std::uint64_t timeouts() const { return client_.timeouts(); }

 private:
  void take_result(Instant now);
  [[nodiscard]] SerialDevice* find_due(Instant now) const;

  std::uint8_t number_;
  modbus::RtuClient client_;
  std::vector<SerialDevice*> devices_;
  SerialDevice* asked_ = nullptr;
  std::vector<std::uint8_t> bytes_;
};

}  // namespace meltbench::machine
