#include "plant_emulator/model/extruder.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace meltbench::plant {

namespace {

constexpr double kLeastFilled_m = 1e-3;  // Temperatures are averaged over this at least.

ExtruderParameters checked(const ExtruderParameters& parameters) {
  parameters.check();
  return parameters;
}

MeltSteadyState calc_start(const ExtruderParameters& p) {
  return calc_melt_steady_state(p.polymer.melt, p.T_zone_start_degC, p.bizone.speed_m_per_s, p.start_front_m);
}

/// As it is at the start: at rest in production with the viscosities of then, else without anything under way.
BizoneParameters make_bizone(const ExtruderParameters& parameters) {
  BizoneParameters bizone = parameters.bizone;
  if (parameters.starts_cold) {
    bizone.U_before_start = bizone.U_before_start.value_or(0.0);
    return bizone;
  }
  MeltFront melt{parameters.polymer.melt, parameters.numerics};
  melt.start_steady(calc_start(parameters));
  const Viscosity& viscosity = parameters.polymer.viscosity;
  bizone.nozzle_kg *= viscosity.at_Pa_s(melt.mean_T_before_nozzle_degC(std::max(bizone.x0_m, kLeastFilled_m))) /
                      viscosity.at_Pa_s(melt.T_nozzle_degC());
  return bizone;
}

}  // namespace

void ExtruderParameters::set_polymer(const Polymer& of) {
  const double nozzle_flux = polymer.melt.nozzle_flux_W_per_m2;
  polymer = of;
  polymer.melt.nozzle_flux_W_per_m2 = nozzle_flux;
  polymer.melt.length_m = bizone.length_m;
  bizone.density_kg_per_m3 = of.melt.liquid.density_kg_per_m3;
  bizone.viscosity_Pa_s = of.viscosity.at_reference_Pa_s;
}

void ExtruderParameters::check() const {
  bizone.check();
  barrel.check();
  if (bizone.delay_reading != DelayReading::kTransport) {
    throw std::invalid_argument("extruder: delay_model = paper, must be transport: the melt conserves mass");
  }
  if (polymer.melt.length_m != bizone.length_m) {
    throw std::invalid_argument(fmt::format("extruder: the melt is {} m long, must be the barrel's {} m",
                                            polymer.melt.length_m, bizone.length_m));
  }
  const auto positive = [](std::string_view name, double value) {
    if (!(value > 0)) throw std::invalid_argument(fmt::format("extruder: {} = {}, must be > 0", name, value));
  };
  positive("clogging_m", clogging_m);
  if (!(throat_m >= 0 && throat_m < bizone.length_m)) {
    throw std::invalid_argument(fmt::format("extruder: throat_m = {}, must be in [0, {})", throat_m, bizone.length_m));
  }
}

Extruder::Extruder(const ExtruderParameters& parameters)
    : parameters_{checked(parameters)},
      nozzle_kg_{parameters.bizone.nozzle_kg},
      bizone_{make_bizone(parameters)},
      barrel_{parameters.barrel, parameters.barrel.T_ambient_degC},
      column_{parameters.polymer.melt, parameters.numerics},
      standing_{parameters.polymer.melt, parameters.throat_m, parameters.T_throat_degC,
                parameters.barrel.T_ambient_degC},
      screw_m_per_s_{parameters.starts_cold ? 0.0 : parameters.bizone.speed_m_per_s} {
  steel_.zone_count = barrel_.zone_count() - 1;
  if (parameters.starts_cold) {
    bizone_.set_speed_m_per_s(0.0);
    column_.hold(now());
  } else {
    const MeltSteadyState steady = calc_start(parameters);
    column_.melt().start_steady(steady);
    column_.set_inlet(MeltInlet::flux(steady.inlet_flux_W_per_m2));
    column_.place(now(), bizone_.conveyed_m());
    state_ = ExtruderState::kConveying;
    std::array<double, BarrelParameters::kMaxZones> T{}, heat{};
    T.fill(parameters.T_zone_start_degC);
    steel_.T_zone_degC.fill(parameters.T_zone_start_degC);
    exchange_heat();
    for (std::size_t i = 0; i < barrel_.zone_count(); ++i) heat[i] = barrel_.to_polymer_W(i);
    barrel_.start_at(T, heat);
  }
  for (std::size_t i = 0; i < steel_.zone_count; ++i) steel_.T_zone_degC[i] = barrel_.T_degC(i);
  update_melt_properties();
}

