#include "plant_emulator/board/screw_drive.hpp"

#include <catch2/catch.hpp>
#include <cmath>

#include "tests/plant_emulator/board/board_bench.hpp"

using namespace meltbench;
using board::DriveCommand;
using board::DriveState;
using board::field;
using board::find_transition;
using board::kNode;
using board::ScrewDrive;

namespace {

constexpr std::uint32_t kControlId = 0x200 + kNode, kStatusId = 0x180 + kNode, kMotionId = 0x380 + kNode,
                        kEmcyId = 0x080 + kNode;
constexpr double kNominal_rev_per_s = 1.5;  // 90 rpm.

board::ScrewDriveSettings make_settings(bool warm_start) {
  board::ScrewDriveSettings settings;
  settings.warm_start = warm_start;
  settings.nominal_rev_per_s = kNominal_rev_per_s;
  settings.ramp_rpm_per_s = 600;         // 10 rev/s per s.
  settings.quick_stop_rpm_per_s = 3000;  // 50 rev/s per s.
  return settings;
}

struct DriveBench : board::BoardBench<ScrewDrive> {
  explicit DriveBench(bool warm_start, board::ScrewDriveSettings settings = {})
      : BoardBench{"screw_drive", settings.nominal_rev_per_s > 0 ? settings : make_settings(warm_start)} {
    start_operational();
  }
  void control(std::uint16_t word) {
    send(kControlId, {static_cast<std::uint8_t>(word & 0xFFU), static_cast<std::uint8_t>(word >> 8U)});
  }
  unsigned statusword() { return read<std::uint16_t>(0x6041); }
  void enable() {
    for (const std::uint16_t word : {std::uint16_t{6}, std::uint16_t{7}, std::uint16_t{15}}) control(word);
  }
  void wait(Nanos time) { run_to(now + time); }
};

}  // namespace

TEST_CASE("Drive: a control word is decoded as CiA 402 tables it", "[board][screw_drive]") {
  CHECK(board::decode_controlword(0x0000) == DriveCommand::kDisableVoltage);
  CHECK(board::decode_controlword(0x000D) == DriveCommand::kDisableVoltage);
  CHECK(board::decode_controlword(0x0002) == DriveCommand::kQuickStop);
  CHECK(board::decode_controlword(0x000B) == DriveCommand::kQuickStop);
  CHECK(board::decode_controlword(0x0006) == DriveCommand::kShutdown);
  CHECK(board::decode_controlword(0x000E) == DriveCommand::kShutdown);
  CHECK(board::decode_controlword(0x0007) == DriveCommand::kSwitchOn);
  CHECK(board::decode_controlword(0x000F) == DriveCommand::kEnableOperation);
  CHECK(board::decode_controlword(0x007F) == DriveCommand::kEnableOperation);
}

TEST_CASE("Drive: every state answers every command as CiA 402 draws it", "[board][screw_drive]") {
  using enum DriveState;
  using enum DriveCommand;
  constexpr auto kStay = std::optional<DriveState>{};
  struct Row {
    DriveState state;
    std::optional<DriveState> disable_voltage, quick_stop, shutdown, switch_on, enable;
  };
  const Row rows[] = {
      {kSwitchOnDisabled, kStay, kStay, kReadyToSwitchOn, kStay, kStay},
      {kReadyToSwitchOn, kSwitchOnDisabled, kSwitchOnDisabled, kStay, kSwitchedOn, kOperationEnabled},
      {kSwitchedOn, kSwitchOnDisabled, kSwitchOnDisabled, kReadyToSwitchOn, kStay, kOperationEnabled},
      {kOperationEnabled, kSwitchOnDisabled, kQuickStopActive, kReadyToSwitchOn, kSwitchedOn, kStay},
      {kQuickStopActive, kSwitchOnDisabled, kStay, kStay, kStay, kOperationEnabled},
      {kFaultReactionActive, kStay, kStay, kStay, kStay, kStay},
      {kFault, kStay, kStay, kStay, kStay, kStay},
  };
  for (const Row& row : rows) {
    INFO(text(row.state));
    CHECK(find_transition(row.state, kDisableVoltage) == row.disable_voltage);
    CHECK(find_transition(row.state, kQuickStop) == row.quick_stop);
    CHECK(find_transition(row.state, kShutdown) == row.shutdown);
    CHECK(find_transition(row.state, kSwitchOn) == row.switch_on);
    CHECK(find_transition(row.state, kEnableOperation) == row.enable);
  }
}

