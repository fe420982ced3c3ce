#include "controller/machine/serial_feeder.hpp"

#include <array>
#include <cmath>
#include <utility>

namespace meltbench::machine {

namespace {

using namespace feeder_register;
using modbus::Function;

constexpr double kSecondsPerHour = 3600.0;
constexpr std::uint16_t kReportWords = 5;
constexpr std::uint16_t kTimesWords = 4;
constexpr std::uint16_t kOldest = 0xFFFF;                              // Of an age: so old or older.
constexpr std::size_t kPollRequestBytes = modbus::frame_size(10 + 4);  // Function 23 with one 32-bit value.

modbus::WordPair flow_words(double flow_kg_per_s, modbus::WordOrder order) {
  return modbus::to_words(static_cast<float>(flow_kg_per_s * kSecondsPerHour), order);
}

}  // namespace

SerialFeeder::SerialFeeder(const ControllerSettings& settings, double safe_flow_kg_per_s)
    : SerialUnit{settings, settings.board(config::BoardKind::kFeeder), settings.board(config::BoardKind::kFeeder).name,
                 settings.board(config::BoardKind::kFeeder).unit, kProductCode},
      watchdog_ms_{settings.feeder_watchdog_ms},
      safe_flow_kg_per_s_{safe_flow_kg_per_s} {}

FeederFacts SerialFeeder::facts(const BusManager& /*bus*/) const {
  return {.latency = facts_.latency + timing().on_wire(kPollRequestBytes), .cycle = facts_.cycle};
}

// --- what is asked of it

void SerialFeeder::command(Instant now, double flow_kg_per_s, Outbox& /*out*/) {
  flow_kg_per_s_ = flow_kg_per_s;
  end_cycle(now);
}

void SerialFeeder::set_safe_flow(Instant /*now*/, double flow_kg_per_s, BusManager& /*bus*/, Outbox& /*out*/) {
  safe_flow_kg_per_s_ = flow_kg_per_s;
  safe_flow_told_ = false;
}

void SerialFeeder::end_cycle(Instant now) {
  if (is_known() && step_ == Step::kPoll && !is_asked()) ask_at(now);
}

modbus::Pdu SerialFeeder::make_safe_flow() const {
  const modbus::WordPair flow = flow_words(safe_flow_kg_per_s_, word_order_);
  if (!watchdog_ms_) return modbus::make_write_registers(kLossOfMaster, flow);
  return modbus::make_write_registers(kLossOfMaster, std::array{flow[0], flow[1], *watchdog_ms_});
}

modbus::Pdu SerialFeeder::make_own_request(Instant now) {
  switch (step_) {
    case Step::kWordOrder:
      return modbus::make_read(Function::kReadHoldingRegisters, kWordOrder, 1);
    case Step::kSafeFlow:
      safe_flow_told_ = true;
      return make_safe_flow();
    case Step::kTimes:
      return modbus::make_read(Function::kReadHoldingRegisters, kLatency, kTimesWords);
    case Step::kPoll:
      break;
  }
  if (!flow_kg_per_s_) return modbus::make_read(Function::kReadHoldingRegisters, kReport, kReportWords);
  sent_ = {now, *flow_kg_per_s_};
  return modbus::make_read_write(kReport, kReportWords, kSetPoint, flow_words(*flow_kg_per_s_, word_order_));
}

// --- what it answers

void SerialFeeder::on_answer(Instant now, const modbus::ClientResult& result) {
  std::array<std::uint16_t, kTimesWords> words{};
  switch (step_) {
    case Step::kWordOrder:
      static_cast<void>(modbus::read_registers(result.answer, std::span{words}.first(1)));
      word_order_ = words[0] == 0 ? modbus::WordOrder::kHighFirst : modbus::WordOrder::kLowFirst;
      return advance_to(Step::kSafeFlow, now);
    case Step::kSafeFlow:
      return advance_to(is_configured() ? Step::kPoll : Step::kTimes, now);
    case Step::kTimes:
      static_cast<void>(modbus::read_registers(result.answer, words));
      facts_ = {.latency = modbus::to_u32(words, word_order_) * 1us,
                .cycle = modbus::to_u32(std::span{words}.subspan(2), word_order_) * 1us};
      mark_configured();
      return advance_to(Step::kPoll, now);
    case Step::kPoll:
      take_report(now, result);
      if (step_ == Step::kPoll && !safe_flow_told_) advance_to(Step::kSafeFlow, now);
  }
}

void SerialFeeder::take_report(Instant now, const modbus::ClientResult& result) {
  std::array<std::uint16_t, kReportWords> words{};
  if (!modbus::read_registers(result.answer, words)) return;
  if ((words[4] & kConfigured) == 0) return note_reset(now);
  const bool empty = (words[4] & kHopperEmpty) != 0;
  if (empty && !std::exchange(empty_, empty)) complain("feeder-empty", ": the hopper is empty");
  empty_ = empty;
  const float flow_kg_per_h = modbus::to_float(words, word_order_);
  if (!std::isfinite(flow_kg_per_h)) return;
  std::optional<Nanos> age;
  if (words[2] != kOldest) age = words[2] * 10us;
  sample_ = {result.request_end, static_cast<double>(flow_kg_per_h) / kSecondsPerHour, age,
             static_cast<std::uint8_t>(words[3])};
}

void SerialFeeder::advance_to(Step step, Instant now) {
  step_ = step;
  ask_at(now);
}

}  // namespace meltbench::machine
