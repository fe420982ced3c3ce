#include "controller/machine/zone_control.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "controller/machine/boot_plan.hpp"
#include "controller/machine/objects.hpp"

namespace meltbench::machine {

namespace {

constexpr double kTenth = 0.1;         // Temperatures on the wire are in 0.1 °C,
constexpr double kPerThousand = 1e-3;  // outputs in 0.1 % of full power.
constexpr std::size_t kBarrelChannels = 4;

}  // namespace

ZoneControl::ZoneControl(const ControllerSettings& settings)
    : settings_{*settings.zones},
      node_id_{settings.board(config::BoardKind::kHeater).node_id},
      syncs_per_report_{calc_syncs_per_zone_report(settings.sync_period)} {
  for (const ZoneSettings::Zone& zone : settings_.zones) {
    zones_.push_back({.set = zone, .watch = safety::ZoneWatch{settings_.limits}, .report = {}, .reported_at = {}});
    if (settings.board(config::BoardKind::kHeater).is_on_line()) {
      serial_.push_back(std::make_unique<SerialZone>(settings, zone.channel));
    }
  }
}

ZoneControl::Zone* ZoneControl::find(std::size_t channel) {
  const auto found =
      std::find_if(zones_.begin(), zones_.end(), [&](const Zone& zone) { return zone.set.channel == channel; });
  return found == zones_.end() ? nullptr : &*found;
}

void ZoneControl::take_temperature(std::size_t channel, const can::CanFrame& frame, bool second, Instant now) {
  Zone* zone = find(channel);
  const auto report = parse_zone(frame, second);
  if (zone == nullptr || !report) return;
  zone->report.T_degC = kTenth * report->T_0p1degC;
  zone->report.sensor_good = report->status == 0;
  zone->fresh = zone->seen = true;
  zone->reported_at = now;
  tuning_.note(channel, report->state);
}

void ZoneControl::take_output(std::size_t channel, const can::CanFrame& frame, std::size_t byte) {
  Zone* zone = find(channel);
  const auto output = parse_output(frame, byte);
  if (zone != nullptr && output) zone->report.output = kPerThousand * *output;
}

bool ZoneControl::take(const can::CanFrame& frame, Instant now) {
  using canopen::cob_id::tpdo;
  if (frame.id == tpdo(heater_object::kFirstPairTpdo, node_id_)) {
    take_temperature(1, frame, false, now);
    take_temperature(2, frame, true, now);
  } else if (frame.id == tpdo(heater_object::kSecondPairTpdo, node_id_)) {
    take_temperature(3, frame, false, now);
    take_temperature(4, frame, true, now);
  } else if (frame.id == tpdo(heater_object::kOutputTpdo, node_id_)) {
    for (std::size_t i = 0; i < kBarrelChannels; ++i) take_output(i + 1, frame, 2 * i);
  } else if (frame.id == tpdo(heater_object::kNozzleTpdo, node_id_)) {
    take_temperature(kNozzleChannel, frame, false, now);
    take_output(kNozzleChannel, frame, 4);
  } else {
    return false;
  }
  return true;
}

std::string ZoneControl::name_of(const Zone& zone) {
  return zone.set.channel == kNozzleChannel ? "nozzle" : fmt::format("zone {}", zone.set.channel);
}

void ZoneControl::take_serial_reports() {
  for (std::size_t i = 0; i < serial_.size(); ++i) {
    const auto report = serial_[i]->take_report();
    if (!report) continue;
    zones_[i].report = report->zone;
    zones_[i].fresh = zones_[i].seen = true;
    zones_[i].reported_at = report->at;
  }
}

std::optional<Trouble> ZoneControl::judge(Instant now, Instant ready_at) {
  take_serial_reports();
  for (Zone& zone : zones_) {
    const Nanos age = now - std::max(zone.reported_at, ready_at);
    if (age > settings_.timeout) {
      return Trouble{"zone-stale",
                     fmt::format("{}: no report for {:.3g} s, limit {:.3g} s; are the heater's reports lost?",
                                 name_of(zone), to_s(age), to_s(settings_.timeout))};
    }
    if (!zone.fresh) continue;
    zone.fresh = false;
    std::optional<double> set_point;
    if (released_) set_point = zone.set.set_degC;
    const safety::ZoneTrip why = zone.watch.add(now, zone.report, set_point);
    if (why != safety::ZoneTrip::kNone) {
      return Trouble{safety::code_of(why), safety::describe(why, zone.watch, name_of(zone), zone.report)};
    }
  }
  return {};
}

void ZoneControl::tell(Instant now, Outbox& out) {
  for (std::size_t i = 0; i < serial_.size(); ++i) serial_[i]->want(now, zones_[i].set.set_degC, released_);
  if (!serial_.empty()) return;
  if (released_ == told_released_ && syncs_until_told_ > 0) {
    --syncs_until_told_;
    return;
  }
  syncs_until_told_ = syncs_per_report_ - 1;
  told_released_ = released_;
  std::array<std::int16_t, kBarrelChannels> barrel{};
  std::int16_t nozzle = 0;
  unsigned release = 0;
  for (const Zone& zone : zones_) {
    const auto counts = static_cast<std::int16_t>(std::lround(zone.set.set_degC / kTenth));
    (zone.set.channel == kNozzleChannel ? nozzle : barrel.at(zone.set.channel - 1)) = counts;
    if (released_) release |= 1U << (zone.set.channel - 1);
  }
  // Without a release no set points either: if the release is lost on its way, the board's watchdog has nothing to live
  // on.
  if (released_) out.send(make_zone_set_points(node_id_, barrel));
  out.send(make_zone_release(node_id_, nozzle, static_cast<std::uint8_t>(release)));
}

void ZoneControl::set_barrel(double T_degC) {
  for (Zone& zone : zones_) {
    if (zone.set.channel != kNozzleChannel) zone.set.set_degC = T_degC;
  }
}

bool ZoneControl::is_warm() const {
  return std::all_of(zones_.begin(), zones_.end(), [&](const Zone& zone) {
    return zone.seen && zone.report.sensor_good && std::abs(zone.report.T_degC - zone.set.set_degC) <= settings_.band_K;
  });
}

std::optional<double> ZoneControl::T_barrel_degC() const {
  double sum = 0.0;
  int count = 0;
  for (const Zone& zone : zones_) {
    if (zone.set.channel == kNozzleChannel) continue;
    if (!zone.seen || !zone.report.sensor_good) return {};
    sum += zone.report.T_degC;
    ++count;
  }
  if (count == 0) return {};
  return sum / count;
}

std::optional<double> ZoneControl::T_coldest_beyond_degC(double share) const {
  std::size_t barrel_zones = 0;
  for (const Zone& zone : zones_) barrel_zones += zone.set.channel == kNozzleChannel ? 0U : 1U;
  std::optional<double> coldest;
  for (const Zone& zone : zones_) {
    const bool touches_melt = zone.set.channel != kNozzleChannel &&
                              static_cast<double>(zone.set.channel) > share * static_cast<double>(barrel_zones);
    if (!touches_melt || !zone.seen || !zone.report.sensor_good) continue;
    coldest = std::min(coldest.value_or(zone.report.T_degC), zone.report.T_degC);
  }
  return coldest;
}

}  // namespace meltbench::machine
