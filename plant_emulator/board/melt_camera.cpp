#include "plant_emulator/board/melt_camera.hpp"

#include <array>
#include <cmath>

namespace meltbench::board {

namespace {

constexpr Nanos kAgeUnit = 10us;
constexpr double kUmPerM = 1e6, kMkPerK = 1e3;
constexpr std::array<std::string_view, 4> kSignals{"front_m", "T_inlet_degC", "image_age_s", "lost_images"};

std::uint32_t to_us(Nanos span) {
  return static_cast<std::uint32_t>(span / 1us);
}

canopen::ObjectDictionary configure(const canopen::ObjectDictionary& eds, const MeltCameraSettings& settings) {
  return with_defaults(
      eds, {make_default(0x2002, 0, to_us(settings.latency)), make_default(0x6114, 1, to_us(settings.sample_time)),
            make_default(0x6114, 2, to_us(settings.sample_time))});
}

std::int32_t to_count(double value, double counts_per_unit) {
  return std::isnan(value) ? 0 : static_cast<std::int32_t>(std::lround(std::clamp(value, -1e5, 1e5) * counts_per_unit));
}

float to_real(double value) {
  return std::isnan(value) ? 0.0F : static_cast<float>(value);
}

}  // namespace

MeltCamera::MeltCamera(std::string name, const canopen::ObjectDictionary& dictionary, std::uint8_t node_id,
                       const MeltCameraSettings& settings, Chance chance, Process& process)
    : Board{std::move(name), configure(dictionary, settings), node_id, process},
      settings_{settings},
      clock_{chance.draw_phase(settings.sample_time), settings.sample_time},
      front_seed_{chance.draw_bits()},
      temperature_seed_{chance.draw_bits()},
      drop_out_seed_{chance.draw_bits()},
      pending_{static_cast<std::size_t>(settings.latency / settings.sample_time) + 2} {
  canopen::ObjectDictionary& od = this->dictionary();
  age_ = od.bind<std::uint16_t>(0x2001);
  number_ = od.bind<std::uint8_t>(0x2003);
  lost_count_ = od.bind<std::uint32_t>(0x2004);
  front_fv_ = od.bind<float>(0x6100, 1);
  T_fv_ = od.bind<float>(0x6100, 2);
  front_pv_ = od.bind<float>(0x6130, 1);
  T_pv_ = od.bind<float>(0x6130, 2);
  front_status_ = od.bind<std::uint8_t>(0x6150, 1);
  T_status_ = od.bind<std::uint8_t>(0x6150, 2);
  count_um_ = od.bind<std::int32_t>(0x9130, 1);
  count_mK_ = od.bind<std::int32_t>(0x9130, 2);
}

Instant MeltCamera::next_touch(Instant until) const {
  const Instant next = clock_.next_after(taken_at_);
  return next <= until ? next : Instant::never();
}

void MeltCamera::touch(Instant at) {
  taken_at_ = at;
  make_available(at);
  pending_.push_back(take(at));
}

/// In a drop-out that began with this image or with one of those before it.
bool MeltCamera::is_lost(std::int64_t number) const {
  if (settings_.drop_out_probability <= 0) return false;
  for (std::int64_t begin = number - settings_.drop_out_images + 1; begin <= number; ++begin) {
    if (begin >= 0 && draw_at(drop_out_seed_, begin) < settings_.drop_out_probability) return true;
  }
  return false;
}

MeltCamera::Image MeltCamera::take(Instant at) {
  const std::int64_t number = clock_.number_of(at);
  if (is_lost(number)) return {.taken_at = at, .lost = true};
  Image image{.taken_at = at, .front_m = process().front_m(), .T_degC = process().T_inlet_degC()};
  if (settings_.front_noise_m > 0) image.front_m += settings_.front_noise_m * calc_noise(front_seed_, number);
  if (settings_.noise_K > 0) image.T_degC += settings_.noise_K * calc_noise(temperature_seed_, number);
  image.front_m = quantise(image.front_m, settings_.front_resolution_m);
  image.T_degC = quantise(image.T_degC, settings_.resolution_K);
  return image;
}

void MeltCamera::make_available(Instant now) {
  while (!pending_.empty() && pending_.front().taken_at + settings_.latency <= now) {
    newest_is_lost_ = pending_.front().lost;
    if (newest_is_lost_) {
      ++lost_images_;
    } else {
      good_ = pending_.front();
      good_number_ = static_cast<std::uint8_t>(clock_.number_of(good_.taken_at));
    }
    pending_.pop_front();
  }
}

void MeltCamera::refresh(Instant now) {
  make_available(now);
  const auto status = [&](double value) -> std::uint8_t {
    return newest_is_lost_ || std::isnan(value) ? kNotValid : 0;
  };
  count_um_.set(to_count(good_.front_m, kUmPerM));
  count_mK_.set(to_count(good_.T_degC, kMkPerK));
  front_fv_.set(to_real(good_.front_m));
  front_pv_.set(to_real(good_.front_m));
  T_fv_.set(to_real(good_.T_degC));
  T_pv_.set(to_real(good_.T_degC));
  front_status_.set(status(good_.front_m));
  T_status_.set(status(good_.T_degC));
  number_.set(good_number_);
  age_.set(to_age(now - good_.taken_at, kAgeUnit));
  lost_count_.set(lost_images_);
}

void MeltCamera::on_reset(Instant now, canopen::ResetKind kind) {
  invalidate();
  if (kind == canopen::ResetKind::kCommunication) return;
  while (!pending_.empty()) pending_.pop_front();
  good_ = {.taken_at = now};
  newest_is_lost_ = false;
  good_number_ = 0;
  lost_images_ = 0;
}

std::span<const std::string_view> MeltCamera::signal_names() const {
  return kSignals;
}

void MeltCamera::settle(Instant now) {
  make_available(now);
  settled_age_s_ = to_s(now - good_.taken_at);
}

void MeltCamera::read_signals(std::span<double> values) const {
  values[0] = good_.front_m;
  values[1] = good_.T_degC;
  values[2] = settled_age_s_;
  values[3] = lost_images_;
}

}  // namespace meltbench::board
