#pragma once
/// The feeder on a serial line: configured and polled by Modbus RTU, fixtures/boards/MODBUS.md.

#include <cstdint>
#include <optional>
#include <string_view>

#include "controller/machine/feeder_wire.hpp"
#include "controller/machine/serial_unit.hpp"
#include "controller/machine/settings.hpp"
#include "protocols/modbus/pdu.hpp"

namespace meltbench::machine {

/// What the controller uses of the feeder's registers, from 0.
namespace feeder_register {
inline constexpr std::uint16_t kSetPoint = 0;      ///< REAL32, kg/h.
inline constexpr std::uint16_t kLossOfMaster = 6;  ///< REAL32, kg/h.
inline constexpr std::uint16_t kWatchdog = 8;      ///< ms.
inline constexpr std::uint16_t kWordOrder = 10;    ///< Of the 32-bit values.
inline constexpr std::uint16_t kReport = 100;      ///< Flow: REAL32, kg/h; its age, 10 us; changes modulo 256; status.
inline constexpr std::uint16_t kHopperEmpty = 0x08;  ///< Bits of the status: nothing left to deliver;
inline constexpr std::uint16_t kConfigured = 0x80;   ///< it has been told its safe flow since power-up.
inline constexpr std::uint16_t kLatency = 122;       ///< U32, us.
inline constexpr std::uint16_t kControlCycle = 124;  ///< U32, us.
}  // namespace feeder_register

/// Asked who it is, told its safe flow and watchdog, asked for its times; then one request per SYNC period that writes
/// the newest set point and reads what is delivered (function 23). A report is one of the instant at which the request
/// had arrived. If requests take longer than a period, the next one leaves when the line is free.
class SerialFeeder final : public FeederWire, public SerialUnit {
 public:
  /// @param safe_flow_kg_per_s  on loss of its master.
  SerialFeeder(const ControllerSettings& settings, double safe_flow_kg_per_s);

  // FeederWire
  [[nodiscard]] FeederFacts facts(const BusManager& bus) const override;
  [[nodiscard]] bool reports_at_sync() const override { return false; }
  [[nodiscard]] SerialUnit* serial() override { return this; }
  void command(Instant now, double flow_kg_per_s, Outbox& out) override;
  void set_safe_flow(Instant now, double flow_kg_per_s, BusManager& bus, Outbox& out) override;
  void end_cycle(Instant now) override;

  static constexpr std::string_view kProductCode = "LIW-1";

 private:
  enum class Step : std::uint8_t { kWordOrder, kSafeFlow, kTimes, kPoll };

  [[nodiscard]] modbus::Pdu make_own_request(Instant now) override;
  void on_answer(Instant now, const modbus::ClientResult& result) override;
  void restart() override { step_ = Step::kWordOrder; }
  void take_report(Instant now, const modbus::ClientResult& result);
  void advance_to(Step step, Instant now);
  [[nodiscard]] modbus::Pdu make_safe_flow() const;

  std::optional<std::uint16_t> watchdog_ms_;
  Step step_ = Step::kWordOrder;
  modbus::WordOrder word_order_ = modbus::WordOrder::kHighFirst;
  FeederFacts facts_;
  double safe_flow_kg_per_s_;
  bool safe_flow_told_ = true;
  bool empty_ = false;
  std::optional<double> flow_kg_per_s_;  // To be written with the next request.
};

}  // namespace meltbench::machine
