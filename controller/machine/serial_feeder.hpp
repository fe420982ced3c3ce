#pragma once
/// The feeder on a serial line: configured and polled by Modbus RTU, fixtures/boards/MODBUS.md.

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "controller/machine/feeder_wire.hpp"
#include "controller/machine/serial_master.hpp"
#include "controller/machine/settings.hpp"
#include "protocols/modbus/pdu.hpp"

namespace meltbench::machine {

/// What the controller uses of the feeder's registers, from 0.
namespace feeder_register {
inline constexpr std::uint16_t kSetPoint = 0;        ///< REAL32, kg/h.
inline constexpr std::uint16_t kLossOfMaster = 6;    ///< REAL32, kg/h.
inline constexpr std::uint16_t kWatchdog = 8;        ///< ms.
inline constexpr std::uint16_t kWordOrder = 10;      ///< Of the 32-bit values.
inline constexpr std::uint16_t kReport = 100;        ///< Flow now: REAL32, kg/h; its age, 10 us; changes modulo 256.
inline constexpr std::uint16_t kLatency = 122;       ///< U32, us.
inline constexpr std::uint16_t kControlCycle = 124;  ///< U32, us.
}  // namespace feeder_register

/// Asked who it is, told its safe flow and watchdog, asked for its times; then one request per SYNC period that writes
/// the newest set point and reads what is delivered (function 23). A report is one of the instant at which the request
/// had arrived. If requests take longer than a period, the next one leaves when the line is free.
///
/// No answer to a request and its repetitions: trouble device-lost, once. It is asked on; when it answers again that is
/// told (take_news()), and since it may have lost power, it is configured anew.
/// Other troubles: boot-timeout, identity-mismatch, configuration-failed (before it is ready), device-refused.
class SerialFeeder final : public FeederWire, public SerialDevice {
 public:
  /// @param safe_flow_kg_per_s  on loss of its master.
  SerialFeeder(const ControllerSettings& settings, double safe_flow_kg_per_s);

  // FeederWire
  [[nodiscard]] bool is_ready() const override { return was_ready_; }
  [[nodiscard]] FeederFacts facts(const BusManager& bus) const override;
  [[nodiscard]] bool reports_at_sync() const override { return false; }
  [[nodiscard]] SerialDevice* serial() override { return this; }
  void command(Instant now, double flow_kg_per_s, Outbox& out) override;
  void set_safe_flow(Instant now, double flow_kg_per_s, BusManager& bus, Outbox& out) override;
  void end_cycle(Instant now) override;
  [[nodiscard]] std::optional<Trouble> take_trouble() override;
  [[nodiscard]] std::optional<std::string> take_news() override;

  // SerialDevice
  [[nodiscard]] std::uint8_t unit() const override { return unit_; }
  [[nodiscard]] Instant next_request_at() const override { return due_at_; }
  [[nodiscard]] modbus::Pdu make_request(Instant now) override;
  void on_result(Instant now, const modbus::ClientResult& result) override;

  static constexpr std::string_view kProductCode = "LIW-1";

 private:
  enum class Step : std::uint8_t { kIdentify, kWordOrder, kSafeFlow, kTimes, kPoll };

  void on_answer(Instant now, const modbus::ClientResult& result);
  void on_silence(Instant now, unsigned attempts);
  void take_report(const modbus::ClientResult& result);
  void advance_to(Step step, Instant now);
  void complain(std::string_view code, std::string text);
  [[nodiscard]] modbus::Pdu make_safe_flow() const;

  std::string label_;
  std::uint8_t unit_;
  modbus::LineTiming timing_;
  Nanos boot_timeout_;
  std::optional<std::uint16_t> watchdog_ms_;
  Step step_ = Step::kIdentify;
  Instant due_at_{};
  std::optional<Instant> boot_until_;
  modbus::WordOrder word_order_ = modbus::WordOrder::kHighFirst;
  FeederFacts facts_;
  double safe_flow_kg_per_s_;
  bool safe_flow_told_ = true;
  std::optional<double> flow_kg_per_s_;  // To be written with the next request.
  bool was_ready_ = false;
  bool lost_ = false;
  std::vector<Trouble> troubles_;
  std::optional<std::string> news_;
};

}  // namespace meltbench::machine
