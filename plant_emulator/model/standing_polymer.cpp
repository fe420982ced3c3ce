#include "plant_emulator/model/standing_polymer.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace meltbench::plant {

namespace {

constexpr double kMaxStep_s = 1.0;  // hbar/(rho c) is 0.05 1/s at most.

}  // namespace

StandingPolymer::StandingPolymer(const MeltParameters& parameters, double throat_m, double T_throat_degC, double T_degC)
    : parameters_{parameters},
      throat_m_{throat_m},
      T_throat_degC_{T_throat_degC},
      dx_m_{parameters.length_m / kCells},
      enthalpy_J_per_kg_(kCells) {
  const double enthalpy = enthalpy_of(T_degC, T_degC > parameters.T_melt_degC);
  std::fill(enthalpy_J_per_kg_.begin(), enthalpy_J_per_kg_.end(), enthalpy);
}

double StandingPolymer::T_of(double enthalpy_J_per_kg) const {
  const double dH = parameters_.heat_of_fusion_J_per_kg;
  if (enthalpy_J_per_kg < 0) {
    return parameters_.T_melt_degC + enthalpy_J_per_kg / parameters_.solid.heat_capacity_J_per_kgK;
  }
  if (enthalpy_J_per_kg <= dH) return parameters_.T_melt_degC;
  return parameters_.T_melt_degC + (enthalpy_J_per_kg - dH) / parameters_.liquid.heat_capacity_J_per_kgK;
}

double StandingPolymer::enthalpy_of(double T_degC, bool is_melt) const {
  const double above_K = T_degC - parameters_.T_melt_degC;
  if (!is_melt) return above_K * parameters_.solid.heat_capacity_J_per_kgK;
  return parameters_.heat_of_fusion_J_per_kg + above_K * parameters_.liquid.heat_capacity_J_per_kgK;
}

double StandingPolymer::melt_share(double enthalpy_J_per_kg) const {
  return std::clamp(enthalpy_J_per_kg / parameters_.heat_of_fusion_J_per_kg, 0.0, 1.0);
}

void StandingPolymer::set_T_degC(std::span<const double> T_degC) {
  for (std::size_t i = 0; i < kCells; ++i) {
    enthalpy_J_per_kg_[i] = enthalpy_of(T_degC[i], T_degC[i] > parameters_.T_melt_degC);
  }
}

void StandingPolymer::take_over(const MeltFront& melt) {
  for (std::size_t i = 0; i < kCells; ++i) {
    const double x = x_of(i);
    enthalpy_J_per_kg_[i] = enthalpy_of(melt.T_degC(x), x > melt.front_m());
  }
  // The cell with the front in it is partly molten.
  const double place = melt.front_m() / dx_m_;
  const auto cell = std::min(static_cast<std::size_t>(std::max(place, 0.0)), kCells - 1);
  enthalpy_J_per_kg_[cell] =
      parameters_.heat_of_fusion_J_per_kg * std::clamp(static_cast<double>(cell + 1) - place, 0.0, 1.0);
}

void StandingPolymer::hand_over(MeltFront& melt) const {
  const double front_m = std::clamp(solid_m(), 2 * MeltFront::kMinLength_m, parameters_.length_m - 0.5 * kLeastMelt_m);
  std::vector<double> T(kCells + 1);
  for (std::size_t i = 0; i <= kCells; ++i) T[i] = T_degC(parameters_.length_m * static_cast<double>(i) / kCells);
  melt.start_profile(front_m, T);
}

double StandingPolymer::heat_W_per_m3(std::size_t cell, const MeltBarrel& barrel) const {
  const double x = x_of(cell);
  const double enthalpy = enthalpy_J_per_kg_[cell];
  const double T_b = x < throat_m_ ? T_throat_degC_ : barrel.T_degC(x / parameters_.length_m);
  const double share = melt_share(enthalpy);
  const double hbar =
      parameters_.solid.barrel_exchange_W_per_m3K +
      share * (parameters_.liquid.barrel_exchange_W_per_m3K - parameters_.solid.barrel_exchange_W_per_m3K);
  return hbar * (T_b - T_of(enthalpy));
}

void StandingPolymer::advance(double dt_s, const MeltBarrel& barrel) {
  if (!(dt_s > 0)) return;
  const int steps = static_cast<int>(std::ceil(dt_s / kMaxStep_s));
  const double per_mass = dt_s / steps / parameters_.solid.density_kg_per_m3;
  for (int step = 0; step < steps; ++step) {
    for (std::size_t i = 0; i < kCells; ++i) enthalpy_J_per_kg_[i] += per_mass * heat_W_per_m3(i, barrel);
  }
}

double StandingPolymer::molten_from_nozzle_m() const {
  double length = 0;
  for (std::size_t i = kCells; i-- > 0 && melt_share(enthalpy_J_per_kg_[i]) > 0.5;) length += dx_m_;
  return length;
}

double StandingPolymer::solid_m() const {
  double length = 0;
  for (const double enthalpy : enthalpy_J_per_kg_) length += dx_m_ * (1.0 - melt_share(enthalpy));
  return length;
}

double StandingPolymer::front_m() const {
  const double molten = molten_from_nozzle_m();
  if (molten <= 0 || molten >= parameters_.length_m - 0.5 * dx_m_) return std::numeric_limits<double>::quiet_NaN();
  return parameters_.length_m - molten;
}

double StandingPolymer::T_degC(double x_m) const {
  const double place = std::clamp(x_m / dx_m_ - 0.5, 0.0, static_cast<double>(kCells - 1));
  const auto left = std::min(static_cast<std::size_t>(place), kCells - 2);
  const double share = place - static_cast<double>(left);
  return (1 - share) * T_of(enthalpy_J_per_kg_[left]) + share * T_of(enthalpy_J_per_kg_[left + 1]);
}

void StandingPolymer::calc_barrel_heat_W_per_m2(const MeltBarrel& barrel, std::span<double> heat_W_per_m2) const {
  std::fill(heat_W_per_m2.begin(), heat_W_per_m2.end(), 0.0);
  for (std::size_t i = 0; i < kCells; ++i) {
    const double x = x_of(i);
    if (x < throat_m_) continue;
    const double heat = dx_m_ * heat_W_per_m3(i, barrel);
    for (std::size_t zone = 0; zone < barrel.zone_count && zone < heat_W_per_m2.size(); ++zone) {
      heat_W_per_m2[zone] += heat * barrel.share(zone, x / parameters_.length_m);
    }
  }
}

}  // namespace meltbench::plant
