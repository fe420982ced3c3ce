#pragma once
/// Heater controller: closed loops for the barrel zones and the nozzle, with supervision and autotune.

#include <array>
#include <bitset>
#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "plant_emulator/board/board.hpp"
#include "plant_emulator/board/heat_zone.hpp"
#include "plant_emulator/board/sampling.hpp"
#include "plant_emulator/board/settings.hpp"

namespace meltbench::board {

/// Bits of object 2001.
enum HeaterStatus : std::uint8_t { kHeaterOn = 0x01, kHeaterMasterLost = 0x02, kHeaterAlarm = 0x04 };

/// The heater's firmware. Channels 1..4 are the barrel zones from the feed throat on, 5 is the nozzle; those that the
/// plant has not are not fitted (6110 = 0, 6150 = 01). Objects that a controller needs (fixtures/boards/heater.eds has
/// all), :n is the channel:
/// - 7402:n  I16  RPDO 1, 2  set point [0.1 degC]
/// - 2000    U8   RPDO 2     release, bit n - 1 = channel n; the same as 6422:n. 0 at power-up (but see warm_start)
/// - 7130:n  I16  TPDO 1..   temperature [0.1 degC]
/// - 6150:n  U8   TPDO 1..   InputStatus; an open thermocouple is 03
/// - 2102:n  U8   TPDO 1..   ZoneState
/// - 7410:n  I16  TPDO 3, 4  output [0.1 %]
/// - 2001    U8   TPDO 4     HeaterStatus
/// - 2105    U8   rw         acknowledges the alarms of these channels, if their cause is gone
/// - 7450, 7452, 7454, 7456:n      proportional band, integral and derivative time, cycle [0.1 K, 0.1 s]; rw
/// - 2110:n, 2111:n, 2112:n, 2113:n  autotune: command, state (RelayTuner::State), ultimate gain [%/K] and period [s]
///
/// What a zone does is in HeatZone. Watchdog: the first RPDO 1 or 2 starts it; if they then stop, or a heartbeat of
/// 1016 is lost, all outputs are 0, with EMCY FF01, until the next one comes.
///
/// A contactor before all bands takes the power from a relay that is welded: it opens when no channel is released, the
/// master is lost, or a zone is too hot or has warmed unasked.
class Heater final : public Board {
 public:
  static constexpr std::size_t kChannels = 5;
  static constexpr std::size_t kNozzle = 4;  ///< From 0.
  static constexpr std::uint16_t kEmcySensor = 0x5000;
  static constexpr std::uint16_t kEmcySetPointsLost = 0xFF01;
  static constexpr std::uint16_t kEmcyTooHot = 0xFF11;
  static constexpr std::uint16_t kEmcyNoRise = 0xFF12;
  static constexpr std::uint16_t kEmcyUnasked = 0xFF13;
  static constexpr std::uint16_t kEmcyAutotune = 0xFF14;

  /// Parameters and @throws as Feeder.
  Heater(std::string name, const canopen::ObjectDictionary& dictionary, std::uint8_t node_id,
         const HeaterSettings& settings, Chance chance, Process& process);

  [[nodiscard]] Instant next_touch(Instant until) const override;
  void touch(Instant at) override;

  [[nodiscard]] std::span<const std::string_view> signal_names() const override;
  void read_signals(std::span<double> values) const override;

 protected:
  void run_timers(Instant now) override;
  void refresh(Instant now) override;

  canopen::AbortCode on_write(Instant now, const canopen::OdEntry& entry, std::span<const std::uint8_t> value) override;
  void on_written(Instant now, const canopen::OdEntry& entry) override;
  void on_rpdo(Instant now, unsigned number) override;
  void on_reset(Instant now, canopen::ResetKind kind) override;
  void on_heartbeat(Instant now, const canopen::HeartbeatEvent& event) override;

 private:
  struct Objects {
    canopen::OdValue<float> pv, ultimate_gain, ultimate_period;
    canopen::OdValue<std::uint8_t> status, state, autotune_command, autotune_state;
    canopen::OdValue<bool> on;
    canopen::OdValue<std::int16_t> count, set_point, output, band, integral, derivative, cycle, max, warm_band, change;
    canopen::OdValue<std::uint16_t> window;
  };
  struct Channel {
    Objects od;
    HeatZone zone;
    RelayTuner::State told = RelayTuner::State::kIdle;
  };

  void take_orders(Instant now);
  void lose_master(Instant now, std::string_view why);
  void switch_supply();
  void set_release(std::uint8_t bits);
  [[nodiscard]] bool is_released(const Channel& channel) const { return !master_lost_ && channel.od.on.get(); }
  [[nodiscard]] static ZoneParameters parameters_of(const Channel& channel);
  void raise_alarm(std::size_t number, Instant at, ZoneState alarm);
  void acknowledge(std::uint8_t bits);
  void follow_tuner(Channel& channel, std::size_t number, Instant at);

  HeaterSettings settings_;
  SampleClock clock_;
  std::vector<Channel> channels_;  // kChannels.
  canopen::OdValue<std::uint8_t> release_, board_status_;
  canopen::OdValue<std::uint16_t> watchdog_ms_;
  std::uint8_t release_seen_ = 0;
  std::bitset<128> lost_nodes_;  // Whose heartbeat is lost.
  bool master_lost_ = false;
  Instant sampled_at_ = SampleClock::kNone;
};

}  // namespace meltbench::board
