#pragma once
/// A heated zone on a serial line: a temperature controller of its own, fixtures/boards/MODBUS.md.

#include <optional>

#include "controller/machine/serial_unit.hpp"
#include "controller/safety/zone_watch.hpp"

namespace meltbench::machine {

/// What the controller uses of a zone's registers, from 0.
namespace zone_register {
inline constexpr std::uint16_t kSetPoint = 0;     ///< 0.1 °C.
inline constexpr std::uint16_t kTemperature = 1;  ///< 0.1 °C.
inline constexpr std::uint16_t kOutput = 2;       ///< 0.1 %.
inline constexpr std::uint16_t kState = 3;        ///< Bits; kConfigured: has been told its high alarm.
inline constexpr std::uint16_t kConfigured = 0x100;
inline constexpr std::uint16_t kSensor = 4;      ///< 0: good.
inline constexpr std::uint16_t kRun = 5;         ///< 1: heats.
inline constexpr std::uint16_t kHighAlarm = 10;  ///< 0.1 °C.
}  // namespace zone_register

/// Told its high alarm, then polled every kPollPeriod. Set point and release that it reads back otherwise than wanted
/// are written at once. One that was reset says so by its state.
class SerialZone final : public SerialUnit {
 public:
  /// @param channel  1.. barrel zones from the feed throat on, kNozzleChannel the nozzle.
  SerialZone(const ControllerSettings& settings, std::size_t channel);

  /// What it is to do from now on.
  void want(Instant now, double set_degC, bool run);
  /// The newest report since the last call, and when it was true.
  struct Report {
    Instant at;
    safety::ZoneReport zone;
  };
  [[nodiscard]] std::optional<Report> take_report();

  static constexpr Nanos kPollPeriod = 200ms;
  static constexpr std::string_view kProductCode = "TC-1";

 private:
  enum class Step : std::uint8_t { kHighAlarm, kPoll, kSetPoint, kRun };

  [[nodiscard]] modbus::Pdu make_own_request(Instant now) override;
  void on_answer(Instant now, const modbus::ClientResult& result) override;
  void restart() override { step_ = Step::kHighAlarm; }
  void choose_step();

  std::uint16_t high_alarm_;
  std::uint16_t set_ = 0;
  bool run_ = false;
  bool wanted_ = false;         // Somebody has said what it is to do.
  std::uint16_t does_set_ = 0;  // What it does, as it last said.
  bool does_run_ = false;
  Step step_ = Step::kHighAlarm;
  Instant polled_at_{};
  std::optional<Report> report_;
};

}  // namespace meltbench::machine
