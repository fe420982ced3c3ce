#include "plant_emulator/model/melt_front.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <stdexcept>

#include "plant_emulator/model/melt_grid.hpp"

namespace meltbench::plant {
namespace {

// Grading at the reference number of cells; other numbers refine all cells alike, so the order of a scheme shows.
constexpr double kSolidReferenceCells = 100.0;
constexpr double kLiquidReferenceCells = 40.0;
constexpr double kEndCell = 0.15;  // In units of α/b: resolves the thermal layers at inlet, front and nozzle.
constexpr double kSolidGrowth = 1.3;
constexpr double kLiquidGrowth = 1.6;
constexpr double kJoint_m = 1e-3;  // Over which a given profile is joined to T_m at the front.
// Of b or of the front's own speed. What is left of a step's mismatch is put right in the next step's first guess, so
// it does not add up, and it vanishes at rest. While the front accelerates, 1e-4 of b is 10 nm per step.
constexpr double kSpeedTolerance = 1e-4;
constexpr double kMinSpeedTolerance_m_per_s = 1e-9;
// (M17): 1 - 1/√2 makes two equal stages with √2 of the first between them second order and L-stable.
constexpr double kStage = 1.0 - 0.5 * std::numbers::sqrt2;
constexpr int kTwoStageLengths = 5;  // Two stages reach as far as five Euler steps at no more error.
// Of the inlet in a first stage. Two stages overshoot a jump by a quarter of it; Euler steps do not.
constexpr double kJump_K = 1.0;
constexpr double kMinResidualSlope = 0.05;  // 1 + St; below this the front speed runs away (20.6 K superheat).

std::vector<double> make_phase_nodes(const MeltParameters& parameters, const MeltPhase& phase, double speed_m_per_s,
                                     std::size_t cells, double reference_cells, double growth) {
  if (!(speed_m_per_s > 0.0)) {
    throw std::invalid_argument(fmt::format("melt front: grid speed = {} m/s, must be > 0", speed_m_per_s));
  }
  const double coarseness = reference_cells / static_cast<double>(cells);
  const double layer = phase.diffusivity_m2_per_s() / speed_m_per_s;
  const double end_cell = kEndCell * coarseness * layer / (0.5 * parameters.length_m);
  return make_graded_nodes(cells, std::min(end_cell, 0.5), std::pow(growth, coarseness));
}

std::unique_ptr<MeltSolid> make_solid(const MeltParameters& parameters, const MeltNumerics& numerics) {
  if (numerics.solid == MeltDiscretisation::kCoarseTwoPointSlope) {
    return make_coarse_two_point_solid(parameters, numerics.solid_cells);
  }
  auto nodes = make_phase_nodes(parameters, parameters.solid, numerics.grid_speed_m_per_s, numerics.solid_cells,
                                kSolidReferenceCells, kSolidGrowth);
  return numerics.solid == MeltDiscretisation::kThirdOrderUpwind
             ? make_third_order_solid(parameters, std::move(nodes))
             : make_scharfetter_gummel_solid(parameters, std::move(nodes));
}

double weighted_sum(std::span<const double> weights, std::span<const double> values) {
  double even = 0.0, odd = 0.0;  // Two sums: one would wait for each addition.
  const std::size_t pairs = weights.size() / 2;
  for (std::size_t i = 0; i < pairs; ++i) {
    even += weights[2 * i] * values[2 * i];
    odd += weights[2 * i + 1] * values[2 * i + 1];
  }
  if (weights.size() % 2 == 1) even += weights.back() * values.back();
  return even + odd;
}

/// Linear interpolation of a field given on nodes of [0, 1].
double interpolate(std::span<const double> nodes, std::span<const double> values, double at) {
  if (at <= 0.0) return values.front();
  if (at >= 1.0) return values.back();
  const auto right = static_cast<std::size_t>(std::upper_bound(nodes.begin(), nodes.end(), at) - nodes.begin());
  const double share = (at - nodes[right - 1]) / (nodes[right] - nodes[right - 1]);
  return values[right - 1] + share * (values[right] - values[right - 1]);
}

}  // namespace

MeltFront::MeltFront(const MeltParameters& parameters, const MeltNumerics& numerics)
    : parameters_{parameters},
      numerics_{numerics},
      solid_{make_solid(parameters, numerics)},
      liquid_{parameters, make_phase_nodes(parameters, parameters.liquid, numerics.grid_speed_m_per_s,
                                           numerics.liquid_cells, kLiquidReferenceCells, kLiquidGrowth)} {
  if (!(numerics.max_travel_m > 0.0 && numerics.max_step_s > 0.0)) {
    throw std::invalid_argument(
        fmt::format("melt front: steps of {} m and {} s, must be > 0", numerics.max_travel_m, numerics.max_step_s));
  }
  start_linear(0.5 * parameters.length_m, parameters.T_melt_degC);
}

void MeltFront::start_linear(double front_m, double T_inlet_degC) {
  restart(front_m);
  std::vector<double> T;
  for (const double xi : solid_nodes()) T.push_back(T_inlet_degC + (parameters_.T_melt_degC - T_inlet_degC) * xi);
  solid_->set_T_degC(T);
  T.clear();
  const double slope = parameters_.nozzle_flux_W_per_m2 / parameters_.liquid.conductivity_W_per_mK;
  const double length = parameters_.length_m - front_m;
  for (const double eta : liquid_nodes()) T.push_back(parameters_.T_melt_degC + slope * length * eta);
  liquid_.set_T_degC(T);
  energy_at_start_m_ = energy_content_m();
}

void MeltFront::start_steady(const MeltSteadyState& steady) {
  restart(steady.front_m);
  std::vector<double> T;
  for (const double xi : solid_nodes()) T.push_back(steady.T_solid_degC(steady.front_m * xi));
  T.back() = parameters_.T_melt_degC;
  solid_->set_T_degC(T);
  T.clear();
  const double length = parameters_.length_m - steady.front_m;
  for (const double eta : liquid_nodes()) T.push_back(steady.T_liquid_degC(steady.front_m + length * eta));
  T.front() = parameters_.T_melt_degC;
  liquid_.set_T_degC(T);
  solid_front_flux_ = liquid_front_flux_ = steady.front_flux_W_per_m2;
  inlet_flux_ = mean_inlet_flux_ = steady.inlet_flux_W_per_m2;
  energy_at_start_m_ = energy_content_m();
}

void MeltFront::start_profile(double front_m, std::span<const double> T_degC) {
  restart(front_m);
  if (T_degC.size() < 2) throw std::invalid_argument("melt front: a profile needs two temperatures");
  const auto at = [&](double x_m) {
    const double place = x_m / parameters_.length_m * static_cast<double>(T_degC.size() - 1);
    const auto left = std::min(static_cast<std::size_t>(place), T_degC.size() - 2);
    const double share = place - static_cast<double>(left);
    return (1.0 - share) * T_degC[left] + share * T_degC[left + 1];
  };
  // A step of temperature at the front would throw it; conduction needs seconds to make such a layer.
  const double T_m = parameters_.T_melt_degC;
  const auto joined = [&](double x_m) {
    return T_m + (at(x_m) - T_m) * -std::expm1(-std::abs(x_m - front_m) / kJoint_m);
  };
  std::vector<double> T;
  for (const double xi : solid_nodes()) T.push_back(std::min(joined(front_m * xi), T_m));
  solid_->set_T_degC(T);
  T.clear();
  const double length = parameters_.length_m - front_m;
  for (const double eta : liquid_nodes()) T.push_back(std::max(joined(front_m + length * eta), T_m));
  liquid_.set_T_degC(T);
  energy_at_start_m_ = energy_content_m();
}

void MeltFront::restart(double front_m) {
  if (!(front_m > kMinLength_m && front_m < parameters_.length_m - kMinLength_m)) {
    throw std::invalid_argument(fmt::format("melt front: start at {} m, must be in ({}, {})", front_m, kMinLength_m,
                                            parameters_.length_m - kMinLength_m));
  }
  status_ = MeltStatus::kRunning;
  front_m_ = front_m;
  front_speed_m_per_s_ = 0.0;
  inlet_flux_ = mean_inlet_flux_ = solid_front_flux_ = liquid_front_flux_ = 0.0;
  corrected_speed_ = acceleration_ = last_step_s_ = 0.0;
  residual_slope_ = 1.0;
  energy_supplied_m_ = 0.0;
}

MeltStatus MeltFront::advance(double dt_s, const MeltInput& input) noexcept {
  const double travel = input.speed_m_per_s * dt_s;
  const double lengths = std::max(travel / numerics_.max_travel_m, dt_s / numerics_.max_step_s) - 1e-9;
  const bool two_stages = lengths > 1.0 && numerics_.solid == MeltDiscretisation::kThirdOrderUpwind;
  const int steps = std::max(1, static_cast<int>(std::ceil(two_stages ? lengths / kTwoStageLengths : lengths)));
  const double step_s = dt_s / steps;
  double flux_sum = 0.0;
  int done = 0;
  for (; done < steps && step_s > 0.0 && status_ == MeltStatus::kRunning; ++done) {
    const double flux = two_stages ? two_stage_step(step_s, input) : step(step_s, input);
    if (!std::isfinite(flux)) {
      status_ = MeltStatus::kDiverged;
      break;
    }
    flux_sum += flux;
    status_ = judge();
  }
  if (done > 0) mean_inlet_flux_ = flux_sum / done;
  return status_;
}

/// One implicit Euler step. Returns its q_f, or NaN if it found no front speed.
double MeltFront::step(double dt_s, const MeltInput& input) noexcept {
  const MeltPhaseStep melt{.dt_s = dt_s,
                           .speed_m_per_s = input.speed_m_per_s,
                           .front_old_m = front_m_,
                           .front_new_m = 0.0,
                           .front_speed_m_per_s = 0.0,
                           .barrel = input.barrel};
  if (!find_front(dt_s, dt_s, input, &melt)) return std::numeric_limits<double>::quiet_NaN();
  account(dt_s, input);
  return inlet_flux_;
}

/// As many Euler steps as a two-stage step is worth. Returns their mean q_f.
double MeltFront::euler_steps(double dt_s, const MeltInput& input) noexcept {
  double sum = 0.0;
  for (int i = 0; i < kTwoStageLengths; ++i) sum += step(dt_s / kTwoStageLengths, input);
  return sum / kTwoStageLengths;
}

/// (M17): granules and front by two implicit Euler stages, melt by one step over both.
double MeltFront::two_stage_step(double dt_s, const MeltInput& input) noexcept {
  constexpr double kFailed = std::numeric_limits<double>::quiet_NaN();
  const MeltPhaseStep melt{.dt_s = dt_s,
                           .speed_m_per_s = input.speed_m_per_s,
                           .front_old_m = front_m_,
                           .front_new_m = 0.0,
                           .front_speed_m_per_s = 0.0,
                           .barrel = input.barrel};
  const double T_inlet_before = T_inlet_degC();
  if (!find_front(kStage * dt_s, kStage * dt_s, input, nullptr)) return kFailed;
  if (std::abs(T_inlet_degC() - T_inlet_before) > kJump_K) {
    solid_->take_back();
    front_m_ = melt.front_old_m;
    return euler_steps(dt_s, input);
  }
  account((1.0 - kStage) * dt_s, input);
  const double first_flux = inlet_flux_;
  solid_->carry_on(std::numbers::sqrt2);
  front_m_ += std::numbers::sqrt2 * (front_m_ - melt.front_old_m);
  if (!find_front(kStage * dt_s, (1.0 - kStage) * dt_s, input, &melt)) return kFailed;
  account(kStage * dt_s, input);
  return (1.0 - kStage) * first_flux + kStage * inlet_flux_;
}

/// Implicit Euler of granules and front: finds the front speed v with  v = β (k_s T_s,x - k_l T_l,x)  at the end of it.
/// `melt` is the melt's step that ends at the same time; without one, the melt's flux stays as it was.
bool MeltFront::find_front(double dt_s, double since_last_s, const MeltInput& input,
                           const MeltPhaseStep* melt) noexcept {
  const double beta = parameters_.front_speed_per_flux_m3_per_J();
  const double k_s = parameters_.solid.conductivity_W_per_mK;
  const double k_l = parameters_.liquid.conductivity_W_per_mK;
  const double s_low = 0.5 * kMinLength_m;
  const double s_high = parameters_.length_m - s_low;

  MeltPhaseStep trial{.dt_s = dt_s,
                      .speed_m_per_s = input.speed_m_per_s,
                      .front_old_m = front_m_,
                      .front_new_m = 0.0,
                      .front_speed_m_per_s = corrected_speed_ + acceleration_ * std::min(since_last_s, last_step_s_),
                      .barrel = input.barrel};
  double last_speed = 0.0;
  double last_mismatch = 0.0;
  double slower = -std::numeric_limits<double>::infinity();  // Bracket of the root.
  double faster = std::numeric_limits<double>::infinity();
  for (int solve = 0; solve < kMaxSolves; ++solve) {
    trial.front_new_m = std::clamp(front_m_ + dt_s * trial.front_speed_m_per_s, s_low, s_high);
    trial.front_speed_m_per_s = (trial.front_new_m - front_m_) / dt_s;
    const double v = trial.front_speed_m_per_s;
    solid_front_flux_ = k_s * solid_->try_step(trial, input.inlet);
    if (melt != nullptr) {
      MeltPhaseStep melt_trial = *melt;
      melt_trial.front_new_m = trial.front_new_m;
      melt_trial.front_speed_m_per_s = (trial.front_new_m - melt->front_old_m) / melt->dt_s;
      liquid_front_flux_ = k_l * liquid_.try_step(melt_trial);
    }
    const double mismatch = v - beta * (solid_front_flux_ - liquid_front_flux_);
    if (!std::isfinite(mismatch)) return false;
    const double tolerance =
        std::max(kSpeedTolerance * std::max(input.speed_m_per_s, std::abs(v)), kMinSpeedTolerance_m_per_s);
    // Against an end of the barrel the front stays there only if the heat drives it further out.
    const bool leaving =
        (trial.front_new_m == s_low && mismatch > 0.0) || (trial.front_new_m == s_high && mismatch < 0.0);
    if (std::abs(mismatch) <= tolerance || leaving) {
      solid_->accept();
      if (melt != nullptr) liquid_.accept();
      inlet_flux_ = solid_->inlet_flux_W_per_m2();
      front_m_ = trial.front_new_m;
      front_speed_m_per_s_ = v;
      const double corrected = v - mismatch / residual_slope_;
      acceleration_ = (corrected - corrected_speed_) / since_last_s;
      last_step_s_ = since_last_s;
      corrected_speed_ = corrected;
      return true;
    }
    if (solve > 0 && v != last_speed) residual_slope_ = (mismatch - last_mismatch) / (v - last_speed);
    residual_slope_ = std::max(residual_slope_, kMinResidualSlope);
    last_speed = v;
    last_mismatch = mismatch;
    (mismatch < 0.0 ? slower : faster) = v;
    const double next = v - mismatch / residual_slope_;
    trial.front_speed_m_per_s = next > slower && next < faster ? next : 0.5 * (slower + faster);
  }
  return false;
}

void MeltFront::account(double dt_s, const MeltInput& input) noexcept {
  energy_supplied_m_ += dt_s * energy_supply_m_per_s(input);
}

MeltStatus MeltFront::judge() const noexcept {
  if (front_m_ < kMinLength_m) return MeltStatus::kSolidLost;
  if (parameters_.length_m - front_m_ < kMinLength_m) return MeltStatus::kMeltLost;
  const double too_hot_degC = parameters_.T_melt_degC + kMaxSuperheat_K;
  int any = 0;  // A flag, not a maximum: that would wait for each comparison.
  for (const double T : solid_T_degC()) any |= static_cast<int>(T > too_hot_degC);
  if (any != 0) return MeltStatus::kSuperheated;
  return MeltStatus::kRunning;
}

MeltValidity MeltFront::validity() const noexcept {
  const auto solid = solid_T_degC();
  const auto liquid = liquid_T_degC();
  return {.solid_margin_K = parameters_.T_melt_degC - *std::max_element(solid.begin(), solid.end()),
          .liquid_margin_K = *std::min_element(liquid.begin(), liquid.end()) - parameters_.T_melt_degC,
          .solid_length_m = front_m_,
          .liquid_length_m = parameters_.length_m - front_m_};
}

double MeltFront::T_degC(double x_m) const noexcept {
  if (x_m <= front_m_) return interpolate(solid_nodes(), solid_T_degC(), x_m / front_m_);
  return interpolate(liquid_nodes(), liquid_T_degC(), (x_m - front_m_) / (parameters_.length_m - front_m_));
}

double MeltFront::mean_T_before_nozzle_degC(double length_m) const noexcept {
  constexpr int kSamples = 16;  // The melt is smooth over this length; its layer at the nozzle is microns thin.
  double sum = 0.0;
  for (int i = 0; i < kSamples; ++i) sum += T_degC(parameters_.length_m - length_m * (i + 0.5) / kSamples);
  return sum / kSamples;
}

void MeltFront::calc_barrel_heat_W_per_m2(const MeltBarrel& barrel, std::span<double> heat_W_per_m2) const noexcept {
  std::fill(heat_W_per_m2.begin(), heat_W_per_m2.end(), 0.0);
  const std::size_t zones = std::min(barrel.zone_count, heat_W_per_m2.size());
  const auto add = [&](std::span<const double> nodes, std::span<const double> weights, std::span<const double> T,
                       double origin, double length, double exchange) {
    for (std::size_t i = 0; i < nodes.size(); ++i) {
      const double x_over_L = (origin + length * nodes[i]) / parameters_.length_m;
      const double heat = length * weights[i] * exchange * (barrel.T_degC(x_over_L) - T[i]);
      for (std::size_t zone = 0; zone < zones; ++zone) heat_W_per_m2[zone] += heat * barrel.share(zone, x_over_L);
    }
  };
  add(solid_nodes(), solid_->weights(), solid_T_degC(), 0.0, front_m_, parameters_.solid.barrel_exchange_W_per_m3K);
  add(liquid_nodes(), liquid_.weights(), liquid_T_degC(), front_m_, parameters_.length_m - front_m_,
      parameters_.liquid.barrel_exchange_W_per_m3K);
}

double MeltFront::energy_content_m() const noexcept {
  const double mean_T = weighted_sum(solid_->weights(), solid_T_degC());
  return front_m_ + parameters_.solid.heat_capacity_J_per_kgK / parameters_.heat_of_fusion_J_per_kg * front_m_ *
                        (parameters_.T_melt_degC - mean_T);
}

double MeltFront::energy_stored_m() const noexcept {
  return energy_content_m() - energy_at_start_m_;
}

/// Right side of (M6).
double MeltFront::energy_supply_m_per_s(const MeltInput& input) const noexcept {
  const double beta = parameters_.front_speed_per_flux_m3_per_J();
  const double K_per_m = parameters_.solid.heat_capacity_J_per_kgK / parameters_.heat_of_fusion_J_per_kg;
  const auto weights = solid_->weights();
  double barrel_minus_T = -weighted_sum(weights, solid_T_degC());
  if (input.barrel.zone_count == 1) {
    barrel_minus_T += input.barrel.T_zone_degC[0];
  } else {
    for (std::size_t i = 0; i < weights.size(); ++i) {
      barrel_minus_T += weights[i] * input.barrel.T_degC(solid_nodes()[i] * front_m_ / parameters_.length_m);
    }
  }
  return -beta * (liquid_front_flux_ + inlet_flux_) +
         K_per_m * (input.speed_m_per_s * (parameters_.T_melt_degC - T_inlet_degC()) -
                    parameters_.solid.exchange_rate_1_per_s() * front_m_ * barrel_minus_T);
}

}  // namespace meltbench::plant
