#pragma once
/// The state machine of CiA 402 drives, as a master sees it.

#include <cstdint>
#include <optional>
#include <string_view>

namespace meltbench::machine {

enum class DriveState : std::uint8_t {
  kNotReady,
  kSwitchOnDisabled,
  kReadyToSwitchOn,
  kSwitchedOn,
  kOperationEnabled,
  kQuickStop,
  kFaultReaction,
  kFault,
};

/// From the status word 0x6041. Patterns that CiA 402 does not define count as kNotReady.
[[nodiscard]] DriveState decode_drive_state(std::uint16_t statusword);
[[nodiscard]] std::string_view text(DriveState state);

/// Control word that brings the drive one state nearer to Operation enabled; nothing where it must go on by itself.
/// In kFault it is the rising edge of fault reset: the word before must have bit 7 clear.
[[nodiscard]] std::optional<std::uint16_t> next_controlword(DriveState state);

inline constexpr std::uint16_t kEnableOperation = 0x000F;
inline constexpr std::uint16_t kQuickStop = 0x0002;
inline constexpr std::int8_t kProfileVelocityMode = 3;

}  // namespace meltbench::machine
