#include "controller/machine/melt_loop.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace meltbench::machine {

namespace {

constexpr double kSlowestGainShare = 0.05;  // Of the nominal speed: the steady state of a standing screw is none.
constexpr double kFastestFront = 0.95;      // Of b, as in the observer.
constexpr double kFastestRetreat = 3.0;
constexpr double kUsableFrontTravel_m = 2e-3;  // A front this much travel old may be extrapolated, ...
constexpr double kUsableInletTravel_m = 1e-3;  // ... an inlet temperature may stand for now.

GainPlacement placement_of(const std::string& law) {
  if (law == "output_feedback_capped") return GainPlacement::kCapped;
  if (law == "output_feedback_direct") return GainPlacement::kDirect;
  return GainPlacement::kBoard;
}

std::unique_ptr<law::MeltLaw> make_law(const MeltSettings& settings) {
  if (settings.law == "open_loop") return std::make_unique<law::OpenLoopMeltLaw>();
  if (settings.law == "pi") return std::make_unique<law::PiMeltLaw>(settings.pi);
  if (settings.law.starts_with("output_feedback")) {
    return std::make_unique<law::BacksteppingMeltLaw>(settings.backstepping);
  }
  throw std::invalid_argument("melt loop: no law of the name " + settings.law);
}

estimator::MeltObserver make_observer(const MeltSettings& settings) {
  const law::MeltPhaseModel& solid = settings.model.solid;
  const double beta = 1.0 / (solid.density_kg_per_m3 * settings.model.heat_of_fusion_J_per_kg);
  return estimator::MeltObserver{{.conductivity_W_per_mK = solid.conductivity_W_per_mK,
                                  .diffusivity_m2_per_s = solid.diffusivity_m2_per_s(),
                                  .exchange_rate_1_per_s = solid.exchange_rate_1_per_s(),
                                  .T_melt_degC = settings.model.T_melt_degC,
                                  .length_m = settings.model.length_m,
                                  .front_speed_per_flux_m3_per_J = beta},
                                 {.cells = settings.observer_cells, .grid_speed_m_per_s = settings.speed_m_per_s}};
}

}  // namespace

// --- front tracker

void FrontTracker::add(Instant taken_at, double front_m, double screw_speed_m_per_s) {
  if (!images_.empty() && taken_at <= images_.back().at) return;
  if (images_.full()) images_.pop_front();
  images_.push_back({taken_at, front_m});
  span_s_ = kSpan_m / std::max(screw_speed_m_per_s, 1e-6);
}

double FrontTracker::at(Instant at, double screw_speed_m_per_s) const {
  const Image& newest = images_.back();
  if (images_.size() < 2) return newest.front_m;
  std::size_t first = images_.size() - 2;
  while (first > 0 && to_s(newest.at - images_[first].at) < span_s_) --first;
  const Image& oldest = images_[first];
  const double measured = (newest.front_m - oldest.front_m) / to_s(newest.at - oldest.at);
  const double speed =
      std::clamp(measured, -kFastestRetreat * screw_speed_m_per_s, kFastestFront * screw_speed_m_per_s);
  return newest.front_m + speed * to_s(at - newest.at);
}

// --- loop

MeltLoop::MeltLoop(const MeltSettings& settings, const MeltFacts& facts, Nanos sync_period)
    : settings_{settings},
      facts_{facts},
      sync_period_{sync_period},
      placement_{placement_of(settings.law)},
      law_{make_law(settings)},
      backstepping_{dynamic_cast<const law::BacksteppingMeltLaw*>(law_.get())},
      observer_{make_observer(settings)},
      T_barrel_degC_{settings.T_barrel_degC} {
  stop();
}

void MeltLoop::add(const FrontSample& sample) {
  if (!sample.good) return;
  const Nanos age = sample.age.value_or(facts_.camera_latency + facts_.camera_period / 2);
  fronts_.add(sample.sync_at - age, sample.front_m, b_m_per_s_);
  if (!running_) front_m_ = sample.front_m;
}

