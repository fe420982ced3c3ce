#pragma once
/// The feeder on a serial line: a float map in the trade's words, fixtures/boards/MODBUS.md.

#include <array>
#include <cstdint>

#include "plant_emulator/board/feeder_firmware.hpp"
#include "plant_emulator/board/rtu_board.hpp"

namespace meltbench::board {

/// Addresses as on the wire, from 0. 32-bit values take two registers in the order of kWordOrder; they are written as a
/// whole. MODBUS.md has units, ranges and access of each.
namespace feeder_register {
inline constexpr std::uint16_t kSetPoint = 0, kRefillLow = 2, kRefillHigh = 4, kLossOfMaster = 6, kWatchdog = 8,
                               kMode = 9, kWordOrder = 10, kSettings = 11;
/// The report: input registers from 0, and the same as holding registers from here, for function 23.
inline constexpr std::uint16_t kReport = 100;
inline constexpr std::uint16_t kFlow = 0, kFlowAge = 2, kChanges = 3, kStatus = 4, kAlarms = 5, kMassFlow = 6,
                               kNetWeight = 8, kDriveCommand = 10, kFeedFactor = 12, kTotalizer = 14, kActingMode = 16,
                               kReserved = 17, kSetPointInForce = 18, kMaxFlow = 20, kLatency = 22, kControlCycle = 24,
                               kReportSize = 26;
}  // namespace feeder_register

namespace feeder_coil {
inline constexpr std::uint16_t kRun = 0, kVolumetricMode = 1, kRefill = 2, kClearTotalizer = 3, kTare = 4, kCount = 5;
}
/// Bit of the status behind those of FeederStatus: the flow on loss of master has been written since power-up. A master
/// that has written it sees by this bit that the feeder was reset.
inline constexpr std::uint8_t kFeederConfigured = 0x80;
inline constexpr std::uint16_t kFeederInputs = 8;  ///< Discrete inputs: the bits of the status.

/// Alarms, register 105: the bits of FeederStatus that call for somebody.
inline constexpr std::uint8_t kFeederAlarms = kMasterLost | kHopperEmpty | kNotANumber;

/// The same firmware as on CAN. A write of the set point feeds the watchdog; if no more come, because nobody polls or
/// the line is cut, the flow goes to the one on loss of master and comes back with the next set point.
/// Refused as illegal value: not a number, a mode or word order that there is not, refill limits out of order; as
/// illegal address: half of a 32-bit value, what is read only; as device failure: a refill of a full hopper; as busy:
/// to tare while refilling.
class RtuFeeder final : public RtuBoard, private modbus::RegisterMap, private FeederListener {
 public:
  RtuFeeder(std::string name, std::uint8_t unit, const FeederSettings& settings, Chance chance, Process& process);

  void attach(modbus::RtuServer& server) override;
  [[nodiscard]] std::vector<std::uint8_t> units() const override { return {unit_}; }
  void start(Instant now) override;
  void on_time(Instant now) override;
  [[nodiscard]] Instant next_deadline() const override { return firmware_.watchdog_at(); }

  [[nodiscard]] Instant next_touch(Instant until) const override { return firmware_.next_touch(until); }
  void touch(Instant at) override { firmware_.touch(at); }
  void settle(Instant now) override { firmware_.move_to(now); }
  [[nodiscard]] std::span<const std::string_view> signal_names() const override {
    return FeederFirmware::signal_names();
  }
  void read_signals(std::span<double> values) const override { firmware_.read_signals(values); }

  [[nodiscard]] double flow_kg_per_h() const { return firmware_.flow_kg_per_h(); }

 private:
  /// The writable registers, so that a write can be judged as a whole before it is done.
  struct Orders {
    float set_point_kg_per_h, refill_low_kg, refill_high_kg, loss_of_master_kg_per_h;
    std::uint16_t watchdog_ms, mode;
    modbus::WordOrder word_order;
  };
  using Settings = std::array<std::uint16_t, feeder_register::kSettings>;
  using Report = std::array<std::uint16_t, feeder_register::kReportSize>;

  [[nodiscard]] bool supports(modbus::Function) const override { return true; }
  [[nodiscard]] bool covers(modbus::Table table, std::uint16_t first, std::uint16_t count,
                            bool to_write) const override;
  modbus::ExceptionCode read_registers(Instant now, modbus::Table table, std::uint16_t first,
                                       std::span<std::uint16_t> values) override;
  modbus::ExceptionCode write_registers(Instant now, std::uint16_t first,
                                        std::span<const std::uint16_t> values) override;
  modbus::ExceptionCode read_bits(Instant now, modbus::Table table, std::uint16_t first,
                                  std::span<bool> values) override;
  modbus::ExceptionCode write_coils(Instant now, std::uint16_t first, std::span<const bool> values) override;
  [[nodiscard]] modbus::Identity identity() const override;

  void on_hopper_empty(Instant at) override;
  void on_refill(Instant at, bool begins) override;

  void forget();
  void obey(Instant now, const Orders& orders, bool has_set_point);
  [[nodiscard]] Orders orders() const;
  [[nodiscard]] Settings encode(const Orders& orders) const;
  [[nodiscard]] Orders decode(const Settings& words) const;
  [[nodiscard]] Report make_report(Instant now);
  [[nodiscard]] bool is_coil_on(std::size_t coil) const;
  [[nodiscard]] std::uint8_t status() const;

  FeederFirmware firmware_;
  std::uint8_t unit_;
  modbus::WordOrder word_order_;
  float loss_of_master_kg_per_h_;
  std::uint16_t watchdog_ms_;
  bool configured_ = false;
};

}  // namespace meltbench::board
