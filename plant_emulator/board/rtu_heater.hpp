#pragma once
/// The heater on a serial line: one unit per zone, in the form of the common single-loop temperature controllers,
/// fixtures/boards/MODBUS.md.

#include <array>
#include <cstdint>
#include <memory>
#include <vector>

#include "plant_emulator/board/heat_zone.hpp"
#include "plant_emulator/board/rtu_board.hpp"
#include "plant_emulator/board/sampling.hpp"

namespace meltbench::board {

/// Holding registers from 0, as on the wire. The first three are those of the Novus N1200: temperature always in
/// tenths.
namespace zone_register {
inline constexpr std::uint16_t kSetPoint = 0, kTemperature = 1, kOutput = 2, kState = 3, kSensor = 4, kRun = 5,
                               kBand = 6, kIntegral = 7, kDerivative = 8, kCycle = 9, kHighAlarm = 10, kWatchdog = 11,
                               kAutotune = 12, kCount = 13;
}
/// Bit of the state behind those of ZoneState: the high alarm has been written since power-up. A master that has
/// written it sees by this bit that the unit was reset.
inline constexpr std::uint16_t kZoneConfigured = 0x100;
namespace zone_coil {
inline constexpr std::uint16_t kRun = 0, kAcknowledge = 1, kAutotune = 2, kCount = 3;
}

/// The same zones as on CAN. The barrel zones are the units from the rig's on, in the order from the feed throat; the
/// nozzle is the rig's unit + 4. Watchdog, for each unit by itself: no request for so long, from its start on if it
/// heats then, and it stops heating until the next one.
/// A contactor before all bands takes their power, whatever a relay does, as soon as no unit may heat, or while one is
/// too hot or rises unasked.
/// Refused as illegal address: what is read only; as illegal value: out of range; as device failure: to try out a zone
/// that does not heat.
class RtuHeater final : public RtuBoard {
 public:
  static constexpr std::size_t kChannels = 5;
  static constexpr std::size_t kNozzle = 4;  ///< From 0.

  RtuHeater(std::string name, std::uint8_t unit, const HeaterSettings& settings, Chance chance, Process& process);
  ~RtuHeater() override;

  void attach(modbus::RtuServer& server) override;
  [[nodiscard]] std::vector<std::uint8_t> units() const override;
  void start(Instant now) override;
  void on_time(Instant now) override;
  [[nodiscard]] Instant next_deadline() const override;

  [[nodiscard]] Instant next_touch(Instant until) const override;
  void touch(Instant at) override;
  [[nodiscard]] std::span<const std::string_view> signal_names() const override;
  void read_signals(std::span<double> values) const override;

 private:
  class Unit;

  void switch_supply();

  HeaterSettings settings_;
  SampleClock clock_;
  std::uint8_t first_unit_;
  std::vector<std::unique_ptr<Unit>> units_;  // By channel; those that are not fitted are on no line.
  Instant sampled_at_ = SampleClock::kNone;
};

}  // namespace meltbench::board
