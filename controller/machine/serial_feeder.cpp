#include "controller/machine/serial_feeder.hpp"

#include <fmt/format.h>

#include <array>
#include <cmath>

namespace meltbench::machine {

namespace {

using namespace feeder_register;
using modbus::Function;
using Outcome = modbus::ClientResult::Outcome;

constexpr double kSecondsPerHour = 3600.0;
constexpr std::uint16_t kReportWords = 4;
constexpr std::uint16_t kTimesWords = 4;
constexpr std::uint8_t kBasicIdentification = 1, kProductCodeObject = 1;
constexpr std::uint16_t kOldest = 0xFFFF;                              // Of an age: so old or older.
constexpr std::size_t kPollRequestBytes = modbus::frame_size(10 + 4);  // Function 23 with one 32-bit value.

modbus::WordPair flow_words(double flow_kg_per_s, modbus::WordOrder order) {
  return modbus::to_words(static_cast<float>(flow_kg_per_s * kSecondsPerHour), order);
}

}  // namespace

SerialFeeder::SerialFeeder(const ControllerSettings& settings, double safe_flow_kg_per_s)
    : timing_{timing_of(settings, settings.board(config::BoardKind::kFeeder).line)},
      boot_timeout_{settings.boot_timeout},
      watchdog_ms_{settings.feeder_watchdog_ms},
      safe_flow_kg_per_s_{safe_flow_kg_per_s} {
  const BoardSettings& board = settings.board(config::BoardKind::kFeeder);
  unit_ = board.unit;
  label_ = fmt::format("{} (unit {} on {})", board.name, board.unit, board.line);
}

FeederFacts SerialFeeder::facts(const BusManager& /*bus*/) const {
  return {.latency = facts_.latency + timing_.on_wire(kPollRequestBytes), .cycle = facts_.cycle};
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
  if (step_ == Step::kPoll && due_at_ == Instant::never()) due_at_ = now;
}

modbus::Pdu SerialFeeder::make_safe_flow() const {
  const modbus::WordPair flow = flow_words(safe_flow_kg_per_s_, word_order_);
  if (!watchdog_ms_) return modbus::make_write_registers(kLossOfMaster, flow);
  return modbus::make_write_registers(kLossOfMaster, std::array{flow[0], flow[1], *watchdog_ms_});
}

modbus::Pdu SerialFeeder::make_request(Instant now) {
  due_at_ = Instant::never();
  if (!boot_until_) boot_until_ = now + boot_timeout_;
  switch (step_) {
    case Step::kIdentify:
      return modbus::make_read_identification(kBasicIdentification, 0);
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

void SerialFeeder::on_result(Instant now, const modbus::ClientResult& result) {
  if (result.outcome == Outcome::kTimeout) return on_silence(now, result.attempts);
  if (lost_) {
    lost_ = false;
    news_ = fmt::format("{} answers again", label_);
    if (step_ == Step::kPoll) return advance_to(Step::kIdentify, now);
  }
  if (result.outcome == Outcome::kException) {
    complain(was_ready_ ? "device-refused" : "configuration-failed",
             fmt::format("{} refuses a request: {}; is it the device that the rig says?", label_,
                         modbus::text(result.exception)));
    due_at_ = was_ready_ ? Instant::never() : now + boot_timeout_;
    return;
  }
  on_answer(now, result);
}

void SerialFeeder::on_answer(Instant now, const modbus::ClientResult& result) {
  std::array<std::uint16_t, kTimesWords> words{};
  switch (step_) {
    case Step::kIdentify: {
      const std::string_view product = modbus::find_identification(result.answer, kProductCodeObject);
      if (product != kProductCode) {
        return complain("identity-mismatch",
                        fmt::format("{} says that it is \"{}\", expected \"{}\"", label_, product, kProductCode));
      }
      return advance_to(Step::kWordOrder, now);
    }
    case Step::kWordOrder:
      static_cast<void>(modbus::read_registers(result.answer, std::span{words}.first(1)));
      word_order_ = words[0] == 0 ? modbus::WordOrder::kHighFirst : modbus::WordOrder::kLowFirst;
      return advance_to(Step::kSafeFlow, now);
    case Step::kSafeFlow:
      return advance_to(was_ready_ ? Step::kPoll : Step::kTimes, now);
    case Step::kTimes:
      static_cast<void>(modbus::read_registers(result.answer, words));
      facts_ = {.latency = modbus::to_u32(words, word_order_) * 1us,
                .cycle = modbus::to_u32(std::span{words}.subspan(2), word_order_) * 1us};
      was_ready_ = true;
      return advance_to(Step::kPoll, now);
    case Step::kPoll:
      take_report(result);
      if (!safe_flow_told_) advance_to(Step::kSafeFlow, now);
  }
}

void SerialFeeder::take_report(const modbus::ClientResult& result) {
  std::array<std::uint16_t, kReportWords> words{};
  if (!modbus::read_registers(result.answer, words)) return;
  const float flow_kg_per_h = modbus::to_float(words, word_order_);
  if (!std::isfinite(flow_kg_per_h)) return;
  std::optional<Nanos> age;
  if (words[2] != kOldest) age = words[2] * 10us;
  sample_ = {result.request_end, static_cast<double>(flow_kg_per_h) / kSecondsPerHour, age,
             static_cast<std::uint8_t>(words[3])};
}

void SerialFeeder::on_silence(Instant now, unsigned attempts) {
  due_at_ = now;
  if (!was_ready_) {
    if (now < *boot_until_) return;
    due_at_ = Instant::never();
    return complain("boot-timeout", fmt::format("{} has not answered for {:.3g} s; power, wiring, unit and baud rate?",
                                                label_, to_s(boot_timeout_)));
  }
  if (lost_) return;
  lost_ = true;
  complain("device-lost",
           fmt::format("{}: no answer to {} requests; has it lost power or its cable?", label_, attempts));
}

void SerialFeeder::advance_to(Step step, Instant now) {
  step_ = step;
  due_at_ = now;
}

void SerialFeeder::complain(std::string_view code, std::string text) {
  troubles_.push_back({code, std::move(text)});
}

std::optional<Trouble> SerialFeeder::take_trouble() {
  if (troubles_.empty()) return {};
  Trouble trouble = std::move(troubles_.front());
  troubles_.erase(troubles_.begin());
  return trouble;
}

std::optional<std::string> SerialFeeder::take_news() {
  return std::exchange(news_, std::nullopt);
}

}  // namespace meltbench::machine