void MeltLoop::add(const InletSample& sample) {
  mean_flux_W_per_m2_ = sample.mean_flux_W_per_m2;
  if (!sample.good) return;
  inlet_at_ = sample.sync_at - sample.age.value_or(facts_.inlet_latency + facts_.inlet_period / 2);
  T_inlet_degC_ = sample.T_inlet_degC;
}

bool MeltLoop::is_ready() const {
  return !fronts_.empty() && inlet_at_ && b_m_per_s_ > kSlowestGainShare * settings_.speed_m_per_s;
}

void MeltLoop::stop() {
  running_ = false;
  law_->reset();
  fronts_.clear();
  inlet_at_.reset();
  mean_flux_W_per_m2_.reset();
  front_coasted_m_ = inlet_coasted_m_ = 0.0;
  profile_degC_.fill(settings_.model.T_melt_degC);
  solid_margin_K_ = 0.0;
  request_ = {.T_reference_degC = settings_.model.T_melt_degC};  // Of no consequence without a gain.
}

void MeltLoop::start_observer(Instant sync_at) {
  front_m_ = fronts_.at(sync_at, b_m_per_s_);
  observer_.start_linear(front_m_, T_inlet_degC_ - settings_.start_below_K);
  gain_speed_m_per_s_ = b_m_per_s_;
  running_ = true;
}

std::optional<double> MeltLoop::take_front(Instant sync_at) const {
  if (fronts_.empty()) return {};
  const double travel_s = kUsableFrontTravel_m / std::max(b_m_per_s_, 1e-6);
  const double camera_s = to_s(facts_.camera_period + facts_.camera_latency + 2 * sync_period_);
  if (to_s(sync_at - fronts_.newest_at()) > std::max(travel_s, camera_s)) return {};
  return std::clamp(fronts_.at(sync_at, b_m_per_s_), 0.0, settings_.model.length_m);
}

estimator::MeltObserverInput MeltLoop::make_input(Instant sync_at) {
  const double travel_s = kUsableInletTravel_m / std::max(b_m_per_s_, 1e-6);
  const double board_s = to_s(facts_.inlet_period + facts_.inlet_latency + 2 * sync_period_);
  inlet_fresh_ = inlet_at_ && to_s(sync_at - *inlet_at_) <= std::max(travel_s, board_s);
  estimator::MeltObserverInput input{.speed_m_per_s = b_m_per_s_,
                                     .T_barrel_degC = T_barrel_degC_,
                                     .inlet_flux_W_per_m2 = mean_flux_W_per_m2_.value_or(request_.feedforward_W_per_m2),
                                     .liquid_front_flux_W_per_m2 = reference_ ? reference_->front_flux_W_per_m2 : 0.0,
                                     .front_m = take_front(sync_at),
                                     .T_inlet_degC = {}};
  if (inlet_fresh_) input.T_inlet_degC = T_inlet_degC_;
  // Put into (29), the board's own loop is the observer's correction with T_reference as the measurement and q_f* as
  // the flux: what the board does is known without its report.
  const bool board_closes_loop = request_.gain_W_per_m2K > 0.0;
  if (board_closes_loop && !(inlet_fresh_ && mean_flux_W_per_m2_)) {
    input.T_inlet_degC = request_.T_reference_degC;
    input.inlet_flux_W_per_m2 = request_.feedforward_W_per_m2;
  }
  mean_flux_W_per_m2_.reset();
  return input;
}

void MeltLoop::follow_speed(double dt_s) {
  const double most = settings_.max_gain_ramp_m_per_s2 * dt_s;
  gain_speed_m_per_s_ += std::clamp(b_m_per_s_ - gain_speed_m_per_s_, -most, most);
  gain_speed_m_per_s_ = std::max(gain_speed_m_per_s_, kSlowestGainShare * settings_.speed_m_per_s);
}

