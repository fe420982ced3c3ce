#include "plant_emulator/board/feeder.hpp"

#include <cmath>

#include <fmt/format.h>

namespace meltbench::board {

namespace {

constexpr double kSecondsPerHour = 3600.0;
constexpr Nanos kAgeUnit = 10us;
constexpr std::size_t kMaxSetPointsUnderWay = 1024;
constexpr canopen::ObjectAddress kSetPoint{0x2000, 0};
constexpr canopen::ObjectAddress kWatchdog{0x2006, 0};
constexpr canopen::ObjectAddress kAutotare{0x6139, 1};
constexpr std::uint32_t kTareSignature = 0x61726174;  // "tara"
constexpr double kWeightCountsPerKg = 1e4;            // 6132:1 = 4 digits.
constexpr double kFlowCountsPerKgPerH = 1e3;          // 6132:2 = 3 digits.

constexpr std::array<std::string_view, 6> kSignals{"set_point_kg_per_h", "flow_kg_per_h", "measured_flow_kg_per_h",
                                                   "net_weight_kg",      "delivered_kg",  "master_lost"};

std::uint32_t to_us(Nanos span) {
  return static_cast<std::uint32_t>(span / 1us);
}

std::int32_t to_count(double value, double counts_per_unit) {
  return static_cast<std::int32_t>(std::clamp(std::round(value * counts_per_unit), -2147483648.0, 2147483647.0));
}

canopen::ObjectDictionary configure(const canopen::ObjectDictionary& eds, const FeederSettings& settings) {
  return with_defaults(eds,
                       {make_default(0x2000, 0, static_cast<float>(settings.start_flow_kg_per_h)),
                        make_default(0x2005, 0, static_cast<float>(settings.loss_of_master_kg_per_h)),
                        make_default(0x2006, 0, settings.watchdog_ms), make_default(0x2007, 0, to_us(settings.latency)),
                        make_default(0x2009, 0, static_cast<float>(settings.max_flow_kg_per_h)),
                        make_default(0x200A, 0, to_us(settings.sample_time)),
                        make_default(0x6114, 1, to_us(settings.weight_sample_time)),
                        make_default(0x6114, 2, to_us(settings.weight_sample_time))});
}

}  // namespace

Feeder::Feeder(std::string name, const canopen::ObjectDictionary& dictionary, std::uint8_t node_id,
               const FeederSettings& settings, Chance chance, Process& process)
    : Board{std::move(name), configure(dictionary, settings), node_id, process},
      settings_{settings},
      control_clock_{chance.draw_phase(settings.sample_time), settings.sample_time},
      weight_clock_{chance.draw_phase(settings.weight_sample_time), settings.weight_sample_time},
      noise_seed_{chance.draw_bits()},
      pending_{kMaxSetPointsUnderWay},
      hopper_kg_{settings.hopper_kg},
      weight_kg_{settings.hopper_kg} {
  canopen::ObjectDictionary& od = this->dictionary();
  set_point_ = od.bind<float>(0x2000);
  delivered_ = od.bind<float>(0x2001);
  age_ = od.bind<std::uint16_t>(0x2002);
  status_ = od.bind<std::uint8_t>(0x2003);
  changes_ = od.bind<std::uint8_t>(0x2004);
  on_loss_ = od.bind<float>(0x2005);
  watchdog_ms_ = od.bind<std::uint16_t>(0x2006);
  totalizer_ = od.bind<float>(0x2008);
  weight_pv_ = od.bind<float>(0x6130, 1);
  flow_pv_ = od.bind<float>(0x6130, 2);
  tare_ = od.bind<float>(0x6138, 1);
  net_weight_ = od.bind<float>(0x6140, 1);
  weight_status_ = od.bind<std::uint8_t>(0x6150, 1);
  flow_status_ = od.bind<std::uint8_t>(0x6150, 2);
  weight_count_ = od.bind<std::int32_t>(0x9130, 1);
  flow_count_ = od.bind<std::int32_t>(0x9130, 2);
  while (od.has_index(static_cast<std::uint16_t>(0x1600U + set_point_rpdos_.size()))) set_point_rpdos_.push_back(false);
}

// --- the process

Instant Feeder::next_touch(Instant until) const {
  Instant next = empty_at();
  if (!pending_.empty()) next = std::min(next, pending_.front().at);
  return next <= until ? next : Instant::never();
}

void Feeder::touch(Instant at) {
  move_to(at);
  if (!pending_.empty() && pending_.front().at <= at) {
    const Change change = pending_.front();
    pending_.pop_front();
    deliver(at, change.flow_kg_per_h);
  }
  if (!empty_ && flow_kg_per_h_ > 0 && hopper_kg_ <= 0) {
    empty_ = true;
    deliver(at, flow_kg_per_h_);
    node().raise_emcy(kEmcyHopperEmpty, canopen::error_register::kGeneric | canopen::error_register::kManufacturer);
    report(Severity::kFault, at, "hopper-empty", "the hopper is empty, nothing is delivered");
  }
}

void Feeder::deliver(Instant at, float flow_kg_per_h) {
  const float possible = empty_ ? 0.0F : flow_kg_per_h;
  if (possible != flow_kg_per_h_) {
    flow_kg_per_h_ = possible;
    changed_at_ = at;
    ++change_count_;
  }
  process().set_feed_kg_per_s(static_cast<double>(flow_kg_per_h_) / kSecondsPerHour);
  invalidate();
}

Instant Feeder::empty_at() const {
  if (empty_ || !(flow_kg_per_h_ > 0)) return Instant::never();
  const double left_s = hopper_kg_ / static_cast<double>(flow_kg_per_h_) * kSecondsPerHour;
  if (left_s > 1e9) return Instant::never();  // 30 years.
  return moved_to_ + nanos_from_s(std::max(left_s, 0.0));
}

/// Hopper, totalizer and flow filter over a time in which the flow is constant.
void Feeder::move_to(Instant at) {
  if (at <= moved_to_) return;
  sample_weight(at);
  const bool runs_empty = at >= empty_at();
  const double dt_s = to_s(at - moved_to_);
  const auto flow = static_cast<double>(flow_kg_per_h_);
  const double kg = std::min(flow / kSecondsPerHour * dt_s, hopper_kg_);
  hopper_kg_ -= kg;
  if (runs_empty) hopper_kg_ = 0;  // Without the rounding of the last nanosecond.
  delivered_kg_ += kg;
  filtered_kg_per_h_ = flow + (filtered_kg_per_h_ - flow) * std::exp(-dt_s / settings_.flow_filter_s);
  moved_to_ = at;
}

/// The newest weight that the scale has taken up to `until`; older ones nobody can read any more.
void Feeder::sample_weight(Instant until) {
  const Instant sample = weight_clock_.last_until(until);
  if (sample <= weighed_at_ || sample < moved_to_) return;
  const double since_s = to_s(sample - moved_to_);
  weight_kg_ = std::max(hopper_kg_ - static_cast<double>(flow_kg_per_h_) / kSecondsPerHour * since_s, 0.0);
  if (settings_.weight_noise_kg > 0) {
    weight_kg_ += settings_.weight_noise_kg * calc_noise(noise_seed_, weight_clock_.number_of(sample));
  }
  weight_kg_ = quantise(weight_kg_, settings_.weight_resolution_kg);
  weighed_at_ = sample;
}

// --- set points

void Feeder::take_set_point(Instant now) {
  const auto asked = static_cast<double>(set_point_.get());
  invalidate();
  not_a_number_ = !std::isfinite(asked);
  if (not_a_number_ || lost_nodes_.any()) return;  // Neither says that a master is in control.
  set_point_kg_per_h_ = asked;
  const double flow = std::clamp(asked, 0.0, settings_.max_flow_kg_per_h);
  cut_ = flow != asked;
  if (master_lost_) {
    master_lost_ = false;
    node().clear_emcy(kEmcySetPointsLost);
    report(Severity::kInfo, now, "master-back", "set points come again");
  }
  schedule(now, flow);
  const std::uint16_t watchdog_ms = watchdog_ms_.get();
  own_deadline_ = watchdog_ms != 0 ? now + watchdog_ms * 1ms : Instant::never();
}

/// Changes the flow one latency after the next control cycle. What is the newest then wins.
void Feeder::schedule(Instant now, double flow_kg_per_h) {
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

void Feeder::lose_master(Instant now, std::string_view why) {
  own_deadline_ = Instant::never();
  if (master_lost_) return;
  master_lost_ = true;
  invalidate();
  const double flow = std::clamp(static_cast<double>(on_loss_.get()), 0.0, settings_.max_flow_kg_per_h);
  schedule(now, flow);
  report(Severity::kWarning, now, "master-lost", fmt::format("{}: flow falls to {:.4g} kg/h", why, flow));
}

void Feeder::run_timers(Instant now) {
  if (now < own_deadline_) return;
  lose_master(now, fmt::format("no set point for {} ms", watchdog_ms_.get()));
  node().raise_emcy(kEmcySetPointsLost, canopen::error_register::kGeneric | canopen::error_register::kManufacturer);
}

// --- the bus

canopen::AbortCode Feeder::on_write(Instant /*now*/, const canopen::OdEntry& entry,
                                    std::span<const std::uint8_t> value) {
  if (entry.address() == kSetPoint && !std::isfinite(canopen::load<float>(value))) {
    return canopen::AbortCode::kInvalidValue;
  }
  if (entry.address() == kAutotare && canopen::load<std::uint32_t>(value) != kTareSignature) {
    return canopen::AbortCode::kInvalidValue;
  }
  return canopen::AbortCode::kNone;
}

void Feeder::on_written(Instant now, const canopen::OdEntry& entry) {
  invalidate();
  const canopen::ObjectAddress address = entry.address();
  if (address == kSetPoint) take_set_point(now);
  if (address == kWatchdog && own_deadline_ != Instant::never()) {
    own_deadline_ = watchdog_ms_.get() != 0 ? now + watchdog_ms_.get() * 1ms : Instant::never();
  }
  if (address == kAutotare) tare_.set(static_cast<float>(weight_kg_));
  if (address.index >= 0x1600 && address.index <= 0x17FF) find_set_point_rpdos();
}

void Feeder::on_rpdo(Instant now, unsigned number) {
  if (number <= set_point_rpdos_.size() && set_point_rpdos_[number - 1]) take_set_point(now);
}

void Feeder::find_set_point_rpdos() {
  for (unsigned i = 0; i < set_point_rpdos_.size(); ++i) set_point_rpdos_[i] = carries(i + 1, kSetPoint);
}

void Feeder::on_reset(Instant now, canopen::ResetKind kind) {
  find_set_point_rpdos();
  lost_nodes_.reset();
  if (kind != canopen::ResetKind::kCommunication) power_up(now);
}

void Feeder::power_up(Instant now) {
  move_to(now);
  while (!pending_.empty()) pending_.pop_front();
  master_lost_ = cut_ = not_a_number_ = false;
  own_deadline_ = Instant::never();
  const double flow = quantise(settings_.start_flow_kg_per_h, settings_.flow_resolution_kg_per_h);
  scheduled_kg_per_h_ = static_cast<float>(flow);
  set_point_kg_per_h_ = flow;
  if (now == Instant{}) {  // It has been so for as long as anyone can remember.
    flow_kg_per_h_ = scheduled_kg_per_h_;
    filtered_kg_per_h_ = flow;
  }
  deliver(now, scheduled_kg_per_h_);
}

void Feeder::on_heartbeat(Instant now, const canopen::HeartbeatEvent& event) {
  const bool lost = event.change == canopen::HeartbeatChange::kLost;
  lost_nodes_.set(event.node, lost);
  if (lost) lose_master(now, fmt::format("heartbeat of node {} lost", event.node));
}

std::uint8_t Feeder::status() const {
  return static_cast<std::uint8_t>((flow_kg_per_h_ > 0 ? kDelivering : 0) | (master_lost_ ? kMasterLost : 0) |
                                   (cut_ ? kSetPointCut : 0) | (empty_ ? kHopperEmpty : 0) |
                                   (not_a_number_ ? kNotANumber : 0));
}

void Feeder::refresh(Instant now) {
  move_to(now);
  delivered_.set(flow_kg_per_h_);
  age_.set(to_age(now - changed_at_, kAgeUnit));
  status_.set(status());
  changes_.set(change_count_);
  totalizer_.set(static_cast<float>(delivered_kg_));
  weight_pv_.set(static_cast<float>(weight_kg_));
  net_weight_.set(static_cast<float>(weight_kg_) - tare_.get());
  weight_count_.set(to_count(weight_kg_, kWeightCountsPerKg));
  flow_pv_.set(static_cast<float>(filtered_kg_per_h_));
  flow_count_.set(to_count(filtered_kg_per_h_, kFlowCountsPerKgPerH));
}

// --- the recording

std::span<const std::string_view> Feeder::signal_names() const {
  return kSignals;
}

void Feeder::read_signals(std::span<double> values) const {
  values[0] = set_point_kg_per_h_;
  values[1] = static_cast<double>(flow_kg_per_h_);
  values[2] = filtered_kg_per_h_;
  values[3] = weight_kg_;
  values[4] = delivered_kg_;
  values[5] = master_lost_ ? 1 : 0;
}

}  // namespace meltbench::board
