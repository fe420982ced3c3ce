#pragma once
/// What the controller uses of the boards' object dictionaries, as their EDS files say, and the bytes of their PDOs.

#include <cstdint>
#include <optional>

#include "protocols/can/frame.hpp"
#include "protocols/canopen/types.hpp"

namespace meltbench::machine {

namespace feeder_object {
inline constexpr canopen::ObjectAddress kSetPoint{0x2000, 0};          ///< REAL32, kg/h.
inline constexpr canopen::ObjectAddress kDelivered{0x2001, 0};         ///< REAL32, kg/h.
inline constexpr canopen::ObjectAddress kDeliveredAge{0x2002, 0};      ///< U16, 10 us.
inline constexpr canopen::ObjectAddress kStatus{0x2003, 0};            ///< U8.
inline constexpr canopen::ObjectAddress kChanges{0x2004, 0};           ///< U8, counts modulo 256.
inline constexpr canopen::ObjectAddress kLossOfMasterFlow{0x2005, 0};  ///< REAL32, kg/h.
inline constexpr canopen::ObjectAddress kWatchdog{0x2006, 0};          ///< U16, ms.
inline constexpr canopen::ObjectAddress kLatency{0x2007, 0};           ///< U32, us.
inline constexpr canopen::ObjectAddress kMaxFlow{0x2009, 0};           ///< REAL32, kg/h.
inline constexpr canopen::ObjectAddress kControlCycle{0x200A, 0};      ///< U32, us.
inline constexpr unsigned kSetPointRpdo = 1;
inline constexpr unsigned kReportTpdo = 1;
/// EMCY of the feeder's own watchdog: no set points. Over as soon as they come again.
inline constexpr std::uint16_t kEmcyNoSetPoints = 0xFF01;
}  // namespace feeder_object

namespace drive_object {
inline constexpr canopen::ObjectAddress kAbortConnectionOption{0x6007, 0};  ///< I16.
inline constexpr canopen::ObjectAddress kControlword{0x6040, 0};            ///< U16.
inline constexpr canopen::ObjectAddress kStatusword{0x6041, 0};             ///< U16.
inline constexpr canopen::ObjectAddress kMode{0x6060, 0};                   ///< I8.
inline constexpr canopen::ObjectAddress kPosition{0x6064, 0};               ///< I32, increments, wraps.
inline constexpr canopen::ObjectAddress kVelocityDemand{0x606B, 0};         ///< I32, increments/s.
inline constexpr canopen::ObjectAddress kVelocity{0x606C, 0};               ///< I32, increments/s.
inline constexpr canopen::ObjectAddress kEncoderIncrements{0x608F, 1};      ///< U32, per ...
inline constexpr canopen::ObjectAddress kEncoderRevolutions{0x608F, 2};     ///< U32, ... so many turns.
inline constexpr canopen::ObjectAddress kTargetVelocity{0x60FF, 0};         ///< I32, increments/s.
inline constexpr unsigned kControlwordRpdo = 1;
inline constexpr unsigned kMotionTpdo = 3;
}  // namespace drive_object

namespace pressure_object {
inline constexpr canopen::ObjectAddress kAge{0x2001, 0};           ///< U16, us.
inline constexpr canopen::ObjectAddress kLatency{0x2002, 0};       ///< U32, us.
inline constexpr canopen::ObjectAddress kSamplePeriod{0x6114, 1};  ///< U32, us.
inline constexpr canopen::ObjectAddress kUnit{0x6131, 1};          ///< U32, CiA 303-2.
inline constexpr canopen::ObjectAddress kDigits{0x6132, 1};        ///< U8.
inline constexpr canopen::ObjectAddress kStatus{0x6150, 1};        ///< U8, 0 = good.
inline constexpr canopen::ObjectAddress kPressure{0x9130, 1};      ///< I32, 10^-digits of the unit.
inline constexpr std::uint32_t kUnitBar = 0x004E0000;
inline constexpr unsigned kSampleTpdo = 1;
}  // namespace pressure_object

/// The feeder's answer to a SYNC.
struct FeederReport {
  float flow_kg_per_h = 0.0F;
  std::uint16_t age_10us = 0;  ///< 0xFFFF: so old or older.
  std::uint8_t status = 0;
  std::uint8_t changes = 0;
};

/// The screw drive's.
struct MotionReport {
  std::int32_t position_inc = 0;
  std::int32_t velocity_inc_per_s = 0;
};

/// The pressure transmitter's.
struct PressureReport {
  std::int32_t pressure_counts = 0;
  std::uint8_t status = 0;
  std::uint16_t age_us = 0;  ///< 0xFFFF: so old or older.
};

inline constexpr std::uint16_t kAgeSaturated = 0xFFFF;

/// Read a PDO as the boot has mapped it. Nothing if the frame is too short or carries no data.
[[nodiscard]] std::optional<FeederReport> parse_feeder_report(const can::CanFrame& frame);
[[nodiscard]] std::optional<MotionReport> parse_motion_report(const can::CanFrame& frame);
[[nodiscard]] std::optional<PressureReport> parse_pressure_report(const can::CanFrame& frame);

/// Set point PDO of a feeder.
[[nodiscard]] can::CanFrame make_feed_command(std::uint8_t node_id, float flow_kg_per_h);
/// Controlword PDO of a drive.
[[nodiscard]] can::CanFrame make_controlword(std::uint8_t node_id, std::uint16_t controlword);

}  // namespace meltbench::machine
