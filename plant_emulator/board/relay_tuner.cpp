#include "plant_emulator/board/relay_tuner.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace meltbench::board {

void RelayTuner::start(double t_s, double set_degC, double hysteresis_K) {
  state_ = State::kRunning;
  set_degC_ = set_degC;
  hysteresis_K_ = hysteresis_K;
  started_s_ = last_s_ = t_s;
  high_ = 1;
  low_ = 0;
  is_high_ = true;
  in_cycle_ = false;
  cycles_ = 0;
  period_before_s_ = 0;
}

double RelayTuner::step(double t_s, double T_degC) {
  if (state_ != State::kRunning) return 0;
  output_sum_s_ += (is_high_ ? high_ : low_) * (t_s - last_s_);
  last_s_ = t_s;
  max_degC_ = std::max(max_degC_, T_degC);
  min_degC_ = std::min(min_degC_, T_degC);
  if (is_high_ && T_degC > set_degC_ + hysteresis_K_) {
    is_high_ = false;
  } else if (!is_high_ && T_degC < set_degC_ - hysteresis_K_) {
    is_high_ = true;
    if (in_cycle_) end_cycle(t_s);
    begin_cycle(t_s, T_degC);
  }
  if (t_s - started_s_ > kTimeOut_s) state_ = State::kFailed;
  if (state_ != State::kRunning) return 0;
  return is_high_ ? high_ : low_;
}

void RelayTuner::begin_cycle(double t_s, double T_degC) {
  in_cycle_ = true;
  cycle_began_s_ = t_s;
  output_sum_s_ = 0;
  max_degC_ = min_degC_ = T_degC;
}

void RelayTuner::end_cycle(double t_s) {
  const double period_s = t_s - cycle_began_s_;
  const double amplitude_K = 0.5 * (max_degC_ - min_degC_);
  const double d = 0.5 * (high_ - low_);
  const bool settled = std::abs(period_s - period_before_s_) < kSettled * period_s;
  period_before_s_ = period_s;
  ++cycles_;
  if (cycles_ >= kFirstCycles + kLeastCycles && settled && amplitude_K > hysteresis_K_) {
    const double beyond_K = std::sqrt(amplitude_K * amplitude_K - hysteresis_K_ * hysteresis_K_);
    result_ = {4.0 * d / (std::numbers::pi * beyond_K), period_s, output_sum_s_ / period_s};
    state_ = State::kDone;
  } else if (cycles_ >= kFirstCycles + kMostCycles) {
    state_ = State::kFailed;
  } else if (cycles_ >= kFirstCycles) {
    centre(output_sum_s_ / period_s);
  }
}

/// As far up as down, so that the oscillation is symmetric about the set point.
void RelayTuner::centre(double mean_output) {
  const double d = std::clamp(std::min(mean_output, 1.0 - mean_output), 0.05, 0.5);
  high_ = std::min(mean_output + d, 1.0);
  low_ = std::max(mean_output - d, 0.0);
}

}  // namespace meltbench::board