TEST_CASE("Drive: a warm start turns at nominal speed in Operation enabled, until the target changes",
          "[board][screw_drive]") {
  DriveBench bench{true};
  CHECK((bench.statusword() & 0x6FU) == 0x27);
  CHECK((bench.statusword() & 0x0400U) != 0);  // Target reached.
  CHECK(bench.read<std::int16_t>(0x6042) == 90);
  bench.wait(1s);
  bench.control(0x000F);  // What a master says that has read 6041.
  bench.wait(1s);
  CHECK(bench.process.speed_rev_per_s == kNominal_rev_per_s);
  CHECK(bench.process.turns_rev == Approx(3.0).epsilon(1e-12));
  REQUIRE(bench.write(0x6042, 0, std::int16_t{120}) == 0);
  bench.wait(100ms);
  CHECK(bench.process.speed_rev_per_s == Approx(2.0).epsilon(1e-12));
}

TEST_CASE("Drive: a nominal speed that is not a whole number of rpm is kept exactly by a warm start",
          "[board][screw_drive]") {
  board::ScrewDriveSettings settings = make_settings(true);
  settings.nominal_rev_per_s = 9.424777960769379;  // 565.49 rpm.
  DriveBench bench{true, settings};
  bench.control(0x000F);
  bench.wait(1s);
  CHECK(bench.process.speed_rev_per_s == settings.nominal_rev_per_s);
}

TEST_CASE("Drive: a cold start is taken through the states and up the ramp, each step told by TPDO 1",
          "[board][screw_drive]") {
  DriveBench bench{false};
  CHECK((bench.statusword() & 0x4FU) == 0x40);
  REQUIRE(bench.write(0x6042, 0, std::int16_t{60}) == 0);
  std::vector<unsigned> told;
  for (const std::uint16_t word : {std::uint16_t{6}, std::uint16_t{7}, std::uint16_t{15}}) {
    bench.sent.clear();
    bench.control(word);
    told.push_back(field<std::uint16_t>(bench.last(kStatusId).value(), 0) & 0x6FU);
  }
  CHECK(told == std::vector<unsigned>{0x21, 0x23, 0x27});
  bench.wait(50ms);
  CHECK((bench.statusword() & 0x0400U) == 0);
  CHECK(bench.process.speed_rev_per_s == Approx(0.5).margin(0.011));  // 10 rev/s2 for 50 ms, in steps of 1 ms.
  bench.sent.clear();
  bench.wait(60ms);
  CHECK(bench.process.speed_rev_per_s == 1.0);
  CHECK((field<std::uint16_t>(bench.last(kStatusId).value(), 0) & 0x0400U) != 0);
  CHECK(bench.board.next_deadline() == Instant::never());  // At rest it needs no wake-up.
}

TEST_CASE("Drive: enable operation is not obeyed before shutdown", "[board][screw_drive]") {
  DriveBench bench{false};
  bench.control(0x000F);
  CHECK(bench.board.state() == DriveState::kSwitchOnDisabled);
}

TEST_CASE("Drive: shutdown takes the screw down the ramp, disable voltage stops it at once", "[board][screw_drive]") {
  DriveBench bench{true};
  SECTION("shutdown") {
    bench.control(0x0006);
    CHECK(bench.board.state() == DriveState::kReadyToSwitchOn);
    bench.wait(100ms);
    CHECK(bench.process.speed_rev_per_s == Approx(0.5).margin(0.011));
    bench.wait(60ms);
    CHECK(bench.process.speed_rev_per_s == 0.0);
  }
  SECTION("disable voltage") {
    bench.control(0x0000);
    CHECK(bench.board.state() == DriveState::kSwitchOnDisabled);
    bench.wait(1ms);
    CHECK(bench.process.speed_rev_per_s == 0.0);
  }
}

