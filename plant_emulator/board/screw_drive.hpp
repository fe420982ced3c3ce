#pragma once
/// Screw drive: CiA 402 in velocity modes, with the encoder that is the material clock.

#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>

#include "plant_emulator/board/board.hpp"
#include "plant_emulator/board/sampling.hpp"
#include "plant_emulator/board/settings.hpp"

namespace meltbench::board {

/// States of CiA 402; the value is what the state bits of the status word (mask 0x6F) say.
enum class DriveState : std::uint8_t {
  kSwitchOnDisabled = 0x40,     ///< Unpowered. Also what "not ready to switch on" leads to at once.
  kReadyToSwitchOn = 0x21,      ///< Unpowered.
  kSwitchedOn = 0x23,           ///< Powered, stands still.
  kOperationEnabled = 0x27,     ///< Turns at the target velocity. The only state in which targets count.
  kQuickStopActive = 0x07,      ///< Slows down.
  kFaultReactionActive = 0x0F,  ///< Slows down.
  kFault = 0x08,                ///< Unpowered until a fault reset.
};

[[nodiscard]] std::string_view text(DriveState state);

/// What a control word asks for, (CiA 402: bits 0 switch on, 1 enable voltage, 2 quick stop, low active, 3 enable).
enum class DriveCommand : std::uint8_t {
  kDisableVoltage,
  kQuickStop,
  kShutdown,
  kSwitchOn,
  kEnableOperation,
};
[[nodiscard]] DriveCommand decode_controlword(std::uint16_t controlword);

/// The state that a command leads to, or nothing if it means nothing in this state. Enable operation in Ready to switch
/// on takes both steps at once, as the profile allows. Fault reset is not here: it is an edge, not a level.
[[nodiscard]] std::optional<DriveState> find_transition(DriveState state, DriveCommand command);

/// The drive's firmware. The objects that a controller needs (fixtures/boards/screw_drive.eds has all):
/// - 6040       U16  RPDO 1  control word
/// - 6041       U16  TPDO 1  status word, sent when it changes
/// - 6060/6061  I8           mode 2 (vl, rpm) or 3 (pv, increments/s), and its echo
/// - 6042       I16  RPDO 2  vl target velocity [rpm]; RPDO 2 = 6040 + 6042 is off until a master enables it
/// - 60FF       I32  RPDO 3  pv target velocity [increments/s]; RPDO 3 = 6040 + 60FF is off, too
/// - 6064       I32  TPDO 3  position [increments], latched at SYNC: age 0; wraps modulo 2^32
/// - 606C       I32  TPDO 3  velocity [increments/s] at SYNC
/// - 608F       U32  ro      :1 increments per :2 turns of the screw
/// - 6007       I16  rw      on loss of a heartbeat in 1016: 0 nothing, 1 fault, 2 disable voltage, 3 quick stop
///
/// The speed follows its ramp in steps of the sample time. A screw turns one way: negative targets count as 0 (status
/// word bit 11, internal limit), as amounts outside 6046 are cut. Without power it stands still at once, held by the
/// melt.
///
/// *Warm start*: at power-up and NMT reset node the drive is in Operation enabled and turns at nominal speed, as if its
/// local control had run it until a master takes over. The master reads 6041 and goes on from there; shutdown (6040 =
/// 0006) would stop the screw. The exact nominal speed is the target until 6042 or 60FF is written differently.
class ScrewDrive final : public Board {
 public:
  /// Parameters and @throws as Feeder.
  ScrewDrive(std::string name, const canopen::ObjectDictionary& dictionary, std::uint8_t node_id,
             const ScrewDriveSettings& settings, Chance chance, Process& process);

  [[nodiscard]] Instant next_touch(Instant until) const override;
  void touch(Instant at) override;

  [[nodiscard]] std::span<const std::string_view> signal_names() const override;
  void read_signals(std::span<double> values) const override;

  /// Puts the drive into Fault, through the reaction of 605E, with an emergency message unless the code is 8130, which
  /// the node has told already.
  void trip(Instant now, std::uint16_t error_code);

  [[nodiscard]] DriveState state() const { return state_; }
  [[nodiscard]] double demand_rev_per_s() const { return demand_rev_per_s_; }

 protected:
  void run_timers(Instant /*now*/) override {}
  void refresh(Instant now) override;

  canopen::AbortCode on_write(Instant now, const canopen::OdEntry& entry, std::span<const std::uint8_t> value) override;
  void on_written(Instant now, const canopen::OdEntry& entry) override;
  void on_rpdo(Instant now, unsigned number) override;
  void on_reset(Instant now, canopen::ResetKind kind) override;
  void on_heartbeat(Instant now, const canopen::HeartbeatEvent& event) override;

 private:
  enum class Ramp : std::uint8_t { kNormal, kQuick, kJump };
  enum Mode : std::int8_t { kVelocityMode = 2, kProfileVelocityMode = 3 };

  void power_up(Instant now);
  void follow_objects(Instant now);
  void obey(Instant now, std::uint16_t controlword);
  void enter(Instant now, DriveState state);
  void quick_stop(Instant now);
  void read_target();
  void aim(Instant now);
  void finish_stop(Instant now);
  void step_at(Instant at);
  void update_statusword();
  [[nodiscard]] double goal_rev_per_s() const;
  [[nodiscard]] double calc_rate_rev_per_s2(bool faster) const;
  [[nodiscard]] double to_increments(double revolutions) const;

  ScrewDriveSettings settings_;
  SampleClock clock_;

  canopen::OdValue<std::uint16_t> controlword_, statusword_, error_code_;
  canopen::OdValue<std::int16_t> vl_target_rpm_, vl_demand_rpm_, vl_actual_rpm_;
  canopen::OdValue<std::int16_t> on_abort_, on_quick_stop_, on_shutdown_, on_disable_, on_halt_, on_fault_;
  canopen::OdValue<std::uint32_t> vl_min_rpm_, vl_max_rpm_;
  struct VlRamp {
    canopen::OdValue<std::uint32_t> delta_speed_rpm;
    canopen::OdValue<std::uint16_t> delta_time_s;
  };
  VlRamp vl_faster_, vl_slower_, vl_quick_;
  canopen::OdValue<std::uint32_t> pv_faster_, pv_slower_, pv_quick_;  // [increments/s2]
  canopen::OdValue<std::int8_t> mode_asked_, mode_;
  canopen::OdValue<std::int32_t> position_, demand_inc_per_s_, velocity_inc_per_s_, pv_target_inc_per_s_;

  DriveState state_ = DriveState::kSwitchOnDisabled;
  std::uint16_t controlword_before_ = 0;
  std::int16_t vl_target_before_rpm_ = 0;
  std::int32_t pv_target_before_inc_per_s_ = 0;
  double target_rev_per_s_ = 0;
  bool limited_ = false;
  Ramp stop_ramp_ = Ramp::kJump;  // How a stop that is under way slows down.
  bool disable_at_standstill_ = false;
  double demand_rev_per_s_ = 0;
  Instant next_step_ = Instant::never();  // Of the ramp.
};

}  // namespace meltbench::board
