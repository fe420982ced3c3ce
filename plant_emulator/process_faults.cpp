#include "plant_emulator/process_faults.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "plant_emulator/board/sampling.hpp"

namespace meltbench::emulator {

namespace {

using fault::Kind;
using fault::Target;

constexpr double kSecondsPerHour = 3600.0;
constexpr double kSecondsPerMinute = 60.0;
constexpr double kLoopBroken_Pa = -1e9;  // Far below and above the span of any transmitter: it cuts, and says so.
constexpr double kLoopShorted_Pa = 1e9;
constexpr double kOutside_degC = 23.0;  // A thermocouple that touches the frame of the machine.

constexpr std::size_t place_of(Sensor sensor, std::size_t channel = 0) {
  return static_cast<std::size_t>(sensor) + channel;
}
constexpr std::size_t place_of(Actuator actuator, std::size_t channel = 0) {
  return static_cast<std::size_t>(actuator) + channel;
}
constexpr std::size_t kFirstHeater = place_of(Actuator::kZone);

std::optional<std::size_t> find_sensor(std::string_view name) {
  if (name == "melt_pressure") return place_of(Sensor::kPressure);
  if (name == "melt_temperature") return place_of(Sensor::kMeltTemperature);
  if (name == "encoder") return place_of(Sensor::kEncoder);
  if (name == "front") return place_of(Sensor::kFront);
  if (name == "inlet_temperature") return place_of(Sensor::kInletTemperature);
  if (const auto channel = fault::channel_of(name)) return place_of(Sensor::kZone, *channel);
  return {};
}

std::optional<std::size_t> find_actuator(std::string_view name) {
  if (name == "feed") return place_of(Actuator::kFeed);
  if (name == "screw") return place_of(Actuator::kScrew);
  if (name == "inlet_flux") return place_of(Actuator::kInletFlux);
  if (const auto channel = fault::channel_of(name)) return place_of(Actuator::kZone, *channel);
  return {};
}

/// Of a parameter in the unit of the scenario, in that of the process.
double to_process_unit(std::size_t actuator, double value) {
  if (actuator == place_of(Actuator::kFeed)) return value / kSecondsPerHour;
  if (actuator == place_of(Actuator::kScrew)) return value / kSecondsPerMinute;
  return value;
}

/// Actuators of a board: first and one behind the last.
std::pair<std::size_t, std::size_t> actuators_of(config::BoardKind kind, std::size_t all) {
  switch (kind) {
    case config::BoardKind::kFeeder:
      return {place_of(Actuator::kFeed), place_of(Actuator::kFeed) + 1};
    case config::BoardKind::kScrewDrive:
      return {place_of(Actuator::kScrew), place_of(Actuator::kScrew) + 1};
    case config::BoardKind::kPreconditioner:
      return {place_of(Actuator::kInletFlux), place_of(Actuator::kInletFlux) + 1};
    case config::BoardKind::kHeater:
      return {kFirstHeater, all};
    default:
      return {0, 0};
  }
}

std::uint64_t spread(std::uint64_t seed, std::uint64_t other) {
  return seed ^ (other * 0x9e3779b97f4a7c15U);
}

}  // namespace

// --- begin and end

void ProcessFaults::begin(std::size_t number, const fault::Fault& fault) {
  if (fault.target == Target::kSensor) begin_sensor(number, fault);
  if (fault.target == Target::kActuator) begin_actuator(number, fault);
  if (fault.target == Target::kPlant) plants_.push_back({number, fault, now_});
  apply();
}

void ProcessFaults::begin_sensor(std::size_t number, const fault::Fault& fault) {
  const auto place = find_sensor(fault.object);
  if (!place) return;
  if (*place == place_of(Sensor::kEncoder) && !is_encoder_stuck()) encoder_held_rev_ = encoder_rev();
  sensors_.push_back({number, *place, fault, now_, spread(spread(seed_, fault.seed), number), {}, {}});
}

void ProcessFaults::begin_actuator(std::size_t number, const fault::Fault& fault) {
  if (const auto place = find_actuator(fault.object)) actuators_.push_back({number, *place, fault, given_[*place]});
}

void ProcessFaults::end(std::size_t number) {
  const bool was_stuck = is_encoder_stuck();
  std::erase_if(sensors_, [&](const SensorFault& one) { return one.number == number; });
  std::erase_if(actuators_, [&](const ActuatorFault& one) { return one.number == number; });
  std::erase_if(plants_, [&](const PlantFault& one) { return one.number == number; });
  // It counts on from where it was stuck.
  if (was_stuck && !is_encoder_stuck()) encoder_lost_rev_ = plant_.encoder_rev() - encoder_held_rev_;
  apply();
}

void ProcessFaults::apply() {
  hopper_empty_ = find(Kind::kHopperEmpty) != nullptr;
  update_plant();
  drive_all();
}

const ProcessFaults::PlantFault* ProcessFaults::find(fault::Kind kind) const {
  const auto found =
      std::find_if(plants_.begin(), plants_.end(), [&](const PlantFault& one) { return one.fault.kind() == kind; });
  return found == plants_.end() ? nullptr : &*found;
}

void ProcessFaults::update_plant() {
  Disturbance disturbance;
  if (const PlantFault* material = find(Kind::kMaterial)) {
    disturbance.viscosity_factor = material->fault.value("viscosity_factor");
    disturbance.density_factor = material->fault.value("density_factor");
    disturbance.melting_point_shift_K = material->fault.value("melting_point_shift_K");
  }
  if (const PlantFault* clog = find(Kind::kNozzleClog))
    disturbance.nozzle_open = 1.0 - clog->fault.value("closed_share");
  plant_.disturb(disturbance);
  if (!moves_by_itself()) {
    next_step_.reset();
  } else if (!next_step_) {
    next_step_ = now_ + kStep;
  }
}

bool ProcessFaults::moves_by_itself() const {
  return find(Kind::kScrewSurge) != nullptr ||
         std::any_of(actuators_.begin(), actuators_.end(),
                     [](const ActuatorFault& one) { return one.fault.kind() == Kind::kLagging; });
}

// --- time

void ProcessFaults::advance_to(Instant to) {
  plant_.advance_to(to);
  now_ = std::max(now_, to);
}

Instant ProcessFaults::next_touch(Instant until) const {
  return next_step_ && *next_step_ <= until ? *next_step_ : Instant::never();
}

void ProcessFaults::touch(Instant at) {
  next_step_ = at + kStep;
  for (ActuatorFault& one : actuators_) {
    if (one.fault.kind() != Kind::kLagging) continue;
    const double share = -std::expm1(-to_s(kStep) * 1e3 / one.fault.value("lag_ms"));
    one.held += (asked_[one.place] - one.held) * share;
    drive(one.place);
  }
  if (find(Kind::kScrewSurge) != nullptr) drive(place_of(Actuator::kScrew));
}

// --- sensors

double ProcessFaults::sense(std::size_t place, double truth) const {
  double value = truth;
  for (SensorFault& one : sensors_) {
    if (one.place == place) value = distort(one, value);
  }
  return value;
}

double ProcessFaults::distort(SensorFault& one, double value) const {
  const fault::Fault& fault = one.fault;
  const std::int64_t instant = now_.since_start.count();
  const bool is_loop = one.place == place_of(Sensor::kPressure);
  switch (fault.kind()) {
    case Kind::kStuck:
      if (!one.held) one.held = value;
      return *one.held;
    case Kind::kOffset:
      return value + fault.value("offset");
    case Kind::kDrift:
      return value + fault.value("drift") * to_s(now_ - one.began);
    case Kind::kNoise:
      return value + fault.value("noise") * board::calc_noise(one.seed, instant);
    case Kind::kSpike:
      return board::draw_at(one.seed, instant) < fault.value("share") ? value + fault.value("spike") : value;
    case Kind::kOpenCircuit:
      return is_loop ? kLoopBroken_Pa : kNothing;
    case Kind::kShortCircuit:
      return is_loop ? kLoopShorted_Pa : kOutside_degC;
    case Kind::kOutOfRange:
      return fault.value("value");
    case Kind::kDelayed: {
      if (one.seen.empty() || one.seen.back().at < now_) one.seen.push_back({now_, value});
      const Instant then = now_ - nanos_from_s(fault.value("delay_ms") * 1e-3);
      while (one.seen.size() > 1 && one.seen[1].at <= then) one.seen.pop_front();
      return one.seen.front().value;
    }
    default:
      return value;
  }
}

double ProcessFaults::pressure_Pa() const {
  return sense(place_of(Sensor::kPressure), plant_.pressure_Pa());
}

bool ProcessFaults::is_encoder_stuck() const {
  return std::any_of(sensors_.begin(), sensors_.end(),
                     [](const SensorFault& one) { return one.place == place_of(Sensor::kEncoder); });
}

double ProcessFaults::encoder_rev() const {
  return is_encoder_stuck() ? encoder_held_rev_ : plant_.encoder_rev() - encoder_lost_rev_;
}

double ProcessFaults::encoder_rev_per_s() const {
  return is_encoder_stuck() ? 0.0 : plant_.encoder_rev_per_s();
}

double ProcessFaults::front_m() {
  return sense(place_of(Sensor::kFront), plant_.front_m());
}

double ProcessFaults::T_inlet_degC() {
  return sense(place_of(Sensor::kInletTemperature), plant_.T_inlet_degC());
}

double ProcessFaults::T_melt_degC() {
  return sense(place_of(Sensor::kMeltTemperature), plant_.T_melt_degC());
}

double ProcessFaults::T_zone_degC(std::size_t channel) const {
  return sense(place_of(Sensor::kZone, channel), plant_.T_zone_degC(channel));
}

// --- actuators

void ProcessFaults::set_powered(config::BoardKind kind, bool on) {
  const auto [first, last] = actuators_of(kind, kActuators);
  for (std::size_t place = first; place < last; ++place) powered_[place] = on;
  drive_all();
}

void ProcessFaults::freeze(config::BoardKind kind, bool on) {
  const auto [first, last] = actuators_of(kind, kActuators);
  for (std::size_t place = first; place < last; ++place) frozen_[place] = on;
  drive_all();
}

/// What an actuator does of what it is asked for.
double ProcessFaults::limit(std::size_t place, double value) const {
  if (frozen_[place]) value = given_[place];
  if (!powered_[place]) value = 0.0;
  for (const ActuatorFault& one : actuators_) {
    if (one.place != place) continue;
    switch (one.fault.kind()) {
      case Kind::kStuck:
      case Kind::kLagging:
        value = one.held;
        break;
      case Kind::kSaturated:
        value = std::min(value, to_process_unit(place, one.fault.value("max")));
        break;
      case Kind::kDead:
        value = 0.0;
        break;
      case Kind::kWeldedOn:
        value = 1.0;
        break;
      default:
        break;
    }
  }
  // Before all bands: not even a welded relay gets past it.
  if (place >= kFirstHeater && !(heater_supply_ && powered_[place])) return 0.0;
  return value;
}

void ProcessFaults::set_heater_supply(bool closed) {
  if (std::exchange(heater_supply_, closed) != closed) drive_all();
}

double ProcessFaults::fed_kg_per_s(double asked_kg_per_s) const {
  const double given = given_[place_of(Actuator::kFeed)];
  return given == asked_[place_of(Actuator::kFeed)] ? asked_kg_per_s : given;
}

/// A board is heard even if it says the same again: plants go by the instants of what they are told.
void ProcessFaults::ask(std::size_t place, double value) {
  const bool again = value == asked_[place];
  asked_[place] = value;
  if (again && value == given_[place]) return give(place, value);
  drive(place);
}

void ProcessFaults::drive(std::size_t place) {
  if (std::isnan(asked_[place])) return;
  double value = limit(place, asked_[place]);
  if (place == place_of(Actuator::kFeed) && (hopper_empty_ || find(Kind::kFeederBridging) != nullptr)) value = 0.0;
  if (place == place_of(Actuator::kScrew)) {
    if (const PlantFault* surge = find(Kind::kScrewSurge)) {
      const double phase = surge->fault.value("w_rad_per_s") * to_s(now_ - surge->began);
      value *= 1.0 + surge->fault.value("eps") * std::sin(phase);
    }
  }
  if (value == given_[place]) return;
  given_[place] = value;
  give(place, value);
}

void ProcessFaults::give(std::size_t place, double value) {
  if (place == place_of(Actuator::kFeed)) return plant_.set_feed_kg_per_s(value);
  if (place == place_of(Actuator::kScrew)) return plant_.set_screw_rev_per_s(value);
  if (place >= kFirstHeater) plant_.set_heater(place - kFirstHeater, value);
}

void ProcessFaults::drive_all() {
  for (std::size_t place = 0; place < kActuators; ++place) {
    if (place != place_of(Actuator::kInletFlux)) drive(place);
  }
  drive_inlet();
}

void ProcessFaults::set_feed_kg_per_s(double feed_kg_per_s) {
  ask(place_of(Actuator::kFeed), feed_kg_per_s);
}

void ProcessFaults::set_screw_rev_per_s(double screw_rev_per_s) {
  ask(place_of(Actuator::kScrew), screw_rev_per_s);
}

void ProcessFaults::set_heater(std::size_t channel, double share) {
  ask(place_of(Actuator::kZone, channel), share);
}

void ProcessFaults::set_inlet(const plant::MeltInlet& inlet) {
  inlet_asked_ = inlet;
  drive_inlet();
}

/// The inlet closes a loop of its own inside the plant: what fails is its flux.
void ProcessFaults::drive_inlet() {
  constexpr std::size_t kPlace = place_of(Actuator::kInletFlux);
  if (!inlet_asked_) return;
  plant::MeltInlet inlet = *inlet_asked_;
  const auto pin = [&](double flux_W_per_m2) { inlet = plant::MeltInlet::flux(flux_W_per_m2); };
  if (!powered_[kPlace]) pin(0.0);
  if (frozen_[kPlace]) return;
  for (ActuatorFault& one : actuators_) {
    if (one.place != kPlace) continue;
    if (one.fault.kind() == Kind::kDead) pin(0.0);
    if (one.fault.kind() == Kind::kStuck) {
      if (one.held == 0.0) one.held = plant_.inlet_flux().now_W_per_m2;
      pin(one.held);
    }
    if (one.fault.kind() == Kind::kSaturated) {
      const double most = one.fault.value("max");
      inlet.min_W_per_m2 = std::max(inlet.min_W_per_m2, -most);
      inlet.max_W_per_m2 = std::min(inlet.max_W_per_m2, most);
    }
  }
  plant_.set_inlet(inlet);
}

}  // namespace meltbench::emulator