// --- time

void Extruder::advance_to(Instant to) {
  for (; next_tick_ <= to; next_tick_ += kThermalTick) {
    bizone_.advance_to(next_tick_);
    tick();
  }
  bizone_.advance_to(to);
}

void Extruder::tick() {
  solve_melt();
  solve_barrel();
  for (std::size_t i = 0; i < steel_.zone_count; ++i) steel_.T_zone_degC[i] = barrel_.T_degC(i);
  follow_screw();
  exchange_heat();
  update_melt_properties();
}

void Extruder::solve_melt() {
  if (state_ == ExtruderState::kConveying) {
    column_.catch_up(now(), bizone_.conveyed_m(), steel_);
  } else {
    standing_.advance(to_s(now() - standing_at_), steel_);
    standing_at_ = now();
  }
}

void Extruder::solve_barrel() {
  barrel_.advance(to_s(now() - barrel_at_));
  barrel_at_ = now();
}

/// Standing, blocked or conveying; the polymer changes hands accordingly. @pre solve_melt().
void Extruder::follow_screw() {
  const bool turns = screw_m_per_s_ >= kLeastSpeed_m_per_s;
  if (state_ == ExtruderState::kConveying && !turns) {
    standing_.take_over(column_.melt());
    standing_at_ = now();
    column_.hold(now());
    state_ = ExtruderState::kStanding;
  } else if (state_ != ExtruderState::kConveying && turns && standing_.can_start()) {
    standing_.hand_over(column_.melt());
    column_.place(now(), bizone_.conveyed_m());
    state_ = ExtruderState::kConveying;
  } else if (state_ != ExtruderState::kConveying) {
    state_ = turns ? ExtruderState::kBlocked : ExtruderState::kStanding;
  }
}

// --- couplings

/// Mean filling of a zone's part of the channel: 1 in the filled zone, u before it.
double Extruder::calc_fill(std::size_t zone, double x_m, double u) const {
  const double length = parameters_.polymer.melt.length_m;
  const double zone_length = length / static_cast<double>(steel_.zone_count);
  const double zone_end = zone_length * static_cast<double>(zone + 1);  // From the inlet.
  const double full = std::clamp(zone_end - (length - x_m), 0.0, zone_length) / zone_length;
  return full + (1 - full) * u;
}

/// (C1): what the zones give to the polymer until the next tick.
void Extruder::exchange_heat() {
  std::array<double, MeltBarrel::kMaxZones> heat_W_per_m2{};
  const bool conveys = state_ == ExtruderState::kConveying;
  if (conveys) {
    column_.melt().calc_barrel_heat_W_per_m2(steel_, heat_W_per_m2);
  } else {
    standing_.calc_barrel_heat_W_per_m2(steel_, heat_W_per_m2);
  }
  const BizoneOutputs out = bizone_.outputs();
  const MeltParameters& melt = parameters_.polymer.melt;
  const double area_m2 = parameters_.bizone.area_m2;
  const double molten_kg_per_s =
      conveys ? bizone_.parameters().mass_per_length_kg_per_m() * out.speed_m_per_s * out.U_at_interface : 0.0;
  for (std::size_t i = 0; i < steel_.zone_count; ++i) {
    const double sensible_W = heat_W_per_m2[i] * area_m2 * calc_fill(i, out.x_m, out.U_at_interface);
    const double latent_W =
        molten_kg_per_s * melt.heat_of_fusion_J_per_kg * steel_.share(i, column_.melt().front_m() / melt.length_m);
    barrel_.set_to_polymer_W(i, sensible_W + latent_W);
  }
  barrel_.set_to_polymer_W(steel_.zone_count, conveys ? melt.nozzle_flux_W_per_m2 * area_m2 : 0.0);
}

