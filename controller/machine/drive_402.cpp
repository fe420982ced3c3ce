#include "controller/machine/drive_402.hpp"

namespace meltbench::machine {

DriveState decode_drive_state(std::uint16_t statusword) {
  switch (statusword & 0x4FU) {
    case 0x40:
      return DriveState::kSwitchOnDisabled;
    case 0x0F:
      return DriveState::kFaultReaction;
    case 0x08:
      return DriveState::kFault;
    default:
      break;
  }
  switch (statusword & 0x6FU) {
    case 0x21:
      return DriveState::kReadyToSwitchOn;
    case 0x23:
      return DriveState::kSwitchedOn;
    case 0x27:
      return DriveState::kOperationEnabled;
    case 0x07:
      return DriveState::kQuickStop;
    default:
      return DriveState::kNotReady;
  }
}

std::string_view text(DriveState state) {
  switch (state) {
    case DriveState::kNotReady:
      return "not ready to switch on";
    case DriveState::kSwitchOnDisabled:
      return "switch on disabled";
    case DriveState::kReadyToSwitchOn:
      return "ready to switch on";
    case DriveState::kSwitchedOn:
      return "switched on";
    case DriveState::kOperationEnabled:
      return "operation enabled";
    case DriveState::kQuickStop:
      return "quick stop active";
    case DriveState::kFaultReaction:
      return "fault reaction active";
    case DriveState::kFault:
      return "fault";
  }
  return "?";
}

std::optional<std::uint16_t> next_controlword(DriveState state) {
  constexpr std::uint16_t kDisableVoltage = 0x0000, kShutdown = 0x0006, kSwitchOn = 0x0007, kFaultReset = 0x0080;
  switch (state) {
    case DriveState::kNotReady:
    case DriveState::kFaultReaction:
      return {};
    case DriveState::kSwitchOnDisabled:
      return kShutdown;
    case DriveState::kReadyToSwitchOn:
      return kSwitchOn;
    case DriveState::kSwitchedOn:
    case DriveState::kOperationEnabled:
      return kEnableOperation;
    case DriveState::kQuickStop:
      return kDisableVoltage;
    case DriveState::kFault:
      return kFaultReset;
  }
  return {};
}

}  // namespace meltbench::machine
