#include "plant_emulator/board/screw_drive.hpp"

#include <cmath>
#include <limits>

#include <fmt/format.h>

namespace meltbench::board {

namespace {

constexpr double kSecondsPerMinute = 60.0;
constexpr std::uint16_t kFaultReset = 0x0080, kHalt = 0x0100;  // Control word.
constexpr std::uint16_t kVoltage = 0x0010, kRemote = 0x0200, kTargetReached = 0x0400, kInternalLimit = 0x0800,
                        kStandstill = 0x1000;  // Status word; the last one in pv mode.
constexpr std::uint16_t kEnabledControlword = 0x000F;
constexpr std::uint16_t kModesOfOperation = 0x6060;
constexpr double kJump = std::numeric_limits<double>::infinity();
constexpr std::array<std::string_view, 3> kSignals{"demand_rpm", "actual_rpm", "statusword"};

template <class Integer>
Integer to_integer(double value) {
  constexpr double kMin = std::numeric_limits<Integer>::min(), kMax = std::numeric_limits<Integer>::max();
  return static_cast<Integer>(std::clamp(std::round(value), kMin, kMax));
}

canopen::ObjectDictionary configure(const canopen::ObjectDictionary& eds, const ScrewDriveSettings& settings) {
  const auto whole = [](double value) { return to_integer<std::uint32_t>(value); };
  const double increments_per_rpm = settings.increments_per_rev / kSecondsPerMinute;
  const double start_rev_per_s = settings.warm_start ? settings.nominal_rev_per_s : 0.0;
  std::vector<DefaultValue> defaults{
      make_default(0x608F, 1, settings.increments_per_rev),
      make_default(0x6042, 0, to_integer<std::int16_t>(start_rev_per_s * kSecondsPerMinute)),
      make_default(0x60FF, 0, to_integer<std::int32_t>(start_rev_per_s * settings.increments_per_rev)),
      make_default(0x6040, 0, settings.warm_start ? kEnabledControlword : std::uint16_t{0}),
      make_default(0x604A, 1, whole(settings.quick_stop_rpm_per_s)),
      make_default(0x6083, 0, whole(settings.ramp_rpm_per_s * increments_per_rpm)),
      make_default(0x6084, 0, whole(settings.ramp_rpm_per_s * increments_per_rpm)),
      make_default(0x6085, 0, whole(settings.quick_stop_rpm_per_s * increments_per_rpm))};
  for (const std::uint16_t ramp : {std::uint16_t{0x6048}, std::uint16_t{0x6049}}) {
    defaults.push_back(make_default(ramp, 1, whole(settings.ramp_rpm_per_s)));
  }
  for (const std::uint16_t ramp : {std::uint16_t{0x6048}, std::uint16_t{0x6049}, std::uint16_t{0x604A}}) {
    defaults.push_back(make_default(ramp, 2, std::uint16_t{1}));  // Delta speed per 1 s.
  }
  return with_defaults(eds, defaults);
}

bool is_mode(std::int8_t mode) {
  return mode == 2 || mode == 3;
}

}  // namespace

std::string_view text(DriveState state) {
  switch (state) {
    case DriveState::kSwitchOnDisabled:
      return "switch on disabled";
    case DriveState::kReadyToSwitchOn:
      return "ready to switch on";
    case DriveState::kSwitchedOn:
      return "switched on";
    case DriveState::kOperationEnabled:
      return "operation enabled";
    case DriveState::kQuickStopActive:
      return "quick stop active";
    case DriveState::kFaultReactionActive:
      return "fault reaction active";
    case DriveState::kFault:
      return "fault";
  }
  return "unknown";
}

DriveCommand decode_controlword(std::uint16_t controlword) {
  if ((controlword & 0x02U) == 0) return DriveCommand::kDisableVoltage;
  if ((controlword & 0x04U) == 0) return DriveCommand::kQuickStop;
  if ((controlword & 0x01U) == 0) return DriveCommand::kShutdown;
  return (controlword & 0x08U) == 0 ? DriveCommand::kSwitchOn : DriveCommand::kEnableOperation;
}

std::optional<DriveState> find_transition(DriveState state, DriveCommand command) {
  using enum DriveState;
  using enum DriveCommand;
  const bool has_voltage =
      state == kReadyToSwitchOn || state == kSwitchedOn || state == kOperationEnabled || state == kQuickStopActive;
  switch (command) {
    case kDisableVoltage:
      if (has_voltage) return kSwitchOnDisabled;  // Transitions 7, 9, 10, 12.
      break;
    case kQuickStop:
      if (state == kReadyToSwitchOn || state == kSwitchedOn) return kSwitchOnDisabled;  // 7, 10.
      if (state == kOperationEnabled) return kQuickStopActive;                          // 11.
      break;
    case kShutdown:
      if (state == kSwitchOnDisabled || state == kSwitchedOn || state == kOperationEnabled) {
        return kReadyToSwitchOn;  // 2, 6, 8.
      }
      break;
    case kSwitchOn:
      if (state == kReadyToSwitchOn || state == kOperationEnabled) return kSwitchedOn;  // 3, 5.
      break;
    case kEnableOperation:
      if (has_voltage && state != kOperationEnabled) return kOperationEnabled;  // 3 with 4, 4, 16.
      break;
  }
  return std::nullopt;
}

ScrewDrive::ScrewDrive(std::string name, const canopen::ObjectDictionary& dictionary, std::uint8_t node_id,
                       const ScrewDriveSettings& settings, Chance chance, Process& process)
    : Board{std::move(name), configure(dictionary, settings), node_id, process},
      settings_{settings},
      clock_{chance.draw_phase(settings.sample_time), settings.sample_time} {
  canopen::ObjectDictionary& od = this->dictionary();
  on_abort_ = od.bind<std::int16_t>(0x6007);
  error_code_ = od.bind<std::uint16_t>(0x603F);
  controlword_ = od.bind<std::uint16_t>(0x6040);
  statusword_ = od.bind<std::uint16_t>(0x6041);
  vl_target_rpm_ = od.bind<std::int16_t>(0x6042);
  vl_demand_rpm_ = od.bind<std::int16_t>(0x6043);
  vl_actual_rpm_ = od.bind<std::int16_t>(0x6044);
  vl_min_rpm_ = od.bind<std::uint32_t>(0x6046, 1);
  vl_max_rpm_ = od.bind<std::uint32_t>(0x6046, 2);
  vl_faster_ = {od.bind<std::uint32_t>(0x6048, 1), od.bind<std::uint16_t>(0x6048, 2)};
  vl_slower_ = {od.bind<std::uint32_t>(0x6049, 1), od.bind<std::uint16_t>(0x6049, 2)};
  vl_quick_ = {od.bind<std::uint32_t>(0x604A, 1), od.bind<std::uint16_t>(0x604A, 2)};
  on_quick_stop_ = od.bind<std::int16_t>(0x605A);
  on_shutdown_ = od.bind<std::int16_t>(0x605B);
  on_disable_ = od.bind<std::int16_t>(0x605C);
  on_halt_ = od.bind<std::int16_t>(0x605D);
  on_fault_ = od.bind<std::int16_t>(0x605E);
  mode_asked_ = od.bind<std::int8_t>(kModesOfOperation);
  mode_ = od.bind<std::int8_t>(0x6061);
  position_ = od.bind<std::int32_t>(0x6064);
  demand_inc_per_s_ = od.bind<std::int32_t>(0x606B);
  velocity_inc_per_s_ = od.bind<std::int32_t>(0x606C);
  pv_faster_ = od.bind<std::uint32_t>(0x6083);
  pv_slower_ = od.bind<std::uint32_t>(0x6084);
  pv_quick_ = od.bind<std::uint32_t>(0x6085);
  pv_target_inc_per_s_ = od.bind<std::int32_t>(0x60FF);
}

void ScrewDrive::power_up(Instant now) {
  stop_ramp_ = Ramp::kJump;
  disable_at_standstill_ = limited_ = false;
  error_code_.set(0);
  mode_.set(mode_asked_.get());
  controlword_before_ = controlword_.get();
  vl_target_before_rpm_ = vl_target_rpm_.get();
  pv_target_before_inc_per_s_ = pv_target_inc_per_s_.get();
  state_ = settings_.warm_start ? DriveState::kOperationEnabled : DriveState::kSwitchOnDisabled;
  target_rev_per_s_ = demand_rev_per_s_ = settings_.warm_start ? settings_.nominal_rev_per_s : 0.0;
  process().set_screw_rev_per_s(demand_rev_per_s_);
  aim(now);
}

// --- state machine

void ScrewDrive::follow_objects(Instant now) {
  invalidate();
  bool target_is_new =
      vl_target_rpm_.get() != vl_target_before_rpm_ || pv_target_inc_per_s_.get() != pv_target_before_inc_per_s_;
  if (is_mode(mode_asked_.get()) && mode_asked_.get() != mode_.get()) {
    mode_.set(mode_asked_.get());
    target_is_new = true;
  }
  if (target_is_new) read_target();
  obey(now, controlword_.get());
  aim(now);
}

void ScrewDrive::obey(Instant now, std::uint16_t controlword) {
  const bool reset_edge = (controlword & ~controlword_before_ & kFaultReset) != 0;
  controlword_before_ = controlword;
  if (state_ == DriveState::kFault) {
    if (!reset_edge) return;
    node().clear_emcy(error_code_.get());
    error_code_.set(0);
    enter(now, DriveState::kSwitchOnDisabled);  // 15.
    return;
  }
  const auto next = find_transition(state_, decode_controlword(controlword));
  if (!next) return;
  if (*next == DriveState::kQuickStopActive) {
    quick_stop(now);
  } else if (state_ != DriveState::kQuickStopActive || *next != DriveState::kOperationEnabled ||
             on_quick_stop_.get() >= 5) {
    enter(now, *next);
  }
}

void ScrewDrive::enter(Instant now, DriveState state) {
  if (state_ == state) return;
  disable_at_standstill_ = false;
  if (state == DriveState::kOperationEnabled) read_target();
  if (state == DriveState::kReadyToSwitchOn) stop_ramp_ = on_shutdown_.get() == 1 ? Ramp::kNormal : Ramp::kJump;
  if (state == DriveState::kSwitchedOn) stop_ramp_ = on_disable_.get() == 1 ? Ramp::kNormal : Ramp::kJump;
  if (state == DriveState::kSwitchOnDisabled || state == DriveState::kFault) stop_ramp_ = Ramp::kJump;
  state_ = state;
  report(state == DriveState::kFault ? Severity::kFault : Severity::kInfo, now, "drive-state",
         fmt::format("{}", text(state)));
}

/// Options of 605A: 0 off at once; 1, 5 normal ramp; 2, 6 quick ramp; up to 4 the drive is off at standstill.
void ScrewDrive::quick_stop(Instant now) {
  const std::int16_t option = on_quick_stop_.get();
  if (option == 0) return enter(now, DriveState::kSwitchOnDisabled);
  enter(now, DriveState::kQuickStopActive);
  stop_ramp_ = option == 1 || option == 5 ? Ramp::kNormal : Ramp::kQuick;
  disable_at_standstill_ = option < 5;
}

/// Options of 605E: 0 off at once, 1 normal ramp, 2 quick ramp.
void ScrewDrive::trip(Instant now, std::uint16_t error_code) {
  if (state_ == DriveState::kFault || state_ == DriveState::kFaultReactionActive) return;
  error_code_.set(error_code);
  if (error_code != canopen::emcy_code::kHeartbeat) {
    node().raise_emcy(error_code, canopen::error_register::kGeneric | canopen::error_register::kProfile);
  }
  const std::int16_t option = on_fault_.get();
  enter(now, option == 0 ? DriveState::kFault : DriveState::kFaultReactionActive);
  stop_ramp_ = option == 0 ? Ramp::kJump : option == 1 ? Ramp::kNormal : Ramp::kQuick;
  disable_at_standstill_ = true;
  aim(now);
}

void ScrewDrive::finish_stop(Instant now) {
  if (!disable_at_standstill_ || demand_rev_per_s_ != 0.0) return;
  if (state_ == DriveState::kQuickStopActive) enter(now, DriveState::kSwitchOnDisabled);
  if (state_ == DriveState::kFaultReactionActive) enter(now, DriveState::kFault);
}

void ScrewDrive::update_statusword() {
  const bool reached = state_ == DriveState::kOperationEnabled && demand_rev_per_s_ == goal_rev_per_s();
  const bool stands = mode_.get() == kProfileVelocityMode && demand_rev_per_s_ == 0.0;
  const auto word =
      static_cast<std::uint16_t>(static_cast<unsigned>(state_) | kVoltage | kRemote | (reached ? kTargetReached : 0U) |
                                 (limited_ ? kInternalLimit : 0U) | (stands ? kStandstill : 0U));
  if (word == statusword_.get()) return;
  statusword_.set(word);
  node().event(1);
  node().event(2);
  invalidate();
}

// --- speed

void ScrewDrive::read_target() {
  vl_target_before_rpm_ = vl_target_rpm_.get();
  pv_target_before_inc_per_s_ = pv_target_inc_per_s_.get();
  const double asked_rev_per_s = mode_.get() == kVelocityMode
                                     ? vl_target_before_rpm_ / kSecondsPerMinute
                                     : pv_target_before_inc_per_s_ / static_cast<double>(settings_.increments_per_rev);
  const double max_rev_per_s = vl_max_rpm_.get() / kSecondsPerMinute;
  const double min_rev_per_s = asked_rev_per_s > 0 ? vl_min_rpm_.get() / kSecondsPerMinute : 0.0;
  target_rev_per_s_ = std::max(std::min(asked_rev_per_s, max_rev_per_s), min_rev_per_s);
  limited_ = target_rev_per_s_ != asked_rev_per_s;
}

double ScrewDrive::goal_rev_per_s() const {
  const bool turns = state_ == DriveState::kOperationEnabled && (controlword_before_ & kHalt) == 0;
  return turns ? target_rev_per_s_ : 0.0;
}

double ScrewDrive::calc_rate_rev_per_s2(bool faster) const {
  Ramp ramp = stop_ramp_;
  if (state_ == DriveState::kOperationEnabled) {
    const bool halts_quickly = (controlword_before_ & kHalt) != 0 && on_halt_.get() == 2;
    ramp = halts_quickly ? Ramp::kQuick : Ramp::kNormal;
  }
  if (ramp == Ramp::kJump) return kJump;
  const bool quick = ramp == Ramp::kQuick;
  if (mode_.get() == kProfileVelocityMode) {
    const double rate = (quick ? pv_quick_ : faster ? pv_faster_ : pv_slower_).get();
    return rate > 0 ? rate / settings_.increments_per_rev : kJump;
  }
  const VlRamp& vl = quick ? vl_quick_ : faster ? vl_faster_ : vl_slower_;
  const double speed_rev_per_s = vl.delta_speed_rpm.get() / kSecondsPerMinute;
  return speed_rev_per_s > 0 && vl.delta_time_s.get() > 0 ? speed_rev_per_s / vl.delta_time_s.get() : kJump;
}

/// Starts the ramp if there is somewhere to go.
void ScrewDrive::aim(Instant now) {
  if (demand_rev_per_s_ == goal_rev_per_s()) {
    step_at(Instant::never());
    finish_stop(now);
  } else if (next_step_ == Instant::never()) {
    step_at(clock_.first_from(now));
  }
  update_statusword();
}

void ScrewDrive::step_at(Instant at) {
  next_step_ = at;
  own_deadline_ = at;  // The end of a ramp shows in the status word, so the bus must hear of it in time.
}

Instant ScrewDrive::next_touch(Instant until) const {
  return next_step_ <= until ? next_step_ : Instant::never();
}

void ScrewDrive::touch(Instant at) {
  const double goal = goal_rev_per_s();
  const double step = calc_rate_rev_per_s2(goal > demand_rev_per_s_) * to_s(clock_.period());
  demand_rev_per_s_ += std::clamp(goal - demand_rev_per_s_, -step, step);
  process().set_screw_rev_per_s(demand_rev_per_s_);
  invalidate();
  step_at(at + clock_.period());
  aim(at);
}

// --- the bus

canopen::AbortCode ScrewDrive::on_write(Instant /*now*/, const canopen::OdEntry& entry,
                                        std::span<const std::uint8_t> value) {
  const bool bad_mode = entry.address().index == kModesOfOperation && !is_mode(canopen::load<std::int8_t>(value));
  return bad_mode ? canopen::AbortCode::kInvalidValue : canopen::AbortCode::kNone;
}

void ScrewDrive::on_written(Instant now, const canopen::OdEntry& entry) {
  const std::uint16_t index = entry.address().index;
  if (index == 0x6046 && state_ == DriveState::kOperationEnabled) read_target();
  if (index >= 0x6000) follow_objects(now);
}

void ScrewDrive::on_rpdo(Instant now, unsigned /*number*/) {
  follow_objects(now);
}

void ScrewDrive::on_reset(Instant now, canopen::ResetKind kind) {
  if (kind != canopen::ResetKind::kCommunication) power_up(now);
}

void ScrewDrive::on_heartbeat(Instant now, const canopen::HeartbeatEvent& event) {
  if (event.change != canopen::HeartbeatChange::kLost) return;
  switch (on_abort_.get()) {
    case 1:
      trip(now, canopen::emcy_code::kHeartbeat);
      break;
    case 2:
      if (state_ != DriveState::kFault && state_ != DriveState::kFaultReactionActive) {
        enter(now, DriveState::kSwitchOnDisabled);
      }
      break;
    case 3:
      if (state_ == DriveState::kOperationEnabled) quick_stop(now);
      break;
    default:
      break;
  }
  aim(now);
}

double ScrewDrive::to_increments(double revolutions) const {
  return revolutions * settings_.increments_per_rev;
}

void ScrewDrive::refresh(Instant /*now*/) {
  const auto increments = static_cast<std::int64_t>(std::floor(to_increments(process().encoder_rev())));
  const double speed_rev_per_s = process().encoder_rev_per_s();
  position_.set(static_cast<std::int32_t>(static_cast<std::uint32_t>(increments)));  // Wraps.
  velocity_inc_per_s_.set(to_integer<std::int32_t>(to_increments(speed_rev_per_s)));
  demand_inc_per_s_.set(to_integer<std::int32_t>(to_increments(demand_rev_per_s_)));
  vl_demand_rpm_.set(to_integer<std::int16_t>(demand_rev_per_s_ * kSecondsPerMinute));
  vl_actual_rpm_.set(to_integer<std::int16_t>(speed_rev_per_s * kSecondsPerMinute));
}

// --- the recording

std::span<const std::string_view> ScrewDrive::signal_names() const {
  return kSignals;
}

void ScrewDrive::read_signals(std::span<double> values) const {
  values[0] = demand_rev_per_s_ * kSecondsPerMinute;
  values[1] = process().encoder_rev_per_s() * kSecondsPerMinute;
  values[2] = statusword_.get();
}

}  // namespace meltbench::board
