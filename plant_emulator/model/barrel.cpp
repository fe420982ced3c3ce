#include "plant_emulator/model/barrel.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace meltbench::plant {

namespace {

void require(bool holds, std::string_view name, std::size_t zone, double value, std::string_view range) {
  if (!holds)
    throw std::invalid_argument(fmt::format("barrel zone {}: {} = {}, must be {}", zone + 1, name, value, range));
}

BarrelParameters checked(const BarrelParameters& parameters) {
  parameters.check();
  return parameters;
}

}  // namespace

BarrelParameters BarrelParameters::with_zones(std::size_t barrel_zones) {
  BarrelParameters p;
  p.zone_count = barrel_zones + 1;
  if (p.zone_count > kMaxZones)
    throw std::invalid_argument(fmt::format("barrel: {} zones, must be 1..4", barrel_zones));
  HeatedZone& nozzle = p.zones[barrel_zones];
  nozzle.heat_capacity_J_per_K /= 3;
  nozzle.to_ambient_W_per_K /= 3;
  nozzle.max_power_W /= 3;
  return p;
}

void BarrelParameters::check() const {
  if (zone_count < 2 || zone_count > kMaxZones) {
    throw std::invalid_argument(fmt::format("barrel: {} zones with the nozzle, must be 2..{}", zone_count, kMaxZones));
  }
  for (std::size_t i = 0; i < zone_count; ++i) {
    const HeatedZone& zone = zones[i];
    require(zone.heat_capacity_J_per_K > 0, "heat_capacity_J_per_K", i, zone.heat_capacity_J_per_K, "> 0");
    require(zone.to_ambient_W_per_K >= 0, "to_ambient_W_per_K", i, zone.to_ambient_W_per_K, ">= 0");
    require(zone.to_next_W_per_K >= 0, "to_next_W_per_K", i, zone.to_next_W_per_K, ">= 0");
    require(zone.heater_lag_s >= 1, "heater_lag_s", i, zone.heater_lag_s, ">= 1");
    require(zone.thermocouple_lag_s >= 1, "thermocouple_lag_s", i, zone.thermocouple_lag_s, ">= 1");
    require(zone.max_power_W >= 0, "max_power_W", i, zone.max_power_W, ">= 0");
  }
}

Barrel::Barrel(const BarrelParameters& parameters, double T_degC) : parameters_{checked(parameters)} {
  state_.T_degC.fill(T_degC);
  state_.Y_degC.fill(T_degC);
  stored_at_start_J_ = stored_J();
}

void Barrel::start_at(std::span<const double> T_degC, std::span<const double> to_polymer_W) {
  for (std::size_t i = 0; i < zone_count(); ++i) {
    state_.T_degC[i] = state_.Y_degC[i] = T_degC[i];
    to_polymer_W_[i] = to_polymer_W[i];
    state_.P_W[i] = 0;
  }
  const State rate = calc_rate(state_);  // Without heaters: what they must make good.
  for (std::size_t i = 0; i < zone_count(); ++i) {
    const HeatedZone& zone = parameters_.zones[i];
    state_.P_W[i] = std::clamp(-rate.T_degC[i] * zone.heat_capacity_J_per_K, 0.0, zone.max_power_W);
    heater_W_[i] = state_.P_W[i];
  }
  stored_at_start_J_ = stored_J();
}

void Barrel::set_heater_W(std::size_t zone, double power_W) {
  heater_W_[zone] = std::clamp(power_W, 0.0, parameters_.zones[zone].max_power_W);
}

void Barrel::advance(double dt_s) {
  if (!(dt_s > 0)) return;
  const int steps = static_cast<int>(std::ceil(dt_s / kMaxStep_s - 1e-9));
  for (int i = 0; i < steps; ++i) step(dt_s / steps);
}

Barrel::State Barrel::calc_rate(const State& state) const {
  State rate;
  const std::size_t n = zone_count();
  for (std::size_t i = 0; i < n; ++i) {
    const HeatedZone& zone = parameters_.zones[i];
    const double loss_W = zone.to_ambient_W_per_K * (state.T_degC[i] - parameters_.T_ambient_degC);
    double net_W = state.P_W[i] - loss_W - to_polymer_W_[i];
    if (i + 1 < n) net_W -= zone.to_next_W_per_K * (state.T_degC[i] - state.T_degC[i + 1]);
    if (i > 0) net_W -= parameters_.zones[i - 1].to_next_W_per_K * (state.T_degC[i] - state.T_degC[i - 1]);
    rate.T_degC[i] = net_W / zone.heat_capacity_J_per_K;                             // (C1)
    rate.P_W[i] = (heater_W_[i] - state.P_W[i]) / zone.heater_lag_s;                 // (C2)
    rate.Y_degC[i] = (state.T_degC[i] - state.Y_degC[i]) / zone.thermocouple_lag_s;  // (C3)
    rate.lost_J += loss_W;
  }
  return rate;
}

void Barrel::step(double dt_s) {
  const std::size_t n = zone_count();
  const auto at = [n](const State& from, const State& rate, double dt) {
    State to = from;
    for (std::size_t i = 0; i < n; ++i) {
      to.T_degC[i] += dt * rate.T_degC[i];
      to.P_W[i] += dt * rate.P_W[i];
      to.Y_degC[i] += dt * rate.Y_degC[i];
    }
    to.lost_J += dt * rate.lost_J;
    return to;
  };
  const State k1 = calc_rate(state_);
  const State k2 = calc_rate(at(state_, k1, 0.5 * dt_s));
  const State k3 = calc_rate(at(state_, k2, 0.5 * dt_s));
  const State k4 = calc_rate(at(state_, k3, dt_s));
  state_ = at(at(at(at(state_, k1, dt_s / 6), k2, dt_s / 3), k3, dt_s / 3), k4, dt_s / 6);
  for (std::size_t i = 0; i < n; ++i) {
    heated_J_ += dt_s * heater_W_[i];
    to_polymer_J_ += dt_s * to_polymer_W_[i];
  }
}

double Barrel::stored_J() const {
  double stored = 0;
  for (std::size_t i = 0; i < zone_count(); ++i) {
    const HeatedZone& zone = parameters_.zones[i];
    stored += zone.heat_capacity_J_per_K * state_.T_degC[i] + zone.heater_lag_s * state_.P_W[i];
  }
  return stored;
}

double Barrel::energy_residual_J() const {
  return stored_J() - stored_at_start_J_ - (heated_J_ - state_.lost_J - to_polymer_J_);
}

}  // namespace meltbench::plant
