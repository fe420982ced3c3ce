#include "plant_emulator/board/feeder_firmware.hpp"

#include <algorithm>
#include <array>
#include <cmath>

#include "plant_emulator/board/quantise.hpp"

namespace meltbench::board {

namespace {

constexpr double kSecondsPerHour = 3600.0;
constexpr std::size_t kMaxSetPointsUnderWay = 1024;

constexpr std::array<std::string_view, 7> kSignals{"set_point_kg_per_h", "flow_kg_per_h", "measured_flow_kg_per_h",
                                                   "net_weight_kg",      "delivered_kg",  "master_lost",
                                                   "volumetric"};

}  // namespace

FeederFirmware::FeederFirmware(const FeederSettings& settings, Chance chance, Process& process,
                               FeederListener& listener)
    : settings_{settings},
      control_clock_{chance.draw_phase(settings.sample_time), settings.sample_time},
      weight_clock_{chance.draw_phase(settings.weight_sample_time), settings.weight_sample_time},
      noise_seed_{chance.draw_bits()},
      process_{process},
      listener_{listener},
      pending_{kMaxSetPointsUnderWay},
      hopper_kg_{settings.hopper_kg},
      weight_kg_{settings.hopper_kg} {}

void FeederFirmware::power_up(Instant now) {
  move_to(now);
  while (!pending_.empty()) pending_.pop_front();
  master_lost_ = cut_ = not_a_number_ = told_volumetric_ = false;
  running_ = true;
  watchdog_at_ = Instant::never();
  const double flow = quantise(settings_.start_flow_kg_per_h, settings_.flow_resolution_kg_per_h);
  scheduled_kg_per_h_ = static_cast<float>(flow);
  set_point_kg_per_h_ = flow;
  if (now == Instant{}) {  // It has been so for as long as anyone can remember.
    flow_kg_per_h_ = scheduled_kg_per_h_;
    filtered_kg_per_h_ = flow;
  }
  set_mode(now);
  deliver(now, scheduled_kg_per_h_);
}

// --- the process

Instant FeederFirmware::next_touch(Instant until) const {
  Instant next = std::min(empty_at(), low_at());
  if (!pending_.empty()) next = std::min(next, pending_.front().at);
  // Its true flow changes with the weight: in steps of the scale's cycle.
  if (volumetric_) next = std::min(next, weight_clock_.next_after(moved_to_));
  if (process_.is_hopper_empty() != ran_dry_) next = moved_to_;
  return next <= until ? next : Instant::never();
}

void FeederFirmware::touch(Instant at) {
  move_to(at);
  if (!pending_.empty() && pending_.front().at <= at) {
    const Change change = pending_.front();
    pending_.pop_front();
    deliver(at, change.flow_kg_per_h);
  }
  if (process_.is_hopper_empty() != ran_dry_) run_dry(at);
  follow_refill(at);
  if (!empty_ && flow_kg_per_h_ > 0 && hopper_kg_ <= 0 && !refilling_) {
    empty_ = true;
    deliver(at, flow_kg_per_h_);
    listener_.on_hopper_empty(at);
  }
}

/// Somebody forgot the hopper, or came and filled it.
void FeederFirmware::run_dry(Instant at) {
  ran_dry_ = process_.is_hopper_empty();
  hopper_kg_ = ran_dry_ ? 0 : settings_.hopper_kg;
  if (ran_dry_ || !empty_) return;
  empty_ = false;
  deliver(at, scheduled_kg_per_h_);
}

void FeederFirmware::follow_refill(Instant at) {
  if (!refilling_ && settings_.refill_low_kg > 0 && hopper_kg_ <= settings_.refill_low_kg) begin_refill(at);
  if (refilling_ && hopper_kg_ >= settings_.refill_high_kg) {
    refilling_ = false;
    calm_at_ = at + settings_.refill_settle;
    listener_.on_refill(at, false);
  }
  set_mode(at);
  if (volumetric_) drive();
}

/// Volumetric feeding begins with what the scale said last.
void FeederFirmware::set_mode(Instant at) {
  const bool was_volumetric = volumetric_;
  volumetric_ = told_volumetric_ || refilling_ || at < calm_at_;
  if (volumetric_ == was_volumetric) return;
  if (volumetric_) held_factor_kg_per_h_ = true_factor_kg_per_h();
  drive();
}

double FeederFirmware::true_factor_kg_per_h() const {
  const double span_kg = settings_.refill_high_kg - settings_.refill_low_kg;
  const double share = span_kg > 0 ? std::clamp((hopper_kg_ - settings_.refill_low_kg) / span_kg, 0.0, 1.0) : 0.0;
  return settings_.max_flow_kg_per_h * (1 + settings_.fill_effect * share);
}

double FeederFirmware::drive_command_percent() const {
  return 100 * static_cast<double>(flow_kg_per_h_) / feed_factor_kg_per_h();
}

void FeederFirmware::deliver(Instant at, float flow_kg_per_h) {
  const float possible = empty_ ? 0.0F : flow_kg_per_h;
  if (possible != flow_kg_per_h_) {
    flow_kg_per_h_ = possible;
    changed_at_ = at;
    ++change_count_;
  }
  drive();
}

void FeederFirmware::drive() {
  true_kg_per_h_ = static_cast<double>(flow_kg_per_h_);
  if (volumetric_) true_kg_per_h_ *= true_factor_kg_per_h() / held_factor_kg_per_h_;
  process_.set_feed_kg_per_s(true_kg_per_h_ / kSecondsPerHour);
}

double FeederFirmware::fed_kg_per_s() const {
  return process_.fed_kg_per_s(true_kg_per_h_ / kSecondsPerHour);
}

double FeederFirmware::net_kg_per_s() const {
  return (refilling_ ? settings_.refill_kg_per_h / kSecondsPerHour : 0.0) - fed_kg_per_s();
}

Instant FeederFirmware::falls_to(double weight_kg) const {
  const double fed = fed_kg_per_s();
  if (refilling_ || !(fed > 0)) return Instant::never();
  const double left_s = (hopper_kg_ - weight_kg) / fed;
  if (left_s > 1e9) return Instant::never();  // 30 years.
  return moved_to_ + nanos_from_s(std::max(left_s, 0.0));
}

Instant FeederFirmware::low_at() const {
  return settings_.refill_low_kg > 0 ? falls_to(settings_.refill_low_kg) : Instant::never();
}

/// Hopper, totalizer and flow filter over a time in which the flow is constant.
void FeederFirmware::move_to(Instant at) {
  if (at <= moved_to_) return;
  sample_weight(at);
  const bool runs_empty = at >= empty_at();
  const bool runs_low = at >= low_at();
  const double dt_s = to_s(at - moved_to_);
  const auto flow = static_cast<double>(flow_kg_per_h_);
  const double fed = fed_kg_per_s();
  const double left_kg = std::min(fed * dt_s, hopper_kg_);
  // What the scale sees; the set point, while it does not look.
  const double share = true_kg_per_h_ > 0 ? fed / (true_kg_per_h_ / kSecondsPerHour) : 1.0;
  const double weighed = volumetric_ ? flow : flow * share;
  hopper_kg_ += refilling_ ? net_kg_per_s() * dt_s : -left_kg;
  // Without the rounding of the last nanosecond.
  if (runs_low) hopper_kg_ = std::min(hopper_kg_, settings_.refill_low_kg);
  if (runs_empty) hopper_kg_ = 0;
  delivered_kg_ += volumetric_ ? flow / kSecondsPerHour * dt_s : left_kg;
  filtered_kg_per_h_ = weighed + (filtered_kg_per_h_ - weighed) * std::exp(-dt_s / settings_.flow_filter_s);
  moved_to_ = at;
}

/// The newest weight that the scale has taken up to `until`; older ones nobody can read any more.
void FeederFirmware::sample_weight(Instant until) {
  const Instant sample = weight_clock_.last_until(until);
  if (sample <= weighed_at_ || sample < moved_to_) return;
  const double since_s = to_s(sample - moved_to_);
  weight_kg_ = std::max(hopper_kg_ + net_kg_per_s() * since_s, 0.0);
  if (settings_.weight_noise_kg > 0) {
    weight_kg_ += settings_.weight_noise_kg * calc_noise(noise_seed_, weight_clock_.number_of(sample));
  }
  weight_kg_ = quantise(weight_kg_, settings_.weight_resolution_kg);
  weighed_at_ = sample;
}

bool FeederFirmware::begin_refill(Instant now) {
  move_to(now);
  const bool possible = settings_.refill_low_kg > 0 && hopper_kg_ < settings_.refill_high_kg;
  if (!possible || refilling_) return possible;
  refilling_ = true;
  set_mode(now);
  if (empty_) {
    empty_ = false;
    deliver(now, scheduled_kg_per_h_);
  }
  listener_.on_refill(now, true);
  return true;
}

void FeederFirmware::set_refill_limits(Instant now, double low_kg, double high_kg) {
  move_to(now);
  settings_.refill_low_kg = low_kg;
  settings_.refill_high_kg = high_kg;
}

void FeederFirmware::set_volumetric(Instant now, bool volumetric) {
  move_to(now);
  told_volumetric_ = volumetric;
  set_mode(now);
}

// --- set points

bool FeederFirmware::check(double set_point_kg_per_h) {
  not_a_number_ = !std::isfinite(set_point_kg_per_h);
  return !not_a_number_;
}

bool FeederFirmware::take_set_point(Instant now, double set_point_kg_per_h, std::uint16_t watchdog_ms) {
  set_point_kg_per_h_ = set_point_kg_per_h;
  const double flow = std::clamp(set_point_kg_per_h, 0.0, settings_.max_flow_kg_per_h);
  cut_ = flow != set_point_kg_per_h;
  const bool is_back = master_lost_;
  master_lost_ = false;
  schedule(now, running_ ? flow : 0.0);
  watchdog_at_ = watchdog_ms != 0 ? now + watchdog_ms * 1ms : Instant::never();
  return is_back;
}

void FeederFirmware::change_watchdog(Instant now, std::uint16_t watchdog_ms) {
  if (watchdog_at_ == Instant::never()) return;
  watchdog_at_ = watchdog_ms != 0 ? now + watchdog_ms * 1ms : Instant::never();
}

bool FeederFirmware::lose_master(Instant now, double flow_kg_per_h) {
  watchdog_at_ = Instant::never();
  if (master_lost_) return false;
  master_lost_ = true;
  schedule(now, running_ ? flow_kg_per_h : 0.0);
  return true;
}

void FeederFirmware::set_running(Instant now, bool running) {
  if (running == running_) return;
  running_ = running;
  schedule(now, running ? std::clamp(set_point_kg_per_h_, 0.0, settings_.max_flow_kg_per_h) : 0.0);
}

/// Changes the flow one latency after the next control cycle. What is the newest then wins.
void FeederFirmware::schedule(Instant now, double flow_kg_per_h) {
  const auto flow = static_cast<float>(quantise(flow_kg_per_h, settings_.flow_resolution_kg_per_h));
  if (flow == scheduled_kg_per_h_) return;
  scheduled_kg_per_h_ = flow;
  const Instant at = control_clock_.first_from(now) + settings_.latency;
  if (!pending_.empty() && (pending_.back().at == at || pending_.full())) {
    pending_.back().flow_kg_per_h = flow;
  } else {
    pending_.push_back({at, flow});
  }
}

std::uint8_t FeederFirmware::status() const {
  return static_cast<std::uint8_t>((flow_kg_per_h_ > 0 ? kDelivering : 0) | (master_lost_ ? kMasterLost : 0) |
                                   (cut_ ? kSetPointCut : 0) | (empty_ ? kHopperEmpty : 0) |
                                   (not_a_number_ ? kNotANumber : 0) | (refilling_ ? kRefilling : 0) |
                                   (volumetric_ ? kVolumetric : 0));
}

// --- the recording

std::span<const std::string_view> FeederFirmware::signal_names() {
  return kSignals;
}

void FeederFirmware::read_signals(std::span<double> values) const {
  values[0] = set_point_kg_per_h_;
  values[1] = static_cast<double>(flow_kg_per_h_);
  values[2] = filtered_kg_per_h_;
  values[3] = weight_kg_;
  values[4] = delivered_kg_;
  values[5] = master_lost_ ? 1 : 0;
  values[6] = volumetric_ ? 1 : 0;
}

}  // namespace meltbench::board
