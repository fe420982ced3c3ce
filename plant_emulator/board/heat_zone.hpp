#pragma once
/// One closed loop of the heater, whatever wire it hangs on: thermocouple, control law, supervision, relay output.

#include <cstdint>

#include "plant_emulator/board/process.hpp"
#include "plant_emulator/board/relay_tuner.hpp"
#include "plant_emulator/board/settings.hpp"
#include "protocols/time/instant.hpp"

namespace meltbench::board {

/// Bits of a zone's state, the same on both wires.
enum ZoneState : std::uint8_t {
  kZoneOn = 0x01,          ///< Released, and the master is there.
  kZoneWarm = 0x02,        ///< Within the warm band of the set point.
  kZoneTooHot = 0x04,      ///< Alarm: above the limit.
  kZoneSensorOpen = 0x08,  ///< Alarm: the thermocouple is broken.
  kZoneNoRise = 0x10,      ///< Alarm: full power for the window has not warmed it by the change.
  kZoneUnasked = 0x20,     ///< Alarm: it has warmed by the change in a window above the set point without power.
  kZoneAutotune = 0x40,    ///< A relay experiment runs.
  kZoneAlarm = 0x80,       ///< Off because of an alarm.
};
inline constexpr std::uint8_t kZoneAlarms = kZoneTooHot | kZoneSensorOpen | kZoneNoRise | kZoneUnasked;

/// What an alarm means: "is above its limit".
[[nodiscard]] std::string_view describe(ZoneState alarm);

/// What a master can change while it runs.
struct ZoneParameters {
  double set_degC = 0;
  double band_K = 20;
  double integral_s = 120;  ///< 0: none.
  double derivative_s = 20;
  double cycle_s = 2;  ///< Of the relay.
  double max_degC = 300;
  double warm_band_K = 3;
  Nanos window = 120s;  ///< Of the supervision,
  double change_K = 2;  ///< and what is to happen in it.
};

/// Y = (e + 1/Tn int e dt - Tv dX/dt) / Xp, cut to 0..1; the derivative is that of the temperature, smoothed over Tv/8;
/// the integral is held while Y is cut, so it cannot wind up. Alarms are latched: the zone stays off until somebody
/// acknowledges.
class HeatZone {
 public:
  /// @param channel  of the process.  @param noise_seed  of its thermocouple.
  HeatZone(const HeaterSettings& settings, std::size_t channel, bool fitted, std::uint64_t noise_seed);

  /// @param warm  begins with the power that keeps it warm.
  void power_up(Instant now, bool warm, Process& process);

  /// One cycle. @param sample_number  for the noise. @param released  it may heat.
  /// @returns the alarm that it has raised, else 0.
  std::uint8_t control(Instant at, std::int64_t sample_number, bool released, const ZoneParameters& set,
                       Process& process);

  /// When the relay opens within its cycle; never() if it does not.
  [[nodiscard]] Instant switches_off() const { return switches_off_; }
  void switch_off(Process& process);
  /// Nobody controls it: no output from now on.
  void rest(Process& process) {
    Y_ = 0;
    switch_off(process);
  }
  /// Takes back the alarms whose cause is gone. @returns them.
  std::uint8_t acknowledge(double max_degC);

  [[nodiscard]] bool is_fitted() const { return fitted_; }
  [[nodiscard]] bool is_on(bool released) const { return fitted_ && released && alarms_ == 0; }
  [[nodiscard]] bool is_open() const { return open_; }  ///< The thermocouple, at the last sample.
  [[nodiscard]] double X_degC() const { return X_degC_; }
  [[nodiscard]] double output() const { return Y_; }  ///< Share of full power.
  [[nodiscard]] std::uint8_t alarms() const { return alarms_; }
  [[nodiscard]] std::uint8_t state(bool released, const ZoneParameters& set) const;
  [[nodiscard]] RelayTuner& tuner() { return tuner_; }
  [[nodiscard]] const RelayTuner& tuner() const { return tuner_; }
  /// The parameters are those that the tuner has found: without a bump, from what has held the zone.
  void begin_tuned() {
    const RelayTuner::Result& found = tuner_.result();
    integral_Ks_ = found.mean_output * found.proportional_band_K() * found.integral_s();
  }

 private:
  [[nodiscard]] std::uint8_t measure(std::int64_t sample_number, const ZoneParameters& set, const Process& process);
  [[nodiscard]] double calc_output(const ZoneParameters& set);
  [[nodiscard]] std::uint8_t watch(Instant at, const ZoneParameters& set);
  [[nodiscard]] std::uint8_t raise(ZoneState alarm);
  void drive(Instant at, double cycle_s, Process& process);

  HeaterSettings settings_;
  std::size_t channel_;
  bool fitted_;
  std::uint64_t noise_seed_;
  bool open_ = false;
  double X_degC_ = 0;        // The last temperature that was one.
  double rate_K_per_s_ = 0;  // Smoothed.
  double integral_Ks_ = 0;
  double Y_ = 0;
  std::uint8_t alarms_ = 0;
  RelayTuner tuner_;
  bool is_watched_ = false;  // A supervision window is open, since and from there:
  bool watches_rise_ = false;
  Instant watched_since_{};
  double watched_from_degC_ = 0;
  Instant cycle_ends_{};
  Instant switches_off_ = Instant::never();
};

}  // namespace meltbench::board