TEST_CASE("Drive: halt holds the screw and lets it go again without leaving Operation enabled",
          "[board][screw_drive]") {
  DriveBench bench{true};
  bench.control(0x010F);
  bench.wait(200ms);
  CHECK(bench.process.speed_rev_per_s == 0.0);
  CHECK(bench.board.state() == DriveState::kOperationEnabled);
  bench.control(0x000F);
  bench.wait(200ms);
  CHECK(bench.process.speed_rev_per_s == kNominal_rev_per_s);
}

TEST_CASE("Drive: a quick stop slows down on its own ramp and then follows 605A", "[board][screw_drive]") {
  DriveBench bench{true};
  SECTION("2: off at standstill") {
    bench.control(0x0002);
    CHECK(bench.board.state() == DriveState::kQuickStopActive);
    bench.wait(20ms);
    CHECK(bench.process.speed_rev_per_s == Approx(0.5).margin(0.051));  // 50 rev/s2.
    bench.wait(15ms);
    CHECK(bench.process.speed_rev_per_s == 0.0);
    CHECK(bench.board.state() == DriveState::kSwitchOnDisabled);
  }
  SECTION("6: stays, and goes on when enabled again") {
    REQUIRE(bench.write(0x605A, 0, std::int16_t{6}) == 0);
    bench.control(0x0002);
    bench.wait(1s);
    CHECK(bench.board.state() == DriveState::kQuickStopActive);
    bench.control(0x000F);
    bench.wait(1s);
    CHECK(bench.board.state() == DriveState::kOperationEnabled);
    CHECK(bench.process.speed_rev_per_s == kNominal_rev_per_s);
  }
}

TEST_CASE("Drive: a fault ends in Fault with an EMCY, and only the edge of the reset bit leaves it",
          "[board][screw_drive]") {
  DriveBench bench{true};
  bench.control(0x008F);  // Reset bit already set: no edge later.
  bench.board.trip(bench.now, 0x2310);
  bench.wait(5ms);
  CHECK(bench.board.state() == DriveState::kFaultReactionActive);
  CHECK(field<std::uint16_t>(bench.last(kEmcyId).value(), 0) == 0x2310);
  CHECK(bench.read<std::uint16_t>(0x603F) == 0x2310);
  bench.wait(100ms);
  CHECK(bench.board.state() == DriveState::kFault);
  CHECK((bench.statusword() & 0x4FU) == 0x08);
  CHECK(bench.process.speed_rev_per_s == 0.0);
  bench.control(0x008F);
  CHECK(bench.board.state() == DriveState::kFault);
  bench.control(0x000F);
  bench.control(0x0080);
  CHECK(bench.board.state() == DriveState::kSwitchOnDisabled);
  CHECK(field<std::uint16_t>(bench.last(kEmcyId).value(), 0) == 0);
  CHECK(bench.read<std::uint16_t>(0x603F) == 0);
}

