#include "controller/machine/length_loop.hpp"

#include <algorithm>
#include <cmath>

#include "controller/estimator/filled_length.hpp"

namespace meltbench::machine {

namespace {

constexpr double kBalanceGivesIn_m =
    0.075;  // l_c of (E4): 5 s of travel at the nominal speed of the published machine.
/// Conveyed in a cycle: beyond it the balance is too coarse to contradict a pressure. The published speed, 9 mm, is.
constexpr double kFinestCycle_m = 1e-3;
constexpr Nanos kFresh = 200ms;  // A pressure that is older corrects the balance no more.

// Reports of this many limits' length can be missing before the controller trips.
std::size_t calc_command_capacity(const ControllerSettings& settings, const BoardFacts& facts) {
  const Nanos span = settings.limits.max_age + facts.feeder_latency + facts.feeder_cycle;
  return static_cast<std::size_t>(span / settings.sync_period) + 16;
}

std::size_t calc_speed_capacity(const ControllerSettings& settings, const BoardFacts& facts) {
  const Nanos span = 100ms + facts.pressure_latency + facts.pressure_period;
  return static_cast<std::size_t>(span / settings.sync_period) + 16;
}

law::DelayLawSettings make_law_settings(const ControllerSettings& settings, double x_set_m) {
  law::DelayLawSettings result;
  result.model = settings.model;
  result.bang_bang = {
      .x_set_m = x_set_m, .max_fill = settings.max_fill, .slope_margin_per_m = settings.slope_margin_per_m};
  result.max_measurement_age_s = to_s(settings.limits.max_age) + 1.0;
  result.min_sample_time_s = 0.1 * to_s(settings.sync_period);
  return result;
}

}  // namespace

void SampleRecord::add(Instant at, double value) {
  if (!samples_.empty() && at <= samples_.back().at) return;
  if (samples_.full()) samples_.pop_front();
  samples_.push_back({at, value});
}

double SampleRecord::at(Instant at) const {
  if (samples_.size() < 2) return samples_.back().value;
  std::size_t after = samples_.size() - 1;
  while (after > 1 && samples_[after - 1].at > at) --after;
  const Sample& left = samples_[after - 1];
  const Sample& right = samples_[after];
  const Instant within = std::clamp(at, left.at, samples_.back().at + kMaxLookahead);
  const double slope = (right.value - left.value) / to_s(right.at - left.at);
  return left.value + slope * to_s(within - left.at);
}

LengthLoop::LengthLoop(const ControllerSettings& settings, const BoardFacts& facts)
    : model_{settings.model},
      facts_{facts},
      sync_period_{settings.sync_period},
      time_stamped_{settings.time_stamped},
      law_starts_at_{settings.law_starts_at},
      speeds_{calc_speed_capacity(settings, facts)},
      balance_{settings.model, kBalanceGivesIn_m},
      balances_{calc_speed_capacity(settings, facts)},
      max_disagreement_m_{settings.max_disagreement_m},
      feed_{facts.feeder_latency, facts.feeder_cycle, calc_command_capacity(settings, facts)} {
  for (const SetPoint& set_point : settings.set_points) {
    laws_.push_back(law::make_delay_law(settings.law, make_law_settings(settings, set_point.x_m)));
  }
}

void LengthLoop::add(const ScrewSample& sample) {
  speed_m_per_s_ = sample.velocity_inc_per_s * facts_.metres_per_increment;
  speeds_.add(sample.at, speed_m_per_s_);
  if (!clock_) {
    clock_.emplace(speed_m_per_s_);
  } else {
    // The counter wraps; the difference of two samples does not.
    const auto turned =
        static_cast<std::uint32_t>(sample.position_inc) - static_cast<std::uint32_t>(last_position_inc_);
    travelled_inc_ += static_cast<std::int32_t>(turned);
  }
  last_position_inc_ = sample.position_inc;
  clock_->add(sample.at, static_cast<double>(travelled_inc_) * facts_.metres_per_increment);
  screw_at_ = sample.at;
  if (!balance_.has_started()) return;
  balance_.advance(clock_->at(sample.at), sample.at - measured_at_ < kFresh ? x_m_ : balance_.x_m());
  balances_.add(sample.at, balance_.x_m());
}

void LengthLoop::add(const FeedSample& sample) {
  const auto delivered = feed_.report(sample);
  if (!started_) return;
  for (const law::FeedInterval& interval : delivered) {
    for (const auto& law : laws_) law->add_feed(interval, *clock_);
    const double capacity = model_.feed_kg_per_s(1.0, speeds_.at(interval.until));
    balance_.add_feed(capacity > 0.0 ? interval.feed_kg_per_s / capacity : 0.0, clock_->at(interval.until));
  }
}

Instant LengthLoop::time_stamp_of(const PressureSample& sample) const {
  // An age beyond what the wire can tell is the transmitter's own latency, and half a sample period on the average.
  return sample.sync_at - sample.age.value_or(facts_.pressure_latency + facts_.pressure_period / 2);
}

void LengthLoop::add(const PressureSample& sample) {
  pressure_Pa_ = sample.counts * facts_.Pa_per_count;
  pressure_good_ = sample.good;
  const Instant at = time_stamp_of(sample);
  estimator::FilledLength estimate;
  estimate.status = estimator::FilledLengthStatus::kInvalid;
  if (sample.good && !speeds_.empty()) {
    const Instant speed_at = time_stamped_ ? at : sample.sync_at;
    estimate = estimator::calc_filled_length(model_, pressure_Pa_, speeds_.at(speed_at));
  }
  if (!estimate.usable()) {
    if (!implausible_since_) implausible_since_ = sample.sync_at;
    return;
  }
  implausible_since_.reset();
  newest_x_m_ = estimate.x_m;
  if (!fits_balance(at, estimate.x_m)) {
    if (!disagrees_since_) disagrees_since_ = sample.sync_at;
    return;
  }
  disagrees_since_.reset();
  x_m_ = estimate.x_m;
  measured_at_ = at;
  measured_ = true;
}

bool LengthLoop::fits_balance(Instant at, double x_m) const {
  const bool coarse = model_.speed_m_per_s * to_s(sync_period_) > kFinestCycle_m;
  return coarse || balances_.empty() || std::abs(x_m - balances_.at(at)) <= max_disagreement_m_;
}

bool LengthLoop::is_ready() const {
  return measured_ && clock_ && feed_.known_until();
}

void LengthLoop::start_empty() {
  if (clock_ && feed_.known_until()) start_laws(0.0);
}

void LengthLoop::start_laws(double U) {
  start_U_ = U;
  for (const auto& law : laws_) law->start(*feed_.known_until(), start_U_, *clock_);
  started_ = true;
  balance_.start(x_m_, start_U_, clock_->at(screw_at_));
  disagrees_since_.reset();
}

LengthCommand LengthLoop::calc(Instant sync_at, Instant now) {
  // The feed up to now has kept the filled length where it is: the run starts in balance.
  if (!started_) start_laws(from_feed_ ? U_applied() : model_.holding_ratio(x_m_));
  const Instant effect_at = feed_.calc_effect(now);
  LengthCommand command{.U = start_U_, .P_m = x_m_};
  if (now >= law_starts_at_) {
    law::DelayLawInput input;
    input.measured_at = time_stamped_ ? measured_at_ : sync_at;
    input.x_m = x_m_;
    input.effect_at = effect_at;
    input.in_flight = feed_.calc_in_flight(effect_at);
    const law::DelayLawOutput output = laws_[selected_]->calc(input, *clock_);
    command = {.U = output.U, .P_m = output.P_m, .status = output.status};
  }
  // Held until the next command: the speed in the middle of that time makes the mass right.
  const double c = speeds_.at(effect_at + sync_period_ / 2);
  command.flow_kg_per_s = std::max(model_.feed_kg_per_s(command.U, c), 0.0);
  return command;
}

double LengthLoop::U_applied() const {
  const double capacity = model_.feed_kg_per_s(1.0, speed_m_per_s_);
  return capacity > 0.0 ? feed_.flow_kg_per_s() / capacity : 0.0;
}

}  // namespace meltbench::machine
