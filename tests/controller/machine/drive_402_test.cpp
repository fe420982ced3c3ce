#include "controller/machine/drive_402.hpp"

#include <catch2/catch.hpp>

using namespace meltbench::machine;

TEST_CASE("Drive: each status word pattern of CiA 402 is its state, whatever the other bits say", "[machine]") {
  struct Row {
    std::uint16_t pattern;
    std::uint16_t free_bits;
    DriveState state;
  };
  const Row row =
      GENERATE(Row{0x0000, 0xFFB0, DriveState::kNotReady}, Row{0x0040, 0xFFB0, DriveState::kSwitchOnDisabled},
               Row{0x0021, 0xFF90, DriveState::kReadyToSwitchOn}, Row{0x0023, 0xFF90, DriveState::kSwitchedOn},
               Row{0x0027, 0xFF90, DriveState::kOperationEnabled}, Row{0x0007, 0xFF90, DriveState::kQuickStop},
               Row{0x000F, 0xFFB0, DriveState::kFaultReaction}, Row{0x0008, 0xFFB0, DriveState::kFault});
  CHECK(decode_drive_state(row.pattern) == row.state);
  CHECK(decode_drive_state(static_cast<std::uint16_t>(row.pattern | row.free_bits)) == row.state);
}

TEST_CASE("Drive: every state has a control word that leads on, but those that the drive leaves by itself",
          "[machine]") {
  CHECK(next_controlword(DriveState::kSwitchOnDisabled) == 0x0006);
  CHECK(next_controlword(DriveState::kReadyToSwitchOn) == 0x0007);
  CHECK(next_controlword(DriveState::kSwitchedOn) == 0x000F);
  CHECK(next_controlword(DriveState::kOperationEnabled) == 0x000F);
  CHECK(next_controlword(DriveState::kQuickStop) == 0x0000);
  CHECK(next_controlword(DriveState::kFault) == 0x0080);
  CHECK_FALSE(next_controlword(DriveState::kNotReady).has_value());
  CHECK_FALSE(next_controlword(DriveState::kFaultReaction).has_value());
}
