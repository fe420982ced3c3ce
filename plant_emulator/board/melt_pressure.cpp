#include "plant_emulator/board/melt_pressure.hpp"

#include <cmath>

namespace meltbench::board {

namespace {

constexpr double kPaPerBar = 1e5;
constexpr double kTemperatureStep_K = 0.1;
constexpr float kMinMelt_degC = 0.0F, kMaxMelt_degC = 400.0F;
constexpr canopen::ObjectAddress kAutozero{0x6125, 1};
constexpr canopen::ObjectAddress kOffset{0x6124, 1};
constexpr std::uint32_t kZeroSignature = 0x6F72657A;  // "zero"
constexpr std::array<std::string_view, 4> kSignals{"reading_Pa", "sample_age_s", "status", "melt_degC"};

std::uint32_t to_us(Nanos span) {
  return static_cast<std::uint32_t>(span / 1us);
}

canopen::ObjectDictionary configure(const canopen::ObjectDictionary& eds, const MeltPressureSettings& settings) {
  const bool filtered = settings.filter_samples > 1;
  return with_defaults(
      eds,
      {make_default(0x2002, 0, to_us(settings.latency)), make_default(0x6114, 1, to_us(settings.sample_time)),
       make_default(0x6114, 2, to_us(settings.sample_time)), make_default(0x6148, 2, kMinMelt_degC),
       make_default(0x6149, 2, kMaxMelt_degC), make_default(0x6148, 1, static_cast<float>(settings.span_start_bar)),
       make_default(0x6149, 1, static_cast<float>(settings.span_end_bar)),
       make_default(0x61A0, 1, static_cast<std::uint8_t>(filtered ? 1 : 0)),
       make_default(0x61A1, 1, static_cast<std::uint8_t>(settings.filter_samples))});
}

}  // namespace

MeltPressure::MeltPressure(std::string name, const canopen::ObjectDictionary& dictionary, std::uint8_t node_id,
                           const MeltPressureSettings& settings, Chance chance, Process& process)
    : Board{std::move(name), configure(dictionary, settings), node_id, process},
      settings_{settings},
      clock_{chance.draw_phase(settings.sample_time), settings.sample_time},
      noise_seed_{chance.draw_bits()},
      pending_{static_cast<std::size_t>(settings.latency / settings.sample_time) + 2} {
  canopen::ObjectDictionary& od = this->dictionary();
  age_us_ = od.bind<std::uint16_t>(0x2001);
  field_bar_ = od.bind<float>(0x6100, 1);
  offset_bar_ = od.bind<float>(0x6124, 1);
  pv_bar_ = od.bind<float>(0x6130, 1);
  status_ = od.bind<std::uint8_t>(0x6150, 1);
  filter_type_ = od.bind<std::uint8_t>(0x61A0, 1);
  filter_constant_ = od.bind<std::uint8_t>(0x61A1, 1);
  count_Pa_ = od.bind<std::int32_t>(0x9130, 1);
  field_degC_ = od.bind<float>(0x6100, 2);
  pv_degC_ = od.bind<float>(0x6130, 2);
  melt_status_ = od.bind<std::uint8_t>(0x6150, 2);
  count_0p1degC_ = od.bind<std::int32_t>(0x9130, 2);
}

std::size_t MeltPressure::filter_length() const {
  return filter_type_.get() == 0 ? 1 : std::clamp<std::size_t>(filter_constant_.get(), 1, kMaxFilter);
}

Instant MeltPressure::next_touch(Instant until) const {
  if (filter_length() == 1) {
    const Instant readable = clock_.last_until(until - settings_.latency);
    if (readable > sampled_at_) return readable;
  }
  const Instant next = clock_.next_after(sampled_at_);
  return next <= until ? next : Instant::never();
}

void MeltPressure::touch(Instant at) {
  sampled_at_ = at;
  double pressure_Pa = process().pressure_Pa();
  if (settings_.noise_Pa > 0) pressure_Pa += settings_.noise_Pa * calc_noise(noise_seed_, clock_.number_of(at));
  pressure_Pa = filter(pressure_Pa);
  make_available(at);
  pending_.push_back({at, pressure_Pa, process().T_melt_degC()});
}

/// Moving average over the newest samples, over what there is while there are fewer.
double MeltPressure::filter(double pressure_Pa) {
  const std::size_t length = filter_length();
  if (length == 1) {
    recent_count_ = 0;
    return pressure_Pa;
  }
  recent_Pa_[recent_count_++ % kMaxFilter] = pressure_Pa;
  const std::size_t n = std::min(length, recent_count_);
  double sum = 0;
  for (std::size_t i = 1; i <= n; ++i) sum += recent_Pa_[(recent_count_ - i) % kMaxFilter];
  return sum / static_cast<double>(n);
}

void MeltPressure::make_available(Instant now) {
  while (!pending_.empty() && pending_.front().taken_at + settings_.latency <= now) {
    newest_ = pending_.front();
    pending_.pop_front();
  }
}

double MeltPressure::reading_Pa() const {
  const double with_offset = newest_.pressure_Pa + static_cast<double>(offset_bar_.get()) * kPaPerBar;
  const double in_span =
      std::clamp(with_offset, settings_.span_start_bar * kPaPerBar, settings_.span_end_bar * kPaPerBar);
  return std::round(quantise(in_span, settings_.resolution_Pa));
}

/// 0 where there is no melt.
double MeltPressure::melt_reading_degC() const {
  return std::isnan(newest_.melt_degC) ? 0.0 : quantise(newest_.melt_degC, kTemperatureStep_K);
}

std::uint8_t MeltPressure::status() const {
  const double with_offset_bar = newest_.pressure_Pa / kPaPerBar + static_cast<double>(offset_bar_.get());
  if (with_offset_bar > settings_.span_end_bar) return kNotValid | kPositiveOverload;
  if (with_offset_bar < settings_.span_start_bar) return kNotValid | kNegativeOverload;
  return 0;
}

void MeltPressure::refresh(Instant now) {
  make_available(now);
  const double reading = reading_Pa();
  count_Pa_.set(static_cast<std::int32_t>(reading));
  pv_bar_.set(static_cast<float>(reading / kPaPerBar));
  field_bar_.set(static_cast<float>(newest_.pressure_Pa / kPaPerBar));
  status_.set(status());
  age_us_.set(to_age(now - newest_.taken_at, 1us));
  const double melt_degC = melt_reading_degC();
  count_0p1degC_.set(static_cast<std::int32_t>(std::lround(melt_degC * 10)));
  field_degC_.set(static_cast<float>(melt_degC));
  pv_degC_.set(static_cast<float>(melt_degC));
  melt_status_.set(std::isnan(newest_.melt_degC) ? kNotValid : 0);
}

canopen::AbortCode MeltPressure::on_write(Instant /*now*/, const canopen::OdEntry& entry,
                                          std::span<const std::uint8_t> value) {
  if (entry.address() == kAutozero && canopen::load<std::uint32_t>(value) != kZeroSignature) {
    return canopen::AbortCode::kInvalidValue;
  }
  if (entry.address() == kOffset && !std::isfinite(canopen::load<float>(value))) {
    return canopen::AbortCode::kInvalidValue;
  }
  return canopen::AbortCode::kNone;
}

void MeltPressure::on_written(Instant now, const canopen::OdEntry& entry) {
  invalidate();
  if (entry.address() == kAutozero) {
    make_available(now);
    offset_bar_.set(static_cast<float>(-newest_.pressure_Pa / kPaPerBar));
  }
}

void MeltPressure::on_reset(Instant now, canopen::ResetKind kind) {
  invalidate();
  if (kind == canopen::ResetKind::kCommunication) return;
  while (!pending_.empty()) pending_.pop_front();
  recent_count_ = 0;
  newest_ = {now, process().pressure_Pa(), process().T_melt_degC()};
  sampled_at_ = now;
}

std::span<const std::string_view> MeltPressure::signal_names() const {
  return kSignals;
}

void MeltPressure::settle(Instant now) {
  make_available(now);
  settled_age_s_ = to_s(now - newest_.taken_at);
}

void MeltPressure::read_signals(std::span<double> values) const {
  values[0] = reading_Pa();
  values[1] = settled_age_s_;
  values[2] = status();
  values[3] = melt_reading_degC();
}

}  // namespace meltbench::board
