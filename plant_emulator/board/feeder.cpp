#include "plant_emulator/board/feeder.hpp"

#include <cmath>

#include <fmt/format.h>

namespace meltbench::board {

namespace {

constexpr canopen::ObjectAddress kSetPoint{0x2000, 0};
constexpr canopen::ObjectAddress kWatchdog{0x2006, 0};
constexpr canopen::ObjectAddress kAutotare{0x6139, 1};
constexpr std::uint32_t kTareSignature = 0x61726174;  // "tara"
constexpr double kWeightCountsPerKg = 1e4;            // 6132:1 = 4 digits.
constexpr double kFlowCountsPerKgPerH = 1e3;          // 6132:2 = 3 digits.

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
      firmware_{settings, chance, process, *this} {
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

void Feeder::touch(Instant at) {
  firmware_.touch(at);
  invalidate();
}

void Feeder::on_hopper_empty(Instant at) {
  node().raise_emcy(kEmcyHopperEmpty, canopen::error_register::kGeneric | canopen::error_register::kManufacturer);
  report(Severity::kFault, at, "hopper-empty", "the hopper is empty, nothing is delivered");
}

void Feeder::on_refill(Instant at, bool begins) {
  if (begins) node().clear_emcy(kEmcyHopperEmpty);
  report(Severity::kInfo, at, begins ? "refill-begins" : "refill-ends",
         begins ? "refill valve opens, volumetric" : "refill valve closes");
}

// --- set points

void Feeder::take_set_point(Instant now) {
  const auto asked = static_cast<double>(set_point_.get());
  invalidate();
  // Neither says that a master is in control.
  if (!firmware_.check(asked) || lost_nodes_.any()) return;
  if (firmware_.take_set_point(now, asked, watchdog_ms_.get())) {
    node().clear_emcy(kEmcySetPointsLost);
    report(Severity::kInfo, now, "master-back", "set points come again");
  }
  own_deadline_ = firmware_.watchdog_at();
}

void Feeder::lose_master(Instant now, std::string_view why) {
  const double flow = std::clamp(static_cast<double>(on_loss_.get()), 0.0, firmware_.settings().max_flow_kg_per_h);
  const bool newly_lost = firmware_.lose_master(now, flow);
  own_deadline_ = firmware_.watchdog_at();
  if (!newly_lost) return;
  invalidate();
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
  if (address == kWatchdog) {
    firmware_.change_watchdog(now, watchdog_ms_.get());
    own_deadline_ = firmware_.watchdog_at();
  }
  if (address == kAutotare) tare_.set(static_cast<float>(firmware_.weight_kg()));
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
  if (kind == canopen::ResetKind::kCommunication) return;
  firmware_.power_up(now);
  own_deadline_ = firmware_.watchdog_at();
}

void Feeder::on_heartbeat(Instant now, const canopen::HeartbeatEvent& event) {
  const bool lost = event.change == canopen::HeartbeatChange::kLost;
  lost_nodes_.set(event.node, lost);
  if (lost) lose_master(now, fmt::format("heartbeat of node {} lost", event.node));
}

void Feeder::refresh(Instant now) {
  firmware_.move_to(now);
  const auto weight_kg = static_cast<float>(firmware_.weight_kg());
  delivered_.set(firmware_.flow_kg_per_h());
  age_.set(to_age(firmware_.flow_age(now), FeederFirmware::kAgeUnit));
  status_.set(firmware_.status());
  changes_.set(firmware_.changes());
  totalizer_.set(static_cast<float>(firmware_.totalizer_kg()));
  weight_pv_.set(weight_kg);
  net_weight_.set(weight_kg - tare_.get());
  weight_count_.set(to_count(firmware_.weight_kg(), kWeightCountsPerKg));
  flow_pv_.set(static_cast<float>(firmware_.measured_kg_per_h()));
  flow_count_.set(to_count(firmware_.measured_kg_per_h(), kFlowCountsPerKgPerH));
}

}  // namespace meltbench::board
