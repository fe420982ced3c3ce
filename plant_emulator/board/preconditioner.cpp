#include "plant_emulator/board/preconditioner.hpp"

#include <array>
#include <cmath>

#include <fmt/format.h>

namespace meltbench::board {

namespace {

constexpr canopen::ObjectAddress kSetPoint{0x6402, 1};
constexpr canopen::ObjectAddress kWatchdog{0x2006, 0};
constexpr double kSpanStart_degC = -50.0, kSpanEnd_degC = 400.0;
constexpr std::array<std::string_view, 7> kSignals{
    "T_ref_degC", "feedforward_W_per_m2", "reading_degC", "flux_W_per_m2", "mean_flux_W_per_m2", "mode", "master_lost"};

std::uint32_t to_us(Nanos span) {
  return static_cast<std::uint32_t>(span / 1us);
}

canopen::ObjectDictionary configure(const canopen::ObjectDictionary& eds, const PreconditionerSettings& settings) {
  return with_defaults(
      eds, {make_default(0x2004, 0, static_cast<float>(settings.min_flux_W_per_m2)),
            make_default(0x2005, 0, static_cast<float>(settings.max_flux_W_per_m2)),
            make_default(0x2006, 0, settings.watchdog_ms), make_default(0x2007, 0, to_us(settings.latency)),
            make_default(0x200A, 0, to_us(settings.sample_time)), make_default(0x6114, 1, to_us(settings.sample_time)),
            make_default(0x6148, 1, static_cast<float>(kSpanStart_degC)),
            make_default(0x6149, 1, static_cast<float>(kSpanEnd_degC))});
}

}  // namespace

Preconditioner::Preconditioner(std::string name, const canopen::ObjectDictionary& dictionary, std::uint8_t node_id,
                               const PreconditionerSettings& settings, Chance chance, Process& process)
    : Board{std::move(name), configure(dictionary, settings), node_id, process},
      settings_{settings},
      clock_{chance.draw_phase(settings.sample_time), settings.sample_time},
      noise_seed_{chance.draw_bits()},
      pending_{static_cast<std::size_t>(settings.latency / settings.sample_time) + 2} {
  canopen::ObjectDictionary& od = this->dictionary();
  feedforward_ = od.bind<float>(0x2000);
  gain_ = od.bind<float>(0x2001);
  mode_ = od.bind<std::uint8_t>(0x2002);
  min_flux_ = od.bind<float>(0x2004);
  max_flux_ = od.bind<float>(0x2005);
  watchdog_ms_ = od.bind<std::uint16_t>(0x2006);
  age_us_ = od.bind<std::uint16_t>(0x2010);
  state_ = od.bind<std::uint8_t>(0x2011);
  mean_flux_ = od.bind<float>(0x2012);
  field_ = od.bind<float>(0x6100, 1);
  pv_ = od.bind<float>(0x6130, 1);
  status_ = od.bind<std::uint8_t>(0x6150, 1);
  set_point_ = od.bind<float>(0x6402, 1);
  flux_now_ = od.bind<float>(0x6410, 1);
  while (od.has_index(static_cast<std::uint16_t>(0x1600U + set_point_rpdos_.size()))) set_point_rpdos_.push_back(false);
}

// --- the process

/// Every cycle, looked at or not: the process is solved from cycle to cycle, so how often somebody asks changes
/// nothing.
Instant Preconditioner::next_touch(Instant until) const {
  const Instant next = clock_.next_after(sampled_at_);
  return next <= until ? next : Instant::never();
}

void Preconditioner::touch(Instant at) {
  if (orders_waiting_) {
    orders_waiting_ = false;
    process().set_inlet(make_inlet());
  }
  make_available(at);
  pending_.push_back(measure(at));
  sampled_at_ = at;
  invalidate();
}

Preconditioner::Sample Preconditioner::measure(Instant at) {
  double T_degC = process().T_inlet_degC() + settings_.bias_K;
  if (settings_.noise_K > 0) T_degC += settings_.noise_K * calc_noise(noise_seed_, clock_.number_of(at));
  return {at, quantise(T_degC, settings_.resolution_K)};
}

void Preconditioner::make_available(Instant now) {
  while (!pending_.empty() && pending_.front().taken_at + settings_.latency <= now) {
    newest_ = pending_.front();
    pending_.pop_front();
  }
}

/// The loop regulates what the sensor says, so a bias of the sensor moves its reference.
plant::MeltInlet Preconditioner::make_inlet() const {
  const auto mode = master_lost_ ? InletMode::kOff : static_cast<InletMode>(mode_.get());
  plant::MeltInlet inlet;
  if (mode == InletMode::kFlux) inlet = plant::MeltInlet::flux(q_feedforward_);
  if (mode == InletMode::kLoop) {
    inlet = plant::MeltInlet::local_loop(q_feedforward_, gain_W_per_m2K_, T_reference_degC_ - settings_.bias_K);
  }
  inlet.min_W_per_m2 = static_cast<double>(min_flux_.get());
  inlet.max_W_per_m2 = static_cast<double>(max_flux_.get());
  return inlet;
}

// --- set points

void Preconditioner::take_orders(Instant now, bool is_set_point) {
  invalidate();
  const auto T_reference = static_cast<double>(set_point_.get());
  const auto feedforward = static_cast<double>(feedforward_.get());
  const auto gain = static_cast<double>(gain_.get());
  not_a_number_ = !(std::isfinite(T_reference) && std::isfinite(feedforward) && std::isfinite(gain) && gain >= 0);
  if (not_a_number_ || lost_nodes_.any()) return;  // Neither says that a master is in control.
  T_reference_degC_ = T_reference;
  q_feedforward_ = feedforward;
  gain_W_per_m2K_ = gain;
  orders_waiting_ = true;
  if (!is_set_point) return;
  if (master_lost_) {
    master_lost_ = false;
    node().clear_emcy(kEmcySetPointsLost);
    report(Severity::kInfo, now, "master-back", "set points come again");
  }
  own_deadline_ = watchdog_ms_.get() != 0 ? now + watchdog_ms_.get() * 1ms : Instant::never();
}

void Preconditioner::lose_master(Instant now, std::string_view why) {
  own_deadline_ = Instant::never();
  if (master_lost_) return;
  master_lost_ = true;
  orders_waiting_ = true;
  invalidate();
  report(Severity::kWarning, now, "master-lost", fmt::format("{}: the flux is 0", why));
}

void Preconditioner::run_timers(Instant now) {
  if (now < own_deadline_) return;
  lose_master(now, fmt::format("no set point for {} ms", watchdog_ms_.get()));
  node().raise_emcy(kEmcySetPointsLost, canopen::error_register::kGeneric | canopen::error_register::kManufacturer);
}

// --- the bus

canopen::AbortCode Preconditioner::on_write(Instant /*now*/, const canopen::OdEntry& entry,
                                            std::span<const std::uint8_t> value) {
  const bool is_real = entry.info().type == canopen::DataType::kReal32;
  if (is_real && !std::isfinite(canopen::load<float>(value))) return canopen::AbortCode::kInvalidValue;
  return canopen::AbortCode::kNone;
}

void Preconditioner::on_written(Instant now, const canopen::OdEntry& entry) {
  invalidate();
  const canopen::ObjectAddress address = entry.address();
  if (address == kWatchdog && own_deadline_ != Instant::never()) {
    own_deadline_ = watchdog_ms_.get() != 0 ? now + watchdog_ms_.get() * 1ms : Instant::never();
  } else if (address.index >= 0x1600 && address.index <= 0x17FF) {
    find_set_point_rpdos();
  } else if (address == kSetPoint || (address.index >= 0x2000 && address.index <= 0x2005)) {
    take_orders(now, false);  // A value written once is no sign of a living master.
  }
}

void Preconditioner::on_rpdo(Instant now, unsigned number) {
  take_orders(now, number <= set_point_rpdos_.size() && set_point_rpdos_[number - 1]);
}

void Preconditioner::find_set_point_rpdos() {
  for (unsigned i = 0; i < set_point_rpdos_.size(); ++i) set_point_rpdos_[i] = carries(i + 1, kSetPoint);
}

void Preconditioner::on_reset(Instant now, canopen::ResetKind kind) {
  invalidate();
  find_set_point_rpdos();
  lost_nodes_.reset();
  if (kind == canopen::ResetKind::kCommunication) return;
  while (!pending_.empty()) pending_.pop_front();
  master_lost_ = not_a_number_ = orders_waiting_ = false;
  own_deadline_ = Instant::never();
  T_reference_degC_ = q_feedforward_ = gain_W_per_m2K_ = 0;
  plant::MeltInlet inlet = make_inlet();
  inlet.feedforward_W_per_m2 = settings_.start_flux_W_per_m2;
  process().set_inlet(inlet);
  newest_ = measure(now);
  sampled_at_ = now;
}

void Preconditioner::on_heartbeat(Instant now, const canopen::HeartbeatEvent& event) {
  const bool lost = event.change == canopen::HeartbeatChange::kLost;
  lost_nodes_.set(event.node, lost);
  if (lost) lose_master(now, fmt::format("heartbeat of node {} lost", event.node));
}

void Preconditioner::on_sync(Instant now, std::uint8_t counter) {
  at_sync_before_ = at_sync_;
  at_sync_ = process().inlet_flux();
  if (now > synced_at_) {
    mean_flux_W_per_m2_ = (at_sync_.total_J_per_m2 - at_sync_before_.total_J_per_m2) / to_s(now - synced_at_);
  }
  synced_at_ = now;
  invalidate();
  Board::on_sync(now, counter);
}

std::uint8_t Preconditioner::state() const {
  const bool on = !master_lost_ && mode_.get() != static_cast<std::uint8_t>(InletMode::kOff);
  return static_cast<std::uint8_t>((on ? kInletOn : 0) | (master_lost_ ? kInletMasterLost : 0) |
                                   (at_sync_.at_min_s > at_sync_before_.at_min_s ? kInletAtMin : 0) |
                                   (at_sync_.at_max_s > at_sync_before_.at_max_s ? kInletAtMax : 0) |
                                   (not_a_number_ ? kInletNotANumber : 0));
}

std::uint8_t Preconditioner::status() const {
  if (std::isnan(newest_.T_degC)) return kNotValid;
  if (newest_.T_degC > kSpanEnd_degC) return kNotValid | kPositiveOverload;
  if (newest_.T_degC < kSpanStart_degC) return kNotValid | kNegativeOverload;
  return 0;
}

void Preconditioner::refresh(Instant now) {
  make_available(now);
  const double T_degC = std::isnan(newest_.T_degC) ? 0.0 : std::clamp(newest_.T_degC, kSpanStart_degC, kSpanEnd_degC);
  field_.set(static_cast<float>(T_degC));
  pv_.set(static_cast<float>(T_degC));
  status_.set(status());
  age_us_.set(to_age(now - newest_.taken_at, 1us));
  state_.set(state());
  mean_flux_.set(static_cast<float>(mean_flux_W_per_m2_));
  flux_now_.set(static_cast<float>(process().inlet_flux().now_W_per_m2));
}

// --- the recording

std::span<const std::string_view> Preconditioner::signal_names() const {
  return kSignals;
}

void Preconditioner::settle(Instant now) {
  make_available(now);
  settled_flux_W_per_m2_ = process().inlet_flux().now_W_per_m2;
}

void Preconditioner::read_signals(std::span<double> values) const {
  values[0] = T_reference_degC_;
  values[1] = q_feedforward_;
  values[2] = newest_.T_degC;
  values[3] = settled_flux_W_per_m2_;
  values[4] = mean_flux_W_per_m2_;
  values[5] = mode_.get();
  values[6] = master_lost_ ? 1 : 0;
}

}  // namespace meltbench::board
