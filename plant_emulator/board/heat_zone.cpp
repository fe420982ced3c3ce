#include "plant_emulator/board/heat_zone.hpp"

#include <algorithm>
#include <cmath>

#include "plant_emulator/board/quantise.hpp"
#include "plant_emulator/board/sampling.hpp"

namespace meltbench::board {

namespace {

constexpr double kFullPower = 0.95;  // From here on supervision counts it as full.
constexpr double kSmoothing = 8.0;   // The derivative is smoothed over Tv by this.
constexpr double kLeastOn_s = 0.02;  // Shorter than a mains period: the relay stays off.

}  // namespace

std::string_view describe(ZoneState alarm) {
  switch (alarm) {
    case kZoneTooHot:
      return "is above its limit";
    case kZoneSensorOpen:
      return "has an open thermocouple";
    case kZoneNoRise:
      return "does not get warmer at full power";
    default:
      return "gets warmer without power";
  }
}

HeatZone::HeatZone(const HeaterSettings& settings, std::size_t channel, bool fitted, std::uint64_t noise_seed)
    : settings_{settings}, channel_{channel}, fitted_{fitted}, noise_seed_{noise_seed} {}

void HeatZone::power_up(Instant now, bool warm, Process& process) {
  const double read_degC = process.T_zone_degC(channel_);
  X_degC_ = std::isnan(read_degC) ? 0 : read_degC;
  rate_K_per_s_ = integral_Ks_ = Y_ = 0;
  alarms_ = 0;
  tuner_.stop();
  is_watched_ = false;
  cycle_ends_ = now;
  if (warm) {
    Y_ = settings_.start[channel_].heater_share;
    integral_Ks_ = Y_ * settings_.band_K * settings_.integral_s;
  }
  switches_off_ = Instant::never();
  process.set_heater(channel_, Y_);
}

std::uint8_t HeatZone::control(Instant at, std::int64_t sample_number, bool released, const ZoneParameters& set,
                               Process& process) {
  std::uint8_t raised = measure(sample_number, set, process);
  if (raised != 0) switch_off(process);
  if (!is_on(released)) {
    tuner_.stop();
    is_watched_ = false;
    integral_Ks_ = 0;
    Y_ = 0;
  } else if (tuner_.state() == RelayTuner::State::kRunning) {
    Y_ = tuner_.step(to_s(at), X_degC_);
  } else {
    Y_ = calc_output(set);
    raised = watch(at, set);
    if (raised != 0) switch_off(process);
  }
  drive(at, set.cycle_s, process);
  return raised;
}

std::uint8_t HeatZone::raise(ZoneState alarm) {
  if ((alarms_ & alarm) != 0) return 0;
  alarms_ = static_cast<std::uint8_t>(alarms_ | alarm);
  Y_ = 0;
  return alarm;
}

std::uint8_t HeatZone::measure(std::int64_t sample_number, const ZoneParameters& set, const Process& process) {
  const double read_degC = process.T_zone_degC(channel_);
  open_ = std::isnan(read_degC);
  if (open_) return raise(kZoneSensorOpen);
  double X_degC = read_degC;
  if (settings_.noise_K > 0) X_degC += settings_.noise_K * calc_noise(noise_seed_, sample_number);
  X_degC = quantise(X_degC, settings_.resolution_K);
  const double dt_s = to_s(settings_.sample_time);
  const double smooth_s = std::max(set.derivative_s / kSmoothing, 2 * dt_s);
  rate_K_per_s_ += dt_s / (smooth_s + dt_s) * ((X_degC - X_degC_) / dt_s - rate_K_per_s_);
  X_degC_ = X_degC;
  return X_degC > set.max_degC ? raise(kZoneTooHot) : std::uint8_t{0};
}

double HeatZone::calc_output(const ZoneParameters& set) {
  const double Xp_K = set.band_K, Tn_s = set.integral_s, Tv_s = set.derivative_s;
  const double e_K = set.set_degC - X_degC_;
  const double from_integral_K = Tn_s > 0 ? integral_Ks_ / Tn_s : 0.0;
  const double wanted = (e_K + from_integral_K - Tv_s * rate_K_per_s_) / Xp_K;
  const bool pushes_further = (wanted > 1 && e_K > 0) || (wanted < 0 && e_K < 0);
  if (Tn_s > 0 && !pushes_further) {
    integral_Ks_ = std::clamp(integral_Ks_ + e_K * to_s(settings_.sample_time), 0.0, Xp_K * Tn_s);
  }
  return std::clamp(wanted, 0.0, 1.0);
}

/// Full power must warm a zone that is too cold, no power must not warm one that is too hot.
std::uint8_t HeatZone::watch(Instant at, const ZoneParameters& set) {
  const double e_K = set.set_degC - X_degC_;
  const bool heats = Y_ >= kFullPower && e_K > set.warm_band_K;
  const bool rests = Y_ <= 0 && e_K < -set.warm_band_K;
  if (!heats && !rests) {
    is_watched_ = false;
    return 0;
  }
  if (!is_watched_ || watches_rise_ != heats) {
    is_watched_ = true;
    watches_rise_ = heats;
    watched_since_ = at;
    watched_from_degC_ = X_degC_;
    return 0;
  }
  if (at - watched_since_ < set.window) return 0;
  const bool has_risen = X_degC_ - watched_from_degC_ >= set.change_K;
  is_watched_ = false;  // The next sample opens a new window.
  if (heats && !has_risen) return raise(kZoneNoRise);
  if (rests && has_risen) return raise(kZoneUnasked);
  return 0;
}

std::uint8_t HeatZone::acknowledge(double max_degC) {
  if (alarms_ == 0) return 0;
  const auto stays = static_cast<std::uint8_t>((open_ ? kZoneSensorOpen : 0) | (X_degC_ > max_degC ? kZoneTooHot : 0));
  const auto gone = static_cast<std::uint8_t>(alarms_ & ~stays);
  alarms_ = static_cast<std::uint8_t>(alarms_ & stays);
  integral_Ks_ = 0;
  return gone;
}

/// Relay: on for Y of every cycle, which begins at a sample; it may end between two.
void HeatZone::drive(Instant at, double cycle_s, Process& process) {
  if (settings_.proportional) {
    process.set_heater(channel_, Y_);
    return;
  }
  if (Y_ <= 0) {
    switch_off(process);
    cycle_ends_ = at;
    return;
  }
  if (at < cycle_ends_) return;
  const double on_s = Y_ * cycle_s;
  cycle_ends_ = at + nanos_from_s(cycle_s);
  if (on_s < kLeastOn_s) {
    switch_off(process);
    return;
  }
  process.set_heater(channel_, 1);
  switches_off_ = cycle_s - on_s < kLeastOn_s ? Instant::never() : at + nanos_from_s(on_s);
}

void HeatZone::switch_off(Process& process) {
  process.set_heater(channel_, 0);
  switches_off_ = Instant::never();
}

std::uint8_t HeatZone::state(bool released, const ZoneParameters& set) const {
  const bool warm = fitted_ && !open_ && std::abs(set.set_degC - X_degC_) <= set.warm_band_K;
  const bool tunes = tuner_.state() == RelayTuner::State::kRunning;
  return static_cast<std::uint8_t>((is_on(released) ? kZoneOn : 0) | (warm ? kZoneWarm : 0) | alarms_ |
                                   (tunes ? kZoneAutotune : 0) | (alarms_ != 0 ? kZoneAlarm : 0));
}

}  // namespace meltbench::board
