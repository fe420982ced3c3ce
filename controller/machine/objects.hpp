#pragma once
/// What the controller uses of the boards' object dictionaries, as their EDS files say, and the bytes of their PDOs.

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>

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
inline constexpr unsigned kVelocityRpdo = 3;
inline constexpr unsigned kMotionTpdo = 3;
}  // namespace drive_object

namespace pressure_object {
inline constexpr canopen::ObjectAddress kAge{0x2001, 0};              ///< U16, us.
inline constexpr canopen::ObjectAddress kLatency{0x2002, 0};          ///< U32, us.
inline constexpr canopen::ObjectAddress kSamplePeriod{0x6114, 1};     ///< U32, us.
inline constexpr canopen::ObjectAddress kUnit{0x6131, 1};             ///< U32, CiA 303-2.
inline constexpr canopen::ObjectAddress kDigits{0x6132, 1};           ///< U8.
inline constexpr canopen::ObjectAddress kStatus{0x6150, 1};           ///< U8, 0 = good.
inline constexpr canopen::ObjectAddress kPressure{0x9130, 1};         ///< I32, 10^-digits of the unit.
inline constexpr canopen::ObjectAddress kMeltStatus{0x6150, 2};       ///< U8, 0 = good.
inline constexpr canopen::ObjectAddress kMeltTemperature{0x9130, 2};  ///< I32, 0.1 °C.
inline constexpr std::uint32_t kUnitBar = 0x004E0000;
inline constexpr unsigned kSampleTpdo = 1;
inline constexpr unsigned kMeltTpdo = 3;
}  // namespace pressure_object

namespace camera_object {
inline constexpr canopen::ObjectAddress kAge{0x2001, 0};           ///< U16, 10 us.
inline constexpr canopen::ObjectAddress kLatency{0x2002, 0};       ///< U32, us.
inline constexpr canopen::ObjectAddress kImage{0x2003, 0};         ///< U8, counts modulo 256.
inline constexpr canopen::ObjectAddress kSamplePeriod{0x6114, 1};  ///< U32, us.
inline constexpr canopen::ObjectAddress kUnit{0x6131, 1};          ///< U32, CiA 303-2.
inline constexpr canopen::ObjectAddress kDigits{0x6132, 1};        ///< U8.
inline constexpr canopen::ObjectAddress kStatus{0x6150, 1};        ///< U8, 0 = good.
inline constexpr canopen::ObjectAddress kFront{0x9130, 1};         ///< I32, 10^-digits of the unit.
inline constexpr std::uint32_t kUnitMetre = 0x00010000;
inline constexpr unsigned kFrontTpdo = 1;
}  // namespace camera_object

namespace preconditioner_object {
inline constexpr canopen::ObjectAddress kSetPoint{0x6402, 1};      ///< REAL32, °C.
inline constexpr canopen::ObjectAddress kFeedforward{0x2000, 0};   ///< REAL32, W/m².
inline constexpr canopen::ObjectAddress kGain{0x2001, 0};          ///< REAL32, W/(m² K).
inline constexpr canopen::ObjectAddress kMode{0x2002, 0};          ///< U8, see PreconditionerMode.
inline constexpr canopen::ObjectAddress kLatency{0x2007, 0};       ///< U32, us.
inline constexpr canopen::ObjectAddress kAge{0x2010, 0};           ///< U16, us.
inline constexpr canopen::ObjectAddress kState{0x2011, 0};         ///< U8.
inline constexpr canopen::ObjectAddress kMeanFlux{0x2012, 0};      ///< REAL32, W/m², since the SYNC before.
inline constexpr canopen::ObjectAddress kSamplePeriod{0x6114, 1};  ///< U32, us.
inline constexpr canopen::ObjectAddress kTemperature{0x6130, 1};   ///< REAL32, °C.
inline constexpr canopen::ObjectAddress kStatus{0x6150, 1};        ///< U8, 0 = good.
inline constexpr canopen::ObjectAddress kFlux{0x6410, 1};          ///< REAL32, W/m², now.
inline constexpr unsigned kSetPointRpdo = 1;
inline constexpr unsigned kModeRpdo = 2;
inline constexpr unsigned kTemperatureTpdo = 1;
inline constexpr unsigned kFluxTpdo = 2;
}  // namespace preconditioner_object

