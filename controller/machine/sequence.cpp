#include "controller/machine/sequence.hpp"

namespace meltbench::machine {

std::string_view text(SequencePhase phase) {
  switch (phase) {
    case SequencePhase::kCold:
      return "cold";
    case SequencePhase::kHeating:
      return "heating";
    case SequencePhase::kSoaking:
      return "soaking";
    case SequencePhase::kFilling:
      return "filling";
    case SequencePhase::kRunning:
      return "running";
    case SequencePhase::kHolding:
      return "holding";
    case SequencePhase::kPurging:
      return "purging";
    case SequencePhase::kStandby:
      return "standby";
  }
  return "?";
}

void Sequence::enter(Instant now, SequencePhase phase) {
  if (phase == SequencePhase::kHeating && phase_ != SequencePhase::kSoaking) heat_since_ = now;
  phase_ = phase;
  since_ = now;
  ready_ = false;
}

bool Sequence::obey(Instant now, SequenceOrder order) {
  using Phase = SequencePhase;
  const bool turning = phase_ == Phase::kFilling || phase_ == Phase::kRunning || phase_ == Phase::kHolding;
  switch (order) {
    case SequenceOrder::kStart:
      shutting_down_ = false;
      if (phase_ == Phase::kCold || phase_ == Phase::kStandby) return enter(now, Phase::kHeating), true;
      if (phase_ == Phase::kHolding || phase_ == Phase::kPurging) return enter(now, Phase::kFilling), true;
      return false;
    case SequenceOrder::kHold:
      if (phase_ != Phase::kRunning && phase_ != Phase::kFilling) return false;
      return enter(now, Phase::kHolding), true;
    case SequenceOrder::kPurge:
      if (!turning) return false;
      return enter(now, Phase::kPurging), true;
    case SequenceOrder::kShutDown:
      if (phase_ == Phase::kCold) return false;
      shutting_down_ = true;
      if (phase_ != Phase::kPurging) enter(now, turning ? Phase::kPurging : Phase::kCold);
      return true;
  }
  return false;
}

bool Sequence::update(Instant now, bool zones_warm, bool loops_ready) {
  using Phase = SequencePhase;
  const Phase before = phase_;
  switch (phase_) {
    case Phase::kHeating:
      if (zones_warm) enter(now, Phase::kSoaking);
      break;
    case Phase::kSoaking:
      if (!zones_warm) {
        enter(now, Phase::kHeating);
      } else if (now - since_ >= settings_.soak) {
        enter(now, Phase::kFilling);
      }
      break;
    case Phase::kFilling:
      if (loops_ready && !ready_) ready_since_ = now;
      ready_ = loops_ready;
      if (ready_ && now - ready_since_ >= settings_.fill) enter(now, Phase::kRunning);
      break;
    case Phase::kPurging:
      if (now - since_ >= settings_.purge) enter(now, shutting_down_ ? Phase::kCold : Phase::kStandby);
      break;
    default:
      break;
  }
  return phase_ != before;
}

SequenceDemand Sequence::demand(double run_rev_per_s) const {
  switch (phase_) {
    case SequencePhase::kCold:
      return {};
    case SequencePhase::kHeating:
    case SequencePhase::kSoaking:
    case SequencePhase::kStandby:
      return {.heat = true};
    case SequencePhase::kFilling:
      return {.heat = true, .screw_rev_per_s = run_rev_per_s, .feed = FeedMode::kOpenLoop};
    case SequencePhase::kRunning:
      return {.heat = true, .screw_rev_per_s = run_rev_per_s, .feed = FeedMode::kLaw};
    case SequencePhase::kHolding:
      return {.heat = true, .screw_rev_per_s = settings_.hold_rev_per_s, .feed = FeedMode::kLaw};
    case SequencePhase::kPurging:
      return {.heat = true, .screw_rev_per_s = settings_.purge_rev_per_s};
  }
  return {};
}

bool Sequence::is_overdue(Instant now) const {
  const bool heating = phase_ == SequencePhase::kHeating || phase_ == SequencePhase::kSoaking;
  if (heating) return now - heat_since_ > settings_.heat_timeout + settings_.soak;
  return phase_ == SequencePhase::kFilling && now - since_ > settings_.fill_timeout;
}

}  // namespace meltbench::machine