TEST_CASE("Drive: what a lost heartbeat does is said by 6007", "[board][screw_drive]") {
  const auto [option, state, turns] =
      GENERATE(table<std::int16_t, DriveState, bool>({{0, DriveState::kOperationEnabled, true},
                                                      {1, DriveState::kFault, false},
                                                      {2, DriveState::kSwitchOnDisabled, false},
                                                      {3, DriveState::kSwitchOnDisabled, false}}));
  DriveBench bench{true};
  REQUIRE(bench.write(0x6007, 0, option) == 0);
  REQUIRE(bench.write(0x1016, 1, std::uint32_t{0x007F'0064}) == 0);
  bench.send(0x77F, {0x05});
  bench.wait(500ms);
  CHECK(bench.board.state() == state);
  CHECK((bench.process.speed_rev_per_s > 0) == turns);
  CHECK(bench.count(kEmcyId) == 1);
  CHECK(field<std::uint16_t>(bench.last(kEmcyId).value(), 0) == 0x8130);
}

TEST_CASE("Drive: the position is what the encoder shows at SYNC, and wraps", "[board][screw_drive]") {
  DriveBench bench{true};
  bench.run_to(Instant{333'333'333ns});
  bench.sync();
  const can::CanFrame motion = bench.last(kMotionId).value();
  REQUIRE(motion.length == 8);
  const double turns = kNominal_rev_per_s * to_s(bench.now);
  CHECK(field<std::int32_t>(motion, 0) == static_cast<std::int32_t>(std::floor(turns * 65536)));
  CHECK(field<std::int32_t>(motion, 4) == 98304);  // 1.5 rev/s.

  bench.process.speed_rev_per_s = 0.0;
  bench.process.turns_rev = 32768.25;  // 2^31 increments and a quarter turn.
  bench.wait(1ms);
  bench.sync();
  CHECK(field<std::int32_t>(bench.last(kMotionId).value(), 0) == std::numeric_limits<std::int32_t>::min() + 16384);
}

TEST_CASE("Drive: targets beyond its limits are cut, and the status word says so", "[board][screw_drive]") {
  DriveBench bench{true};
  REQUIRE(bench.write(0x6046, 2, std::uint32_t{150}) == 0);
  REQUIRE(bench.write(0x6042, 0, std::int16_t{300}) == 0);
  bench.wait(1s);
  CHECK(bench.process.speed_rev_per_s == 2.5);
  CHECK((bench.statusword() & 0x0800U) != 0);
  REQUIRE(bench.write(0x6042, 0, std::int16_t{-60}) == 0);  // A screw turns one way.
  bench.wait(1s);
  CHECK(bench.process.speed_rev_per_s == 0.0);
  CHECK((bench.statusword() & 0x0800U) != 0);
  REQUIRE(bench.write(0x6042, 0, std::int16_t{60}) == 0);
  bench.wait(1s);
  CHECK(bench.process.speed_rev_per_s == 1.0);
  CHECK((bench.statusword() & 0x0800U) == 0);
}

TEST_CASE("Drive: profile velocity counts in increments, other modes are refused", "[board][screw_drive]") {
  DriveBench bench{true};
  CHECK(bench.write(0x6060, 0, std::int8_t{1}) == 0x0609'0030);
  REQUIRE(bench.write(0x6060, 0, std::int8_t{3}) == 0);
  CHECK(bench.read<std::int8_t>(0x6061) == 3);
  CHECK(bench.process.speed_rev_per_s == kNominal_rev_per_s);
  REQUIRE(bench.write(0x60FF, 0, std::int32_t{65536 * 2}) == 0);
  bench.wait(200ms);
  CHECK(bench.process.speed_rev_per_s == 2.0);
  CHECK(bench.read<std::int32_t>(0x606B) == 131072);
}

TEST_CASE("Drive: a ramp of 0 is a jump", "[board][screw_drive]") {
  board::ScrewDriveSettings settings = make_settings(true);
  settings.ramp_rpm_per_s = 0;
  DriveBench bench{true, settings};
  REQUIRE(bench.write(0x6042, 0, std::int16_t{240}) == 0);
  bench.wait(1ms);
  CHECK(bench.process.speed_rev_per_s == 4.0);
}

TEST_CASE("Drive: RPDO 2 enables and sets the speed in one frame once a master has switched it on",
          "[board][screw_drive]") {
  DriveBench bench{false};
  REQUIRE(bench.write(0x1401, 1, std::uint32_t{0x300 + kNode}) == 0);
  for (const std::uint8_t word : {std::uint8_t{6}, std::uint8_t{7}, std::uint8_t{15}}) {
    bench.send(0x300 + kNode, {word, 0, 120, 0});
  }
  bench.wait(1s);
  CHECK(bench.process.speed_rev_per_s == 2.0);
}
