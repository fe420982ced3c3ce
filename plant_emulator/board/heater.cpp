#include "plant_emulator/board/heater.hpp"

#include <cmath>

#include <fmt/format.h>

namespace meltbench::board {

namespace {

constexpr double kPerDegree = 10.0, kPerPercent = 10.0, kPerSecond = 10.0;  // Counts on the wire.
constexpr double kMaxSet_degC = 400.0;
constexpr double kFullPower = 0.95;  // From here on supervision counts it as full.
constexpr double kSmoothing = 8.0;   // The derivative is smoothed over Tv by this.
constexpr double kLeastOn_s = 0.02;  // Shorter than a mains period: the relay stays off.
constexpr std::uint16_t kTypeK = 2;
constexpr std::uint8_t kAllChannels = 0x1F;
constexpr canopen::ObjectAddress kRelease{0x2000, 0};
constexpr canopen::ObjectAddress kWatchdog{0x2006, 0};
constexpr canopen::ObjectAddress kAcknowledge{0x2105, 0};
constexpr std::uint16_t kOnOff = 0x6422, kSetPoint = 0x7402, kAutotune = 0x2110;
constexpr std::array<std::string_view, 17> kSignals{
    "zone1_set_degC",  "zone1_degC",  "zone1_output_percent",  "zone2_set_degC", "zone2_degC", "zone2_output_percent",
    "zone3_set_degC",  "zone3_degC",  "zone3_output_percent",  "zone4_set_degC", "zone4_degC", "zone4_output_percent",
    "nozzle_set_degC", "nozzle_degC", "nozzle_output_percent", "alarms",         "master_lost"};

std::int16_t to_count(double value, double counts_per_unit) {
  return static_cast<std::int16_t>(std::lround(std::clamp(value * counts_per_unit, -32768.0, 32767.0)));
}

canopen::ObjectDictionary configure(const canopen::ObjectDictionary& eds, const HeaterSettings& settings) {
  const auto whole = [](double value) { return static_cast<std::uint16_t>(std::lround(value)); };
  std::vector<DefaultValue> defaults{make_default(0x2006, 0, settings.watchdog_ms),
                                     make_default(0x2008, 0, static_cast<std::uint8_t>(settings.proportional ? 1 : 0))};
  for (std::uint8_t n = 1; n <= Heater::kChannels; ++n) {
    const bool fitted = n - 1U < settings.barrel_zones || n - 1U == Heater::kNozzle;
    defaults.push_back(make_default(0x6110, n, fitted ? kTypeK : std::uint16_t{0}));
    defaults.push_back(make_default(0x6114, n, static_cast<std::uint32_t>(settings.sample_time / 1us)));
    defaults.push_back(make_default(0x7148, n, to_count(-50, kPerDegree)));
    defaults.push_back(make_default(0x7149, n, to_count(800, kPerDegree)));
    defaults.push_back(make_default(0x7450, n, to_count(settings.band_K, kPerDegree)));
    defaults.push_back(make_default(0x7452, n, to_count(settings.integral_s, kPerSecond)));
    defaults.push_back(make_default(0x7454, n, to_count(settings.derivative_s, kPerSecond)));
    defaults.push_back(make_default(0x7456, n, to_count(settings.cycle_s, kPerSecond)));
    defaults.push_back(make_default(0x2100, n, to_count(settings.max_degC, kPerDegree)));
    defaults.push_back(make_default(0x2101, n, to_count(settings.warm_band_K, kPerDegree)));
    defaults.push_back(make_default(0x2103, n, whole(settings.supervision_s)));
    defaults.push_back(make_default(0x2104, n, to_count(settings.supervision_K, kPerDegree)));
    if (settings.warm_start && fitted) {
      defaults.push_back(make_default(kSetPoint, n, to_count(settings.start[n - 1U].T_degC, kPerDegree)));
    }
  }
  return with_defaults(eds, defaults);
}

std::uint16_t emcy_of(ZoneState alarm) {
  switch (alarm) {
    case kZoneTooHot:
      return Heater::kEmcyTooHot;
    case kZoneSensorOpen:
      return Heater::kEmcySensor;
    case kZoneNoRise:
      return Heater::kEmcyNoRise;
    default:
      return Heater::kEmcyUnasked;
  }
}

std::string_view text_of(ZoneState alarm) {
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

}  // namespace

Heater::Heater(std::string name, const canopen::ObjectDictionary& dictionary, std::uint8_t node_id,
               const HeaterSettings& settings, Chance chance, Process& process)
    : Board{std::move(name), configure(dictionary, settings), node_id, process},
      settings_{settings},
      clock_{chance.draw_phase(settings.sample_time), settings.sample_time} {
  canopen::ObjectDictionary& od = this->dictionary();
  release_ = od.bind<std::uint8_t>(0x2000);
  board_status_ = od.bind<std::uint8_t>(0x2001);
  watchdog_ms_ = od.bind<std::uint16_t>(0x2006);
  for (std::size_t i = 0; i < kChannels; ++i) {
    const auto n = static_cast<std::uint8_t>(i + 1);
    Channel& channel = channels_[i];
    channel.fitted = i < settings.barrel_zones || i == kNozzle;
    channel.noise_seed = chance.draw_bits();
    channel.od = {.pv = od.bind<float>(0x6130, n),
                  .ultimate_gain = od.bind<float>(0x2112, n),
                  .ultimate_period = od.bind<float>(0x2113, n),
                  .status = od.bind<std::uint8_t>(0x6150, n),
                  .state = od.bind<std::uint8_t>(0x2102, n),
                  .autotune_command = od.bind<std::uint8_t>(kAutotune, n),
                  .autotune_state = od.bind<std::uint8_t>(0x2111, n),
                  .on = od.bind<bool>(kOnOff, n),
                  .count = od.bind<std::int16_t>(0x7130, n),
                  .set_point = od.bind<std::int16_t>(kSetPoint, n),
                  .output = od.bind<std::int16_t>(0x7410, n),
                  .band = od.bind<std::int16_t>(0x7450, n),
                  .integral = od.bind<std::int16_t>(0x7452, n),
                  .derivative = od.bind<std::int16_t>(0x7454, n),
                  .cycle = od.bind<std::int16_t>(0x7456, n),
                  .max = od.bind<std::int16_t>(0x2100, n),
                  .warm_band = od.bind<std::int16_t>(0x2101, n),
                  .change = od.bind<std::int16_t>(0x2104, n),
                  .window = od.bind<std::uint16_t>(0x2103, n)};
  }
}

// --- the process

Instant Heater::next_touch(Instant until) const {
  Instant next = clock_.next_after(sampled_at_);
  for (const Channel& channel : channels_) next = std::min(next, channel.switches_off);
  return next <= until ? next : Instant::never();
}

void Heater::touch(Instant at) {
  for (std::size_t i = 0; i < kChannels; ++i) {
    if (channels_[i].switches_off <= at) switch_off(channels_[i], i);
  }
  if (clock_.next_after(sampled_at_) > at) return;
  sampled_at_ = at;
  for (std::size_t i = 0; i < kChannels; ++i) {
    if (channels_[i].fitted) control(channels_[i], i, at);
  }
  invalidate();
}

void Heater::measure(Channel& channel, std::size_t number, Instant at) {
  const double read_degC = process().T_zone_degC(number);
  channel.open = std::isnan(read_degC);
  if (channel.open) {
    raise_alarm(channel, number, at, kZoneSensorOpen);
    return;
  }
  double X_degC = read_degC;
  if (settings_.noise_K > 0) X_degC += settings_.noise_K * calc_noise(channel.noise_seed, clock_.number_of(at));
  X_degC = quantise(X_degC, settings_.resolution_K);
  const double dt_s = to_s(clock_.period());
  const double smooth_s = std::max(channel.od.derivative.get() / kPerSecond / kSmoothing, 2 * dt_s);
  channel.rate_K_per_s += dt_s / (smooth_s + dt_s) * ((X_degC - channel.X_degC) / dt_s - channel.rate_K_per_s);
  channel.X_degC = X_degC;
  if (X_degC > channel.od.max.get() / kPerDegree) raise_alarm(channel, number, at, kZoneTooHot);
}

void Heater::control(Channel& channel, std::size_t number, Instant at) {
  measure(channel, number, at);
  if (!is_on(number)) {
    channel.tuner.stop();
    channel.is_watched = false;
    channel.integral_Ks = 0;
    channel.Y = 0;
  } else if (channel.tuner.state() == RelayTuner::State::kRunning) {
    channel.Y = channel.tuner.step(to_s(at), channel.X_degC);
  } else {
    channel.Y = calc_output(channel);
    watch(channel, number, at);
  }
  follow_tuner(channel, number, at);
  drive(channel, number, at);
}

double Heater::set_degC(const Channel& channel) const {
  return std::clamp(channel.od.set_point.get() / kPerDegree, 0.0, kMaxSet_degC);
}

double Heater::calc_output(Channel& channel) const {
  const double Xp_K = std::max<double>(channel.od.band.get(), 1) / kPerDegree;
  const double Tn_s = channel.od.integral.get() / kPerSecond;
  const double Tv_s = channel.od.derivative.get() / kPerSecond;
  const double e_K = set_degC(channel) - channel.X_degC;
  const double from_integral_K = Tn_s > 0 ? channel.integral_Ks / Tn_s : 0.0;
  const double wanted = (e_K + from_integral_K - Tv_s * channel.rate_K_per_s) / Xp_K;
  const bool pushes_further = (wanted > 1 && e_K > 0) || (wanted < 0 && e_K < 0);
  if (Tn_s > 0 && !pushes_further) {
    channel.integral_Ks = std::clamp(channel.integral_Ks + e_K * to_s(clock_.period()), 0.0, Xp_K * Tn_s);
  }
  return std::clamp(wanted, 0.0, 1.0);
}

/// Full power must warm a zone that is too cold, no power must not warm one that is too hot.
void Heater::watch(Channel& channel, std::size_t number, Instant at) {
  const double e_K = set_degC(channel) - channel.X_degC;
  const double warm_K = channel.od.warm_band.get() / kPerDegree;
  const bool heats = channel.Y >= kFullPower && e_K > warm_K;
  const bool rests = channel.Y <= 0 && e_K < -warm_K;
  if (!heats && !rests) {
    channel.is_watched = false;
    return;
  }
  if (!channel.is_watched || channel.watches_rise != heats) {
    channel.is_watched = true;
    channel.watches_rise = heats;
    channel.watched_since = at;
    channel.watched_from_degC = channel.X_degC;
    return;
  }
  if (at - channel.watched_since < channel.od.window.get() * 1s) return;
  const bool has_risen = channel.X_degC - channel.watched_from_degC >= channel.od.change.get() / kPerDegree;
  channel.is_watched = false;  // The next sample opens a new window.
  if (heats && !has_risen) raise_alarm(channel, number, at, kZoneNoRise);
  if (rests && has_risen) raise_alarm(channel, number, at, kZoneUnasked);
}

void Heater::raise_alarm(Channel& channel, std::size_t number, Instant at, ZoneState alarm) {
  if ((channel.alarms & alarm) != 0) return;
  channel.alarms = static_cast<std::uint8_t>(channel.alarms | alarm);
  channel.Y = 0;
  switch_off(channel, number);
  node().raise_emcy(emcy_of(alarm), canopen::error_register::kGeneric | canopen::error_register::kTemperature,
                    {static_cast<std::uint8_t>(number + 1)});
  report(Severity::kFault, at, "zone-alarm", fmt::format("channel {} {}: off", number + 1, text_of(alarm)));
}

void Heater::acknowledge(std::uint8_t bits) {
  for (std::size_t i = 0; i < kChannels; ++i) {
    Channel& channel = channels_[i];
    if ((bits >> i & 1U) == 0 || channel.alarms == 0) continue;
    const bool still_hot = channel.X_degC > channel.od.max.get() / kPerDegree;
    const auto stays = static_cast<std::uint8_t>((channel.open ? kZoneSensorOpen : 0) | (still_hot ? kZoneTooHot : 0));
    for (const ZoneState alarm : {kZoneTooHot, kZoneSensorOpen, kZoneNoRise, kZoneUnasked}) {
      if ((channel.alarms & ~stays & alarm) != 0) {
        node().clear_emcy(emcy_of(alarm), static_cast<std::uint8_t>(i + 1));
      }
    }
    channel.alarms = static_cast<std::uint8_t>(channel.alarms & stays);
    channel.integral_Ks = 0;
  }
}

void Heater::follow_tuner(Channel& channel, std::size_t number, Instant at) {
  const RelayTuner::State state = channel.tuner.state();
  if (state == channel.told) return;
  channel.told = state;
  if (state == RelayTuner::State::kDone) {
    const RelayTuner::Result& result = channel.tuner.result();
    channel.od.ultimate_gain.set(static_cast<float>(100 * result.ultimate_gain_1_per_K));
    channel.od.ultimate_period.set(static_cast<float>(result.ultimate_period_s));
    channel.od.band.set(std::max<std::int16_t>(to_count(result.proportional_band_K(), kPerDegree), 1));
    channel.od.integral.set(to_count(result.integral_s(), kPerSecond));
    channel.od.derivative.set(to_count(result.derivative_s(), kPerSecond));
    // Without a bump: the new controller begins at what has held the zone.
    channel.integral_Ks = result.mean_output * result.proportional_band_K() * result.integral_s();
    report(Severity::kInfo, at, "autotune-done",
           fmt::format("channel {}: ultimate gain {:.3g} %/K, period {:.3g} s", number + 1,
                       100 * result.ultimate_gain_1_per_K, result.ultimate_period_s));
  }
  if (state == RelayTuner::State::kFailed) {
    node().raise_emcy(kEmcyAutotune, canopen::error_register::kGeneric | canopen::error_register::kManufacturer,
                      {static_cast<std::uint8_t>(number + 1)});
    report(Severity::kWarning, at, "autotune-failed", fmt::format("channel {} does not oscillate evenly", number + 1));
  }
}

/// Relay: on for Y of every cycle, which begins at a sample; it may end between two.
void Heater::drive(Channel& channel, std::size_t number, Instant at) {
  if (settings_.proportional) {
    process().set_heater(number, channel.Y);
    return;
  }
  if (channel.Y <= 0) {
    switch_off(channel, number);
    channel.cycle_ends = at;
    return;
  }
  if (at < channel.cycle_ends) return;
  const double cycle_s = channel.od.cycle.get() / kPerSecond;
  const double on_s = channel.Y * cycle_s;
  channel.cycle_ends = at + nanos_from_s(cycle_s);
  if (on_s < kLeastOn_s) {
    switch_off(channel, number);
    return;
  }
  process().set_heater(number, 1);
  channel.switches_off = cycle_s - on_s < kLeastOn_s ? Instant::never() : at + nanos_from_s(on_s);
}

void Heater::switch_off(Channel& channel, std::size_t number) {
  process().set_heater(number, 0);
  channel.switches_off = Instant::never();
}

bool Heater::is_on(std::size_t number) const {
  const Channel& channel = channels_[number];
  return channel.fitted && !master_lost_ && channel.alarms == 0 && channel.od.on.get();
}

// --- orders

/// The release byte and the on/off objects are the same thing: whichever was written last counts.
void Heater::set_release(std::uint8_t bits) {
  bits &= kAllChannels;
  release_.set(bits);
  release_seen_ = bits;
  for (std::size_t i = 0; i < kChannels; ++i) channels_[i].od.on.set((bits >> i & 1U) != 0);
}

void Heater::take_orders(Instant now) {
  invalidate();
  if (lost_nodes_.any()) return;
  if (release_.get() != release_seen_) set_release(release_.get());
  if (master_lost_) {
    master_lost_ = false;
    node().clear_emcy(kEmcySetPointsLost);
    report(Severity::kInfo, now, "master-back", "set points come again");
  }
  own_deadline_ = watchdog_ms_.get() != 0 ? now + watchdog_ms_.get() * 1ms : Instant::never();
}

void Heater::lose_master(Instant now, std::string_view why) {
  own_deadline_ = Instant::never();
  if (master_lost_) return;
  master_lost_ = true;
  invalidate();
  for (std::size_t i = 0; i < kChannels; ++i) {
    channels_[i].Y = 0;
    switch_off(channels_[i], i);
  }
  report(Severity::kWarning, now, "master-lost", fmt::format("{}: all heaters are off", why));
}

void Heater::run_timers(Instant now) {
  if (now < own_deadline_) return;
  lose_master(now, fmt::format("no set points for {} ms", watchdog_ms_.get()));
  node().raise_emcy(kEmcySetPointsLost, canopen::error_register::kGeneric | canopen::error_register::kManufacturer);
}

// --- the bus

canopen::AbortCode Heater::on_write(Instant /*now*/, const canopen::OdEntry& entry,
                                    std::span<const std::uint8_t> value) {
  if (entry.address().index != kAutotune || value[0] == 0) return canopen::AbortCode::kNone;
  return is_on(entry.address().sub - 1U) ? canopen::AbortCode::kNone : canopen::AbortCode::kDeviceState;
}

void Heater::on_written(Instant now, const canopen::OdEntry& entry) {
  invalidate();
  const canopen::ObjectAddress address = entry.address();
  if (address == kRelease) set_release(release_.get());
  if (address.index == kOnOff) {
    unsigned bits = 0;
    for (std::size_t i = 0; i < kChannels; ++i) bits |= (channels_[i].od.on.get() ? 1U : 0U) << i;
    set_release(static_cast<std::uint8_t>(bits));
  }
  if (address == kAcknowledge) acknowledge(entry.get<std::uint8_t>());
  if (address == kWatchdog && own_deadline_ != Instant::never()) {
    own_deadline_ = watchdog_ms_.get() != 0 ? now + watchdog_ms_.get() * 1ms : Instant::never();
  }
  if (address.index == kAutotune && address.sub > 0) {
    Channel& channel = channels_[address.sub - 1U];
    if (entry.get<std::uint8_t>() != 0) {
      node().clear_emcy(kEmcyAutotune, address.sub);
      channel.tuner.start(to_s(now), set_degC(channel), settings_.autotune_hysteresis_K);
    } else {
      channel.tuner.stop();
    }
  }
}

void Heater::on_rpdo(Instant now, unsigned /*number*/) {
  take_orders(now);
}

void Heater::on_reset(Instant now, canopen::ResetKind kind) {
  invalidate();
  lost_nodes_.reset();
  if (kind == canopen::ResetKind::kCommunication) return;
  master_lost_ = false;
  own_deadline_ = Instant::never();
  std::uint8_t release = 0;
  for (std::size_t i = 0; i < kChannels; ++i) {
    Channel& channel = channels_[i];
    const double read_degC = process().T_zone_degC(i);
    channel.X_degC = std::isnan(read_degC) ? 0 : read_degC;
    channel.rate_K_per_s = channel.integral_Ks = channel.Y = 0;
    channel.alarms = 0;
    channel.tuner.stop();
    channel.is_watched = false;
    channel.cycle_ends = now;
    // Once only: a heater that comes back in mid-run waits to be told.
    const bool warm = settings_.warm_start && channel.fitted && now == Instant{};
    if (warm) {
      release = static_cast<std::uint8_t>(release | 1U << i);
      channel.Y = settings_.start[i].heater_share;
      channel.integral_Ks = channel.Y * settings_.band_K * settings_.integral_s;
    }
    channel.switches_off = Instant::never();
    process().set_heater(i, channel.Y);
  }
  set_release(release);
}

void Heater::on_heartbeat(Instant now, const canopen::HeartbeatEvent& event) {
  const bool lost = event.change == canopen::HeartbeatChange::kLost;
  lost_nodes_.set(event.node, lost);
  if (lost) lose_master(now, fmt::format("heartbeat of node {} lost", event.node));
}

std::uint8_t Heater::zone_state(std::size_t number) const {
  const Channel& channel = channels_[number];
  const bool warm = channel.fitted && !channel.open &&
                    std::abs(set_degC(channel) - channel.X_degC) <= channel.od.warm_band.get() / kPerDegree;
  const bool tunes = channel.tuner.state() == RelayTuner::State::kRunning;
  return static_cast<std::uint8_t>((is_on(number) ? kZoneOn : 0) | (warm ? kZoneWarm : 0) | channel.alarms |
                                   (tunes ? kZoneAutotune : 0) | (channel.alarms != 0 ? kZoneAlarm : 0));
}

void Heater::refresh(Instant /*now*/) {
  unsigned any = 0;
  for (std::size_t i = 0; i < kChannels; ++i) {
    Channel& channel = channels_[i];
    const std::uint8_t state = zone_state(i);
    any |= state;
    channel.od.state.set(state);
    channel.od.status.set(!channel.fitted ? kNotValid : channel.open ? kNotValid | kPositiveOverload : 0);
    channel.od.count.set(to_count(channel.X_degC, kPerDegree));
    channel.od.pv.set(static_cast<float>(channel.X_degC));
    channel.od.output.set(to_count(100 * channel.Y, kPerPercent));
    channel.od.autotune_state.set(static_cast<std::uint8_t>(channel.tuner.state()));
  }
  board_status_.set(static_cast<std::uint8_t>(((any & kZoneOn) != 0 ? kHeaterOn : 0) |
                                              (master_lost_ ? kHeaterMasterLost : 0) |
                                              ((any & kZoneAlarm) != 0 ? kHeaterAlarm : 0)));
}

// --- the recording

std::span<const std::string_view> Heater::signal_names() const {
  return kSignals;
}

void Heater::read_signals(std::span<double> values) const {
  double alarms = 0;
  for (std::size_t i = 0; i < kChannels; ++i) {
    const Channel& channel = channels_[i];
    values[3 * i] = set_degC(channel);
    values[3 * i + 1] = channel.X_degC;
    values[3 * i + 2] = 100 * channel.Y;
    if (channel.alarms != 0) ++alarms;
  }
  values[3 * kChannels] = alarms;
  values[3 * kChannels + 1] = master_lost_ ? 1 : 0;
}

}  // namespace meltbench::board