/// (C5), (C7): with eta_s for the viscosity and Kd opening eta_s/eta_n for the nozzle, (D4) has the theta2 of both
/// viscosities, and (D6) the pressure of the one in the nozzle.
void Extruder::update_melt_properties() {
  const double x = bizone_.x_m();
  const bool conveys = state_ == ExtruderState::kConveying;
  const double T_screw =
      conveys ? column_.melt().mean_T_before_nozzle_degC(std::max(x, kLeastFilled_m)) : T_nozzle_degC();
  const double eta_screw = parameters_.polymer.viscosity.at_Pa_s(T_screw);
  const double eta_nozzle = parameters_.polymer.viscosity.at_Pa_s(T_nozzle_degC());
  opening_ = 1;
  if (state_ == ExtruderState::kBlocked) opening_ = kLeastOpening;
  if (conveys) opening_ = std::clamp(1 + melt_margin_m() / parameters_.clogging_m, kLeastOpening, 1.0);
  // Frozen polymer has no viscosity to speak of: what counts then is the opening.
  const double ratio = conveys ? eta_screw / eta_nozzle : 1.0;
  const double eta = conveys ? eta_screw : parameters_.polymer.viscosity.at_reference_Pa_s;
  bizone_.set_viscosity_Pa_s(viscosity_factor_ * eta);
  bizone_.set_nozzle_kg(nozzle_kg_ * nozzle_open_ * opening_ * ratio);
}

double Extruder::melt_margin_m() const {
  const double molten_m = state_ == ExtruderState::kConveying
                              ? parameters_.polymer.melt.length_m - column_.front_m(now())
                              : standing_.molten_from_nozzle_m();
  return molten_m - bizone_.x_m();
}

// --- what drives it

void Extruder::set_screw_rev_per_s(double screw_rev_per_s) {
  solve_melt();
  screw_m_per_s_ = std::max(screw_rev_per_s * parameters_.bizone.pitch_m, 0.0);
  bizone_.set_screw_rev_per_s(screw_rev_per_s);
  const ExtruderState before = state_;
  follow_screw();
  if (state_ != before) {
    exchange_heat();
    update_melt_properties();
  }
}

void Extruder::set_inlet(const MeltInlet& inlet) {
  solve_melt();
  column_.set_inlet(inlet);
}

void Extruder::set_heater_W(std::size_t zone, double power_W) {
  if (zone >= barrel_.zone_count()) return;
  solve_barrel();
  barrel_.set_heater_W(zone, power_W);
}

void Extruder::change_polymer(const Polymer& polymer) {
  solve_melt();
  std::array<double, StandingPolymer::kCells> T{};
  const double length = parameters_.polymer.melt.length_m;
  for (std::size_t i = 0; i < T.size(); ++i) {
    T[i] = T_degC(length * (static_cast<double>(i) + 0.5) / static_cast<double>(T.size()));
  }
  const InletFlux flux = column_.flux(now());
  const MeltInlet inlet = column_.inlet();
  parameters_.set_polymer(polymer);
  bizone_.set_density_kg_per_m3(parameters_.bizone.density_kg_per_m3);
  standing_ = StandingPolymer{parameters_.polymer.melt, parameters_.throat_m, parameters_.T_throat_degC, 0.0};
  standing_.set_T_degC(T);
  standing_at_ = now();
  column_ = MeltColumn{parameters_.polymer.melt, parameters_.numerics};
  column_.set_inlet(inlet);
  column_.resume(now(), flux);
  state_ = ExtruderState::kStanding;
  follow_screw();
  exchange_heat();
  update_melt_properties();
}

void Extruder::disturb_nozzle(double viscosity_factor, double nozzle_open) {
  viscosity_factor_ = viscosity_factor;
  nozzle_open_ = nozzle_open;
  update_melt_properties();
}

// --- what shows

double Extruder::T_thermocouple_degC(std::size_t zone) {
  solve_barrel();
  return barrel_.T_thermocouple_degC(zone);
}

double Extruder::T_inlet_degC() {
  solve_melt();
  return T_degC(0.0);
}

double Extruder::front_m() {
  solve_melt();
  return front_estimate_m();
}

double Extruder::front_estimate_m() const {
  return state_ == ExtruderState::kConveying ? column_.front_m(now()) : standing_.front_m();
}

double Extruder::T_degC(double x_m) const {
  return state_ == ExtruderState::kConveying ? column_.melt().T_degC(x_m) : standing_.T_degC(x_m);
}

}  // namespace meltbench::plant
