#include "plant_emulator/board/rtu_feeder.hpp"

#include <algorithm>
#include <cmath>

#include <fmt/format.h>

#include "plant_emulator/board/quantise.hpp"

namespace meltbench::board {

namespace {

using modbus::ExceptionCode;
using modbus::Table;
using namespace feeder_register;

constexpr std::uint16_t kPairsEnd = kWatchdog;  // Below it 32-bit values.
constexpr std::array<std::string_view, 6> kIdentity{"Meltbench", "LIW-1", "1.0", "", "Loss-in-weight feeder", "LIW"};

template <std::size_t size, class T>
void put(std::array<std::uint16_t, size>& words, std::uint16_t at, T value, modbus::WordOrder order) {
  const modbus::WordPair pair = modbus::to_words(value, order);
  words[at] = pair[0];
  words[at + 1U] = pair[1];
}

std::uint32_t to_us(Nanos span) {
  return static_cast<std::uint32_t>(span / 1us);
}

}  // namespace

RtuFeeder::RtuFeeder(std::string name, std::uint8_t unit, const FeederSettings& settings, Chance chance,
                     Process& process)
    : RtuBoard{std::move(name), process},
      firmware_{settings, chance, process, *this},
      unit_{unit},
      word_order_{},
      loss_of_master_kg_per_h_{},
      watchdog_ms_{} {
  forget();
}

/// What was written to it.
void RtuFeeder::forget() {
  const FeederSettings& settings = firmware_.settings();
  word_order_ = settings.low_word_first ? modbus::WordOrder::kLowFirst : modbus::WordOrder::kHighFirst;
  loss_of_master_kg_per_h_ = static_cast<float>(settings.loss_of_master_kg_per_h);
  watchdog_ms_ = settings.watchdog_ms;
  configured_ = false;
}

void RtuFeeder::start(Instant now) {
  forget();
  firmware_.power_up(now);
}

std::uint8_t RtuFeeder::status() const {
  return static_cast<std::uint8_t>(firmware_.status() | (configured_ ? kFeederConfigured : 0));
}

void RtuFeeder::attach(modbus::RtuServer& server) {
  server.add(unit_, *this, firmware_.settings().answer_delay);
}

void RtuFeeder::on_time(Instant now) {
  if (now < firmware_.watchdog_at()) return;
  const double flow = static_cast<double>(loss_of_master_kg_per_h_);
  if (!firmware_.lose_master(now, flow)) return;
  report(Severity::kWarning, now, "master-lost",
         fmt::format("no set point for {} ms: flow falls to {:.4g} kg/h", watchdog_ms_, flow));
}

void RtuFeeder::on_hopper_empty(Instant at) {
  report(Severity::kFault, at, "hopper-empty", "the hopper is empty, nothing is delivered");
}

void RtuFeeder::on_refill(Instant at, bool begins) {
  report(Severity::kInfo, at, begins ? "refill-begins" : "refill-ends",
         begins ? "refill valve opens, volumetric" : "refill valve closes");
}

// --- registers

bool RtuFeeder::covers(Table table, std::uint16_t first, std::uint16_t count, bool to_write) const {
  const unsigned end = unsigned{first} + count;
  switch (table) {
    case Table::kCoils:
      return end <= feeder_coil::kCount;
    case Table::kDiscreteInputs:
      return end <= kFeederInputs;
    case Table::kInputRegisters:
      return end <= kReportSize;
    case Table::kHoldingRegisters:
      break;
  }
  if (!to_write) return end <= kSettings || (first >= kReport && end <= kReport + kReportSize);
  const bool halves = (first < kPairsEnd && first % 2 != 0) || (end < kPairsEnd && end % 2 != 0);
  return end <= kSettings && !halves;
}

RtuFeeder::Orders RtuFeeder::orders() const {
  return {.set_point_kg_per_h = static_cast<float>(firmware_.set_point_kg_per_h()),
          .refill_low_kg = static_cast<float>(firmware_.refill_low_kg()),
          .refill_high_kg = static_cast<float>(firmware_.refill_high_kg()),
          .loss_of_master_kg_per_h = loss_of_master_kg_per_h_,
          .watchdog_ms = watchdog_ms_,
          .mode = static_cast<std::uint16_t>(firmware_.is_told_volumetric() ? 1 : 0),
          .word_order = word_order_};
}

RtuFeeder::Settings RtuFeeder::encode(const Orders& orders) const {
  Settings words{};
  put(words, kSetPoint, orders.set_point_kg_per_h, word_order_);
  put(words, kRefillLow, orders.refill_low_kg, word_order_);
  put(words, kRefillHigh, orders.refill_high_kg, word_order_);
  put(words, kLossOfMaster, orders.loss_of_master_kg_per_h, word_order_);
  words[kWatchdog] = orders.watchdog_ms;
  words[kMode] = orders.mode;
  words[kWordOrder] = static_cast<std::uint16_t>(orders.word_order);
  return words;
}

RtuFeeder::Orders RtuFeeder::decode(const Settings& words) const {
  const auto number = [&](std::uint16_t at) { return modbus::to_float(std::span{words}.subspan(at, 2), word_order_); };
  return {.set_point_kg_per_h = number(kSetPoint),
          .refill_low_kg = number(kRefillLow),
          .refill_high_kg = number(kRefillHigh),
          .loss_of_master_kg_per_h = number(kLossOfMaster),
          .watchdog_ms = words[kWatchdog],
          .mode = words[kMode],
          .word_order = static_cast<modbus::WordOrder>(words[kWordOrder])};
}

RtuFeeder::Report RtuFeeder::make_report(Instant now) {
  firmware_.move_to(now);
  const FeederSettings& settings = firmware_.settings();
  const auto as_float = [](double value) { return static_cast<float>(value); };
  Report words{};
  put(words, kFlow, firmware_.flow_kg_per_h(), word_order_);
  words[kFlowAge] = to_age(firmware_.flow_age(now), FeederFirmware::kAgeUnit);
  words[kChanges] = firmware_.changes();
  words[kStatus] = status();
  words[kAlarms] = status() & kFeederAlarms;
  put(words, kMassFlow, as_float(firmware_.measured_kg_per_h()), word_order_);
  put(words, kNetWeight, as_float(firmware_.weight_kg()) - firmware_.tare_kg(), word_order_);
  put(words, kDriveCommand, as_float(firmware_.drive_command_percent()), word_order_);
  put(words, kFeedFactor, as_float(firmware_.feed_factor_kg_per_h()), word_order_);
  put(words, kTotalizer, as_float(firmware_.totalizer_kg()), word_order_);
  words[kActingMode] = firmware_.is_refilling() ? 2 : firmware_.is_volumetric() ? 1 : 0;
  put(words, kSetPointInForce, as_float(firmware_.set_point_kg_per_h()), word_order_);
  put(words, kMaxFlow, as_float(settings.max_flow_kg_per_h), word_order_);
  put(words, kLatency, to_us(settings.latency), word_order_);
  put(words, kControlCycle, to_us(settings.sample_time), word_order_);
  return words;
}

ExceptionCode RtuFeeder::read_registers(Instant now, Table table, std::uint16_t first,
                                        std::span<std::uint16_t> values) {
  const bool is_report = table == Table::kInputRegisters || first >= kReport;
  if (is_report) {
    const Report report = make_report(now);
    const std::size_t from = table == Table::kInputRegisters ? first : first - std::size_t{kReport};
    std::copy_n(report.begin() + static_cast<std::ptrdiff_t>(from), values.size(), values.begin());
  } else {
    const Settings settings = encode(orders());
    std::copy_n(settings.begin() + first, values.size(), values.begin());
  }
  return ExceptionCode::kNone;
}

ExceptionCode RtuFeeder::write_registers(Instant now, std::uint16_t first, std::span<const std::uint16_t> values) {
  Settings words = encode(orders());
  std::copy(values.begin(), values.end(), words.begin() + first);
  const Orders wanted = decode(words);
  const bool has_set_point = first <= kSetPoint;
  if (has_set_point && !firmware_.check(static_cast<double>(wanted.set_point_kg_per_h))) {
    return ExceptionCode::kIllegalValue;
  }
  const bool no_refill = wanted.refill_low_kg == 0;
  const bool in_order = wanted.refill_low_kg > 0 && wanted.refill_high_kg > wanted.refill_low_kg;
  const bool limits_good = (no_refill || in_order) && std::isfinite(wanted.refill_high_kg);
  const auto max_flow = static_cast<float>(firmware_.settings().max_flow_kg_per_h);
  const bool safe_good = wanted.loss_of_master_kg_per_h >= 0 && wanted.loss_of_master_kg_per_h <= max_flow;
  if (!limits_good || !safe_good || wanted.mode > 1 || words[kWordOrder] > 1) return ExceptionCode::kIllegalValue;
  if (first <= kLossOfMaster && first + values.size() > kLossOfMaster) configured_ = true;
  obey(now, wanted, has_set_point);
  return ExceptionCode::kNone;
}

void RtuFeeder::obey(Instant now, const Orders& wanted, bool has_set_point) {
  const Orders before = orders();
  word_order_ = wanted.word_order;
  loss_of_master_kg_per_h_ = wanted.loss_of_master_kg_per_h;
  if (wanted.refill_low_kg != before.refill_low_kg || wanted.refill_high_kg != before.refill_high_kg) {
    firmware_.set_refill_limits(now, static_cast<double>(wanted.refill_low_kg),
                                static_cast<double>(wanted.refill_high_kg));
  }
  if (wanted.mode != before.mode) firmware_.set_volumetric(now, wanted.mode == 1);
  if (wanted.watchdog_ms != before.watchdog_ms) {
    watchdog_ms_ = wanted.watchdog_ms;
    firmware_.change_watchdog(now, watchdog_ms_);
  }
  if (has_set_point && firmware_.take_set_point(now, static_cast<double>(wanted.set_point_kg_per_h), watchdog_ms_)) {
    report(Severity::kInfo, now, "master-back", "set points come again");
  }
}

// --- bits

bool RtuFeeder::is_coil_on(std::size_t coil) const {
  switch (coil) {
    case feeder_coil::kRun:
      return firmware_.is_running();
    case feeder_coil::kVolumetricMode:
      return firmware_.is_told_volumetric();
    case feeder_coil::kRefill:
      return firmware_.is_refilling();
    default:
      return false;  // Commands that are done at once.
  }
}

ExceptionCode RtuFeeder::read_bits(Instant now, Table table, std::uint16_t first, std::span<bool> values) {
  firmware_.move_to(now);
  for (std::size_t i = 0; i < values.size(); ++i) {
    const std::size_t bit = first + i;
    values[i] = table == Table::kCoils ? is_coil_on(bit) : (status() >> bit & 1U) != 0;
  }
  return ExceptionCode::kNone;
}

ExceptionCode RtuFeeder::write_coils(Instant now, std::uint16_t first, std::span<const bool> values) {
  const auto asks = [&](std::uint16_t coil) {
    return coil >= first && coil < first + values.size() && values[coil - first];
  };
  const auto has = [&](std::uint16_t coil) { return coil >= first && coil < first + values.size(); };
  if (asks(feeder_coil::kTare) && (firmware_.is_refilling() || asks(feeder_coil::kRefill))) return ExceptionCode::kBusy;
  if (asks(feeder_coil::kRefill) && !firmware_.begin_refill(now)) return ExceptionCode::kDeviceFailure;
  if (has(feeder_coil::kRun)) firmware_.set_running(now, asks(feeder_coil::kRun));
  if (has(feeder_coil::kVolumetricMode)) firmware_.set_volumetric(now, asks(feeder_coil::kVolumetricMode));
  if (asks(feeder_coil::kClearTotalizer)) firmware_.clear_totalizer();
  if (asks(feeder_coil::kTare)) firmware_.tare();
  return ExceptionCode::kNone;
}

modbus::Identity RtuFeeder::identity() const {
  return kIdentity;
}

}  // namespace meltbench::board