namespace heater_object {
inline constexpr std::uint16_t kSetPoint = 0x7402;                ///< I16 per channel, 0.1 °C.
inline constexpr std::uint16_t kTemperature = 0x7130;             ///< I16 per channel, 0.1 °C.
inline constexpr std::uint16_t kStatus = 0x6150;                  ///< U8 per channel, 0 = good.
inline constexpr std::uint16_t kOutput = 0x7410;                  ///< I16 per channel, 0.1 % of full power.
inline constexpr std::uint16_t kSensorType = 0x6110;              ///< U16 per channel, 0 = not fitted.
inline constexpr std::uint16_t kZoneState = 0x2102;               ///< U8 per channel.
inline constexpr std::uint16_t kHighAlarm = 0x2100;               ///< I16 per channel, 0.1 °C.
inline constexpr std::uint16_t kAutotune = 0x2110;                ///< U8 per channel, 1 starts.
inline constexpr std::uint16_t kAutotuneState = 0x2111;           ///< U8 per channel.
inline constexpr std::uint16_t kProportionalBand = 0x7450;        ///< I16 per channel, 0.1 K.
inline constexpr std::uint16_t kIntegralTime = 0x7452;            ///< I16 per channel, 0.1 s.
inline constexpr std::uint16_t kDerivativeTime = 0x7454;          ///< I16 per channel, 0.1 s.
inline constexpr canopen::ObjectAddress kRelease{0x2000, 0};      ///< U8, bit n - 1 = channel n.
inline constexpr canopen::ObjectAddress kBoardStatus{0x2001, 0};  ///< U8.
inline constexpr std::uint8_t kZoneTunes = 0x40;                  ///< Bit of kZoneState.
inline constexpr std::uint8_t kAutotuneDone = 2;                  ///< Value of kAutotuneState.
inline constexpr unsigned kBarrelRpdo = 1;
inline constexpr unsigned kNozzleRpdo = 2;
inline constexpr unsigned kFirstPairTpdo = 1;   ///< Temperature, status, state of channels 1 and 2.
inline constexpr unsigned kSecondPairTpdo = 2;  ///< Of channels 3 and 4.
inline constexpr unsigned kOutputTpdo = 3;      ///< Outputs of channels 1 to 4.
inline constexpr unsigned kNozzleTpdo = 4;      ///< All of channel 5, and the board's status.
}  // namespace heater_object

/// The boards' own watchdog for set points, of feeder, heater and preconditioner. Over as soon as they come again.
inline constexpr std::uint16_t kEmcyNoSetPoints = 0xFF01;
/// And of a feeder that has nothing left.
inline constexpr std::uint16_t kEmcyHopperEmpty = 0xFF02;
/// Heater: a zone could not be tuned and goes on as before.
inline constexpr std::uint16_t kEmcyAutotune = 0xFF14;

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

/// The camera's.
struct FrontReport {
  std::int32_t front_counts = 0;
  std::uint8_t status = 0;
  std::uint16_t age_10us = 0;  ///< 0xFFFF: so old or older.
};

/// The preconditioner's.
struct InletReport {
  float T_degC = 0.0F;
  std::uint16_t age_us = 0;  ///< 0xFFFF: so old or older.
  std::uint8_t status = 0;
  std::uint8_t state = 0;
};

/// Temperature and status of one heated zone.
struct ZoneTemperature {
  std::int16_t T_0p1degC = 0;
  std::uint8_t status = 0;
  std::uint8_t state = 0;  ///< Of a zone: heater_object::kZoneState.
};

enum class PreconditionerMode : std::uint8_t { kOff = 0, kDirectFlux = 1, kInnerLoop = 2 };

inline constexpr std::uint16_t kAgeSaturated = 0xFFFF;

/// Read a PDO as the boot has mapped it. Nothing if the frame is too short or carries no data.
[[nodiscard]] std::optional<FeederReport> parse_feeder_report(const can::CanFrame& frame);
[[nodiscard]] std::optional<MotionReport> parse_motion_report(const can::CanFrame& frame);
[[nodiscard]] std::optional<PressureReport> parse_pressure_report(const can::CanFrame& frame);

[[nodiscard]] std::optional<FrontReport> parse_front_report(const can::CanFrame& frame);
[[nodiscard]] std::optional<InletReport> parse_inlet_report(const can::CanFrame& frame);
/// Mean flux since the SYNC before [W/m²].
[[nodiscard]] std::optional<float> parse_flux_report(const can::CanFrame& frame);
/// Melt temperature in 0.1 °C and its status.
[[nodiscard]] std::optional<ZoneTemperature> parse_melt_temperature(const can::CanFrame& frame);
/// Two zones of one heater PDO; `second` may be absent from a PDO of one zone.
[[nodiscard]] std::optional<ZoneTemperature> parse_zone(const can::CanFrame& frame, bool second);
/// Output of the n-th of four zones in 0.1 % of full power.
[[nodiscard]] std::optional<std::int16_t> parse_output(const can::CanFrame& frame, std::size_t byte);

/// Set point PDO of a feeder.
[[nodiscard]] can::CanFrame make_feed_command(std::uint8_t node_id, float flow_kg_per_h);
/// Controlword PDO of a drive.
[[nodiscard]] can::CanFrame make_controlword(std::uint8_t node_id, std::uint16_t controlword);
/// Control word and target velocity PDO of a drive.
[[nodiscard]] can::CanFrame make_velocity(std::uint8_t node_id, std::uint16_t controlword, std::int32_t inc_per_s);
/// The two PDOs of the preconditioner: both are taken over at its next cycle.
[[nodiscard]] can::CanFrame make_inlet_set_point(std::uint8_t node_id, float T_degC, float feedforward_W_per_m2);
[[nodiscard]] can::CanFrame make_inlet_mode(std::uint8_t node_id, float gain_W_per_m2K, PreconditionerMode mode);
/// Set points of the barrel zones in 0.1 °C.
[[nodiscard]] can::CanFrame make_zone_set_points(std::uint8_t node_id, std::span<const std::int16_t, 4> T_0p1degC);
/// Set point of the nozzle in 0.1 °C, and the zones that may heat: bit n - 1 = channel n.
[[nodiscard]] can::CanFrame make_zone_release(std::uint8_t node_id, std::int16_t T_0p1degC, std::uint8_t release);

}  // namespace meltbench::machine
