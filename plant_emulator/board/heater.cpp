#include "plant_emulator/board/heater.hpp"

#include <cmath>

#include <fmt/format.h>

#include "plant_emulator/board/heater_signals.hpp"

namespace meltbench::board {

namespace {

constexpr double kPerDegree = 10.0, kPerPercent = 10.0, kPerSecond = 10.0;  // Counts on the wire.
constexpr double kMaxSet_degC = 400.0;
constexpr std::uint16_t kTypeK = 2;
constexpr std::uint8_t kAllChannels = 0x1F;
constexpr canopen::ObjectAddress kRelease{0x2000, 0};
constexpr canopen::ObjectAddress kWatchdog{0x2006, 0};
constexpr canopen::ObjectAddress kAcknowledge{0x2105, 0};
constexpr std::uint16_t kOnOff = 0x6422, kSetPoint = 0x7402, kAutotune = 0x2110;
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
    const bool fitted = i < settings.barrel_zones || i == kNozzle;
    channels_.push_back({{}, HeatZone{settings, i, fitted, chance.draw_bits()}});
    channels_.back().od = {.pv = od.bind<float>(0x6130, n),
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
  for (const Channel& channel : channels_) next = std::min(next, channel.zone.switches_off());
  return next <= until ? next : Instant::never();
}

void Heater::touch(Instant at) {
  for (Channel& channel : channels_) {
    if (channel.zone.switches_off() <= at) channel.zone.switch_off(process());
  }
  if (clock_.next_after(sampled_at_) > at) return;
  sampled_at_ = at;
  for (std::size_t i = 0; i < kChannels; ++i) {
    Channel& channel = channels_[i];
    if (!channel.zone.is_fitted()) continue;
    const std::uint8_t raised =
        channel.zone.control(at, clock_.number_of(at), is_released(channel), parameters_of(channel), process());
    if (raised != 0) raise_alarm(i, at, static_cast<ZoneState>(raised));
    follow_tuner(channel, i, at);
  }
  invalidate();
}

ZoneParameters Heater::parameters_of(const Channel& channel) {
  const Objects& od = channel.od;
  return {.set_degC = std::clamp(od.set_point.get() / kPerDegree, 0.0, kMaxSet_degC),
          .band_K = std::max<double>(od.band.get(), 1) / kPerDegree,
          .integral_s = od.integral.get() / kPerSecond,
          .derivative_s = od.derivative.get() / kPerSecond,
          .cycle_s = od.cycle.get() / kPerSecond,
          .max_degC = od.max.get() / kPerDegree,
          .warm_band_K = od.warm_band.get() / kPerDegree,
          .window = od.window.get() * 1s,
          .change_K = od.change.get() / kPerDegree};
}

void Heater::raise_alarm(std::size_t number, Instant at, ZoneState alarm) {
  switch_supply();
  node().raise_emcy(emcy_of(alarm), canopen::error_register::kGeneric | canopen::error_register::kTemperature,
                    {static_cast<std::uint8_t>(number + 1)});
  report(Severity::kFault, at, "zone-alarm", fmt::format("channel {} {}: off", number + 1, describe(alarm)));
}

void Heater::acknowledge(std::uint8_t bits) {
  for (std::size_t i = 0; i < kChannels; ++i) {
    if ((bits >> i & 1U) == 0) continue;
    const std::uint8_t gone = channels_[i].zone.acknowledge(parameters_of(channels_[i]).max_degC);
    for (const ZoneState alarm : {kZoneTooHot, kZoneSensorOpen, kZoneNoRise, kZoneUnasked}) {
      if ((gone & alarm) != 0) node().clear_emcy(emcy_of(alarm), static_cast<std::uint8_t>(i + 1));
    }
  }
  switch_supply();
}

void Heater::follow_tuner(Channel& channel, std::size_t number, Instant at) {
  const RelayTuner::State state = channel.zone.tuner().state();
  if (state == channel.told) return;
  channel.told = state;
  if (state == RelayTuner::State::kDone) {
    const RelayTuner::Result& result = channel.zone.tuner().result();
    channel.od.ultimate_gain.set(static_cast<float>(100 * result.ultimate_gain_1_per_K));
    channel.od.ultimate_period.set(static_cast<float>(result.ultimate_period_s));
    channel.od.band.set(std::max<std::int16_t>(to_count(result.proportional_band_K(), kPerDegree), 1));
    channel.od.integral.set(to_count(result.integral_s(), kPerSecond));
    channel.od.derivative.set(to_count(result.derivative_s(), kPerSecond));
    channel.zone.begin_tuned();
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

// --- orders

/// The release byte and the on/off objects are the same thing: whichever was written last counts.
void Heater::set_release(std::uint8_t bits) {
  bits &= kAllChannels;
  release_.set(bits);
  release_seen_ = bits;
  for (std::size_t i = 0; i < kChannels; ++i) channels_[i].od.on.set((bits >> i & 1U) != 0);
  switch_supply();
}

/// The last resort against a relay that does not open.
void Heater::switch_supply() {
  unsigned alarms = 0;
  for (const Channel& channel : channels_) alarms |= channel.zone.alarms();
  const bool burns = (alarms & (kZoneTooHot | kZoneUnasked)) != 0;
  process().set_heater_supply(release_seen_ != 0 && !master_lost_ && !burns);
}

void Heater::take_orders(Instant now) {
  invalidate();
  if (lost_nodes_.any()) return;
  if (release_.get() != release_seen_) set_release(release_.get());
  if (master_lost_) {
    master_lost_ = false;
    node().clear_emcy(kEmcySetPointsLost);
    switch_supply();
    report(Severity::kInfo, now, "master-back", "set points come again");
  }
  own_deadline_ = watchdog_ms_.get() != 0 ? now + watchdog_ms_.get() * 1ms : Instant::never();
}

void Heater::lose_master(Instant now, std::string_view why) {
  own_deadline_ = Instant::never();
  if (master_lost_) return;
  master_lost_ = true;
  invalidate();
  for (Channel& channel : channels_) channel.zone.rest(process());
  switch_supply();
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
  const Channel& channel = channels_[entry.address().sub - 1U];
  return channel.zone.is_on(is_released(channel)) ? canopen::AbortCode::kNone : canopen::AbortCode::kDeviceState;
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
      channel.zone.tuner().start(to_s(now), parameters_of(channel).set_degC, settings_.autotune_hysteresis_K);
    } else {
      channel.zone.tuner().stop();
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
    // Once only: a heater that comes back in mid-run waits to be told.
    const bool warm = settings_.warm_start && channels_[i].zone.is_fitted() && now == Instant{};
    if (warm) release = static_cast<std::uint8_t>(release | 1U << i);
    channels_[i].zone.power_up(now, warm, process());
  }
  set_release(release);
}

void Heater::on_heartbeat(Instant now, const canopen::HeartbeatEvent& event) {
  const bool lost = event.change == canopen::HeartbeatChange::kLost;
  lost_nodes_.set(event.node, lost);
  if (lost) lose_master(now, fmt::format("heartbeat of node {} lost", event.node));
}

void Heater::refresh(Instant /*now*/) {
  unsigned any = 0;
  for (std::size_t i = 0; i < kChannels; ++i) {
    Channel& channel = channels_[i];
    const HeatZone& zone = channel.zone;
    const std::uint8_t state = zone.state(is_released(channel), parameters_of(channel));
    any |= state;
    channel.od.state.set(state);
    channel.od.status.set(!zone.is_fitted() ? kNotValid : zone.is_open() ? kNotValid | kPositiveOverload : 0);
    channel.od.count.set(to_count(zone.X_degC(), kPerDegree));
    channel.od.pv.set(static_cast<float>(zone.X_degC()));
    channel.od.output.set(to_count(100 * zone.output(), kPerPercent));
    channel.od.autotune_state.set(static_cast<std::uint8_t>(zone.tuner().state()));
  }
  board_status_.set(static_cast<std::uint8_t>(((any & kZoneOn) != 0 ? kHeaterOn : 0) |
                                              (master_lost_ ? kHeaterMasterLost : 0) |
                                              ((any & kZoneAlarm) != 0 ? kHeaterAlarm : 0)));
}

// --- the recording

std::span<const std::string_view> Heater::signal_names() const {
  return kHeaterSignals;
}

void Heater::read_signals(std::span<double> values) const {
  double alarms = 0;
  for (std::size_t i = 0; i < kChannels; ++i) {
    const Channel& channel = channels_[i];
    values[3 * i] = parameters_of(channel).set_degC;
    values[3 * i + 1] = channel.zone.X_degC();
    values[3 * i + 2] = 100 * channel.zone.output();
    if (channel.zone.alarms() != 0) ++alarms;
  }
  values[3 * kChannels] = alarms;
  values[3 * kChannels + 1] = master_lost_ ? 1 : 0;
}

}  // namespace meltbench::board
