#include "controller/machine/screw_control.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "controller/machine/boot_plan.hpp"
#include "controller/machine/drive_402.hpp"
#include "controller/machine/objects.hpp"

namespace meltbench::machine {

using config::BoardKind;

ScrewControl::ScrewControl(const ControllerSettings& settings)
    : node_id_{settings.board(BoardKind::kScrewDrive).node_id},
      pitch_m_{settings.pitch_m},
      moves_{moves_screw(settings)},
      ramp_rev_per_cycle_{settings.screw_ramp_rev_per_s2 * to_s(settings.sync_period)},
      own_speed_rev_per_s_{settings.run_speed_rev_per_s()},
      target_rev_per_s_{settings.sequence ? 0.0 : settings.run_speed_rev_per_s()},
      demand_rev_per_s_{target_rev_per_s_} {}

void ScrewControl::connect(const BusManager& bus) {
  const NodeBoot& drive = bus.boot(BoardKind::kScrewDrive);
  const double increments = drive.value<std::uint32_t>(drive_object::kEncoderIncrements);
  const double revolutions = drive.value<std::uint32_t>(drive_object::kEncoderRevolutions);
  increments_per_rev_ = std::max(increments, 1.0) / std::max(revolutions, 1.0);
}

bool ScrewControl::take(const can::CanFrame& frame, Instant sync_at) {
  if (frame.id != canopen::cob_id::tpdo(drive_object::kMotionTpdo, node_id_)) return false;
  if (const auto report = parse_motion_report(frame)) {
    sample_ = {sync_at, report->position_inc, report->velocity_inc_per_s};
    speed_m_per_s_ = pitch_m_ * report->velocity_inc_per_s / increments_per_rev_;
    measured_at_ = sync_at;
  }
  return true;
}

std::optional<ScrewSample> ScrewControl::close_cycle() {
  const std::optional<ScrewSample> sample = sample_;
  if (sample && std::exchange(resuming_, false)) demand_rev_per_s_ = speed_m_per_s_ / pitch_m_;
  if (sample) check_speed(sample->at);
  sample_.reset();
  return sample;
}

/// Far off only: the published screws swing by 40 %, and one may slip.
void ScrewControl::check_speed(Instant at) {
  constexpr double kStanding_rev_per_s = 0.05, kLeastShare = 0.3, kMostShare = 2.5;
  const double asked = moves_ ? demand_rev_per_s_ : own_speed_rev_per_s_;
  const double shown = speed_m_per_s_ / pitch_m_;
  const bool wrong = asked > kStanding_rev_per_s && (shown < kLeastShare * asked || shown > kMostShare * asked);
  if (!wrong) {
    wrong_since_.reset();
  } else if (!wrong_since_) {
    wrong_since_ = at;
  }
}

void ScrewControl::resume() {
  stopped_ = false;
  resuming_ = true;
  wrong_since_.reset();
}

void ScrewControl::drive(Outbox& out) {
  if (!moves_ || stopped_ || resuming_) return;
  demand_rev_per_s_ += std::clamp(target_rev_per_s_ - demand_rev_per_s_, -ramp_rev_per_cycle_, ramp_rev_per_cycle_);
  const auto inc_per_s = static_cast<std::int32_t>(std::lround(demand_rev_per_s_ * increments_per_rev_));
  out.send(make_velocity(node_id_, kEnableOperation, inc_per_s));
}

void ScrewControl::quick_stop(Outbox& out) {
  stopped_ = true;
  demand_rev_per_s_ = 0.0;
  out.send(make_controlword(node_id_, kQuickStop));
}

}  // namespace meltbench::machine
