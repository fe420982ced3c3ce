#include "plant_emulator/board/rtu_heater.hpp"

#include <algorithm>
#include <cmath>

#include <fmt/format.h>

#include "plant_emulator/board/heater_signals.hpp"

namespace meltbench::board {

namespace {

using modbus::ExceptionCode;
using modbus::Function;
using modbus::Table;
using namespace zone_register;

constexpr double kTenths = 10.0, kPerMille = 1000.0;
constexpr std::uint16_t kMaxSet = 4000, kMaxTime = 32'767;  // 0.1 °C; 0.1 s.
constexpr std::uint8_t kSensorOpen = 0x03;                  // As object 6150 on CAN.
constexpr std::array<std::string_view, 6> kIdentity{"Meltbench", "TC-1", "1.0", "", "Zone temperature controller",
                                                    "TC"};

std::uint16_t to_tenths(double value) {
  return static_cast<std::uint16_t>(std::lround(std::clamp(value * kTenths, 0.0, 65'535.0)));
}

}  // namespace

/// One zone as a device of its own.
class RtuHeater::Unit final : public modbus::RegisterMap {
 public:
  Unit(RtuHeater& board, std::size_t channel, bool fitted, std::uint64_t noise_seed)
      : zone{board.settings_, channel, fitted, noise_seed}, board_{board}, channel_{channel} {
    forget(fitted && board.settings_.warm_start);
  }

  /// What was written to it. @param warm  in control of a warm zone.
  void forget(bool warm) {
    const HeaterSettings& settings = board_.settings_;
    set = {.set_degC = warm ? settings.start[channel_].T_degC : 0.0,
           .band_K = settings.band_K,
           .integral_s = settings.integral_s,
           .derivative_s = settings.derivative_s,
           .cycle_s = settings.cycle_s,
           .max_degC = settings.max_degC,
           .warm_band_K = settings.warm_band_K,
           .window = nanos_from_s(settings.supervision_s),
           .change_K = settings.supervision_K};
    watchdog_ms_ = settings.watchdog_ms;
    watchdog_at = Instant::never();
    run = warm;
    master_lost = configured = false;
    told = RelayTuner::State::kIdle;
  }

  HeatZone zone;
  ZoneParameters set;
  bool run = false;
  bool master_lost = false;
  bool configured = false;
  Instant watchdog_at = Instant::never();
  RelayTuner::State told = RelayTuner::State::kIdle;

  [[nodiscard]] bool is_released() const { return run && !master_lost; }
  /// One that heats from the start wants to be asked from the start, too.
  void watch(Instant now) {
    if (run) restart_watchdog(now);
  }
  void lose_master(Instant now) {
    watchdog_at = Instant::never();
    master_lost = true;
    zone.rest(board_.process());
    board_.switch_supply();
    board_.report(Severity::kWarning, now, "master-lost",
                  fmt::format("channel {}: no request for {} ms: its heater is off", channel_ + 1, watchdog_ms_));
  }

  [[nodiscard]] bool supports(Function function) const override {
    switch (function) {
      case Function::kReadCoils:
      case Function::kReadHoldingRegisters:
      case Function::kWriteCoil:
      case Function::kWriteRegister:
      case Function::kWriteRegisters:
      case Function::kEncapsulated:
        return true;
      default:
        return false;
    }
  }
  [[nodiscard]] bool covers(Table table, std::uint16_t first, std::uint16_t count, bool to_write) const override {
    const unsigned end = unsigned{first} + count;
    if (table == Table::kCoils) return end <= zone_coil::kCount;
    if (!to_write) return end <= kCount;
    return (first == kSetPoint && count == 1) || (first >= kRun && end <= kAutotune);
  }
  ExceptionCode read_registers(Instant now, Table /*table*/, std::uint16_t first,
                               std::span<std::uint16_t> values) override {
    hear(now);
    const Words words = encode();
    std::copy_n(words.begin() + first, values.size(), values.begin());
    return ExceptionCode::kNone;
  }
  ExceptionCode write_registers(Instant now, std::uint16_t first, std::span<const std::uint16_t> values) override;
  ExceptionCode read_bits(Instant now, Table /*table*/, std::uint16_t first, std::span<bool> values) override {
    hear(now);
    for (std::size_t i = 0; i < values.size(); ++i) {
      const std::size_t coil = first + i;
      const bool tunes = zone.tuner().state() == RelayTuner::State::kRunning;
      values[i] = (coil == zone_coil::kRun && run) || (coil == zone_coil::kAutotune && tunes);
    }
    return ExceptionCode::kNone;
  }
  ExceptionCode write_coils(Instant now, std::uint16_t first, std::span<const bool> values) override;
  [[nodiscard]] modbus::Identity identity() const override { return kIdentity; }

 private:
  using Words = std::array<std::uint16_t, kCount>;

  /// Any request says that somebody is there.
  void hear(Instant now) {
    if (std::exchange(master_lost, false)) {
      board_.switch_supply();
      board_.report(Severity::kInfo, now, "master-back", fmt::format("channel {} is polled again", channel_ + 1));
    }
    restart_watchdog(now);
  }
  void restart_watchdog(Instant now) { watchdog_at = watchdog_ms_ != 0 ? now + watchdog_ms_ * 1ms : Instant::never(); }
  [[nodiscard]] Words encode() const {
    return {to_tenths(set.set_degC),
            to_tenths(zone.X_degC()),
            static_cast<std::uint16_t>(std::lround(kPerMille * zone.output())),
            static_cast<std::uint16_t>(zone.state(is_released(), set) | (configured ? kZoneConfigured : 0)),
            zone.is_open() ? kSensorOpen : std::uint8_t{0},
            run ? std::uint16_t{1} : std::uint16_t{0},
            to_tenths(set.band_K),
            to_tenths(set.integral_s),
            to_tenths(set.derivative_s),
            to_tenths(set.cycle_s),
            to_tenths(set.max_degC),
            watchdog_ms_,
            static_cast<std::uint16_t>(zone.tuner().state())};
  }

  RtuHeater& board_;
  std::size_t channel_;
  std::uint16_t watchdog_ms_ = 0;
};

ExceptionCode RtuHeater::Unit::write_registers(Instant now, std::uint16_t first,
                                               std::span<const std::uint16_t> values) {
  hear(now);
  Words words = encode();
  std::copy(values.begin(), values.end(), words.begin() + first);
  const bool good = words[kSetPoint] <= kMaxSet && words[kRun] <= 1 && words[kBand] >= 1 && words[kBand] <= kMaxTime &&
                    words[kIntegral] <= kMaxTime && words[kDerivative] <= kMaxTime && words[kCycle] >= 1 &&
                    words[kCycle] <= kMaxTime && words[kHighAlarm] <= kMaxTime;
  if (!good) return ExceptionCode::kIllegalValue;
  const auto written = [&](std::uint16_t at) { return at >= first && at < first + values.size(); };
  // Only what was written: the rest may be finer than the wire tells.
  const auto take = [&](std::uint16_t at, double& value) {
    if (written(at)) value = words[at] / kTenths;
  };
  take(kSetPoint, set.set_degC);
  take(kBand, set.band_K);
  take(kIntegral, set.integral_s);
  take(kDerivative, set.derivative_s);
  take(kCycle, set.cycle_s);
  take(kHighAlarm, set.max_degC);
  run = words[kRun] == 1;
  if (written(kHighAlarm)) configured = true;
  board_.switch_supply();
  watchdog_ms_ = words[kWatchdog];
  hear(now);
  return ExceptionCode::kNone;
}

ExceptionCode RtuHeater::Unit::write_coils(Instant now, std::uint16_t first, std::span<const bool> values) {
  hear(now);
  const auto written = [&](std::uint16_t coil) { return coil >= first && coil < first + values.size(); };
  const auto asks = [&](std::uint16_t coil) { return written(coil) && values[coil - first]; };
  if (asks(zone_coil::kAutotune) && !zone.is_on(is_released())) return ExceptionCode::kDeviceFailure;
  if (written(zone_coil::kRun)) run = asks(zone_coil::kRun);
  if (asks(zone_coil::kAcknowledge)) static_cast<void>(zone.acknowledge(set.max_degC));
  board_.switch_supply();
  if (asks(zone_coil::kAutotune)) {
    zone.tuner().start(to_s(now), set.set_degC, board_.settings_.autotune_hysteresis_K);
  } else if (written(zone_coil::kAutotune)) {
    zone.tuner().stop();
  }
  return ExceptionCode::kNone;
}

RtuHeater::RtuHeater(std::string name, std::uint8_t unit, const HeaterSettings& settings, Chance chance,
                     Process& process)
    : RtuBoard{std::move(name), process},
      settings_{settings},
      clock_{chance.draw_phase(settings.sample_time), settings.sample_time},
      first_unit_{unit} {
  for (std::size_t i = 0; i < kChannels; ++i) {
    const bool fitted = i < settings.barrel_zones || i == kNozzle;
    units_.push_back(std::make_unique<Unit>(*this, i, fitted, chance.draw_bits()));
  }
}

RtuHeater::~RtuHeater() = default;

void RtuHeater::attach(modbus::RtuServer& server) {
  for (std::size_t i = 0; i < kChannels; ++i) {
    if (!units_[i]->zone.is_fitted()) continue;
    server.add(static_cast<std::uint8_t>(first_unit_ + i), *units_[i], settings_.answer_delay);
  }
}

std::vector<std::uint8_t> RtuHeater::units() const {
  std::vector<std::uint8_t> numbers;
  for (std::size_t i = 0; i < kChannels; ++i) {
    if (units_[i]->zone.is_fitted()) numbers.push_back(static_cast<std::uint8_t>(first_unit_ + i));
  }
  return numbers;
}

void RtuHeater::start(Instant now) {
  for (const auto& unit : units_) {
    // Once only: one that comes back in mid-run waits to be told.
    unit->forget(settings_.warm_start && unit->zone.is_fitted() && now == Instant{});
    unit->watch(now);
    unit->zone.power_up(now, unit->run, process());
  }
  switch_supply();
}

/// The last resort against a relay that does not open.
void RtuHeater::switch_supply() {
  bool released = false;
  unsigned alarms = 0;
  for (const auto& unit : units_) {
    released = released || unit->is_released();
    alarms |= unit->zone.alarms();
  }
  process().set_heater_supply(released && (alarms & (kZoneTooHot | kZoneUnasked)) == 0);
}

void RtuHeater::on_time(Instant now) {
  for (const auto& unit : units_) {
    if (unit->watchdog_at <= now) unit->lose_master(now);
  }
}

Instant RtuHeater::next_deadline() const {
  Instant next = Instant::never();
  for (const auto& unit : units_) next = std::min(next, unit->watchdog_at);
  return next;
}

// --- the process

Instant RtuHeater::next_touch(Instant until) const {
  Instant next = clock_.next_after(sampled_at_);
  for (const auto& unit : units_) next = std::min(next, unit->zone.switches_off());
  return next <= until ? next : Instant::never();
}

void RtuHeater::touch(Instant at) {
  for (const auto& unit : units_) {
    if (unit->zone.switches_off() <= at) unit->zone.switch_off(process());
  }
  if (clock_.next_after(sampled_at_) > at) return;
  sampled_at_ = at;
  for (std::size_t i = 0; i < kChannels; ++i) {
    Unit& unit = *units_[i];
    if (!unit.zone.is_fitted()) continue;
    const std::uint8_t raised = unit.zone.control(at, clock_.number_of(at), unit.is_released(), unit.set, process());
    if (raised != 0) {
      switch_supply();
      report(Severity::kFault, at, "zone-alarm",
             fmt::format("channel {} {}: off", i + 1, describe(static_cast<ZoneState>(raised))));
    }
    const RelayTuner::State state = unit.zone.tuner().state();
    if (state == std::exchange(unit.told, state)) continue;
    if (state == RelayTuner::State::kFailed) {
      report(Severity::kWarning, at, "autotune-failed", fmt::format("channel {} does not oscillate evenly", i + 1));
    }
    if (state != RelayTuner::State::kDone) continue;
    const RelayTuner::Result& result = unit.zone.tuner().result();
    unit.set.band_K = result.proportional_band_K();
    unit.set.integral_s = result.integral_s();
    unit.set.derivative_s = result.derivative_s();
    unit.zone.begin_tuned();
    report(Severity::kInfo, at, "autotune-done",
           fmt::format("channel {}: ultimate gain {:.3g} %/K, period {:.3g} s", i + 1,
                       100 * result.ultimate_gain_1_per_K, result.ultimate_period_s));
  }
}

// --- the recording

std::span<const std::string_view> RtuHeater::signal_names() const {
  return kHeaterSignals;
}

void RtuHeater::read_signals(std::span<double> values) const {
  double alarms = 0, lost = 0;
  for (std::size_t i = 0; i < kChannels; ++i) {
    values[3 * i] = units_[i]->set.set_degC;
    values[3 * i + 1] = units_[i]->zone.X_degC();
    values[3 * i + 2] = 100 * units_[i]->zone.output();
    if (units_[i]->zone.alarms() != 0) ++alarms;
    if (units_[i]->master_lost) lost = 1;
  }
  values[3 * kChannels] = alarms;
  values[3 * kChannels + 1] = lost;
}

}  // namespace meltbench::board