std::optional<MeltRequest> MeltLoop::calc(Instant sync_at) {
  double dt_s = 0.0;
  if (!running_) {
    start_observer(sync_at);
    inlet_fresh_ = true;
    mean_flux_W_per_m2_.reset();
  } else {
    dt_s = to_s(sync_at - calculated_at_);
    follow_speed(dt_s);
    const estimator::MeltObserverInput input = make_input(sync_at);
    observer_.advance(dt_s, input);
    front_m_ = observer_.front_m();
    front_coasted_m_ = input.front_m ? 0.0 : front_coasted_m_ + b_m_per_s_ * dt_s;
    inlet_coasted_m_ = inlet_fresh_ ? 0.0 : inlet_coasted_m_ + b_m_per_s_ * dt_s;
  }
  calculated_at_ = sync_at;
  look_at_estimate();
  reference_ = law::calc_melt_reference(settings_.model, T_barrel_degC_, gain_speed_m_per_s_, settings_.front_set_m);
  if (!reference_) return {};

  const double T_inlet_degC = inlet_fresh_ ? T_inlet_degC_ : observer_.T_inlet_degC();
  law::MeltCommand command =
      law_->update(*reference_, {front_m_, T_inlet_degC, observer_.nodes(), observer_.T_degC()}, dt_s);
  double Z_W_per_m2 = 0.0;
  if (backstepping_ != nullptr) {
    const double T_without_Z_degC = reference_->T_inlet_degC + backstepping_->trim_K();
    Z_W_per_m2 = reference_->loop_gain_W_per_m2K * (T_without_Z_degC - command.T_reference_degC);
  }
  // A cold first guess near the set point would ask for granules that stick; with (85) of [K19] it never binds.
  command.T_reference_degC = std::min(command.T_reference_degC, settings_.model.T_melt_degC);
  if (placement_ == GainPlacement::kCapped) command = law::limit_melt_gain(command, *reference_, to_s(sync_period_));
  request_ = {command.feedforward_W_per_m2, command.gain_W_per_m2K, command.T_reference_degC, Z_W_per_m2};
  if (placement_ != GainPlacement::kBoard) {
    request_.feedforward_W_per_m2 = command.calc_flux_W_per_m2(T_inlet_degC);
    request_.gain_W_per_m2K = 0.0;
  }
  return request_;
}

// Nodes and points both rise: one walk along both.
void MeltLoop::look_at_estimate() {
  const std::span<const double> nodes = observer_.nodes();
  const std::span<const double> T = observer_.T_degC();
  const double spacing_m = settings_.model.length_m / static_cast<double>(kProfilePoints - 1);
  std::size_t right = 1;
  for (std::size_t i = 0; i < kProfilePoints; ++i) {
    const double xi = spacing_m * static_cast<double>(i) / observer_.front_m();
    while (right + 1 < nodes.size() && nodes[right] < xi) ++right;
    const double share = (xi - nodes[right - 1]) / (nodes[right] - nodes[right - 1]);
    profile_degC_[i] = xi < 1.0 ? T[right - 1] + share * (T[right] - T[right - 1]) : settings_.model.T_melt_degC;
  }
  solid_margin_K_ = settings_.model.T_melt_degC - *std::max_element(T.begin(), T.end());
}

safety::MeltObservation MeltLoop::observe() const {
  safety::MeltObservation seen;
  seen.front_m = front_m_;
  if (inlet_fresh_) seen.T_inlet_degC = T_inlet_degC_;
  seen.T_solid_max_degC = settings_.model.T_melt_degC - solid_margin_K_;
  seen.T_liquid_min_degC = T_liquid_min_degC();
  seen.front_coasted_m = front_coasted_m_;
  seen.inlet_coasted_m = inlet_coasted_m_;
  return seen;
}

}  // namespace meltbench::machine
