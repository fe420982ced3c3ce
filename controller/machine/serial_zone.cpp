#include "controller/machine/serial_zone.hpp"

#include <array>
#include <cmath>
#include <string>
#include <utility>

#include "protocols/modbus/pdu.hpp"

namespace meltbench::machine {

namespace {

using namespace zone_register;

constexpr double kTenth = 0.1, kPerThousand = 1e-3;
constexpr std::uint16_t kPolled = 6;  // From kSetPoint to kRun.

std::string name_of(std::size_t channel) {
  return channel == kNozzleChannel ? "nozzle" : "zone " + std::to_string(channel);
}

std::uint8_t unit_of(const BoardSettings& board, std::size_t channel) {
  return static_cast<std::uint8_t>(board.unit + channel - 1);
}

}  // namespace

SerialZone::SerialZone(const ControllerSettings& settings, std::size_t channel)
    : SerialUnit{settings, settings.board(config::BoardKind::kHeater), name_of(channel),
                 unit_of(settings.board(config::BoardKind::kHeater), channel), kProductCode},
      high_alarm_{static_cast<std::uint16_t>(std::lround(settings.zones->limits.max_degC / kTenth))} {}

void SerialZone::want(Instant now, double set_degC, bool run) {
  set_ = static_cast<std::uint16_t>(std::lround(set_degC / kTenth));
  run_ = run;
  wanted_ = true;
  if (step_ != Step::kPoll || !is_asked()) return;  // It is on its way to be compared.
  choose_step();
  if (step_ != Step::kPoll) ask_at(now);
}

/// Off comes first, on comes last.
void SerialZone::choose_step() {
  const bool other_run = does_run_ != run_;
  if (other_run && !run_) {
    step_ = Step::kRun;
  } else if (does_set_ != set_) {
    step_ = Step::kSetPoint;
  } else if (other_run) {
    step_ = Step::kRun;
  }
}

modbus::Pdu SerialZone::make_own_request(Instant now) {
  switch (step_) {
    case Step::kHighAlarm:
      return modbus::make_write_register(zone_register::kHighAlarm, high_alarm_);
    case Step::kSetPoint:
      does_set_ = set_;  // Until the next poll says otherwise.
      return modbus::make_write_register(zone_register::kSetPoint, set_);
    case Step::kRun:
      does_run_ = run_;
      return modbus::make_write_register(zone_register::kRun, run_ ? 1 : 0);
    case Step::kPoll:
      break;
  }
  polled_at_ = now;
  return modbus::make_read(modbus::Function::kReadHoldingRegisters, zone_register::kSetPoint, kPolled);
}

void SerialZone::on_answer(Instant now, const modbus::ClientResult& result) {
  if (std::exchange(step_, Step::kPoll) != Step::kPoll) return ask_at(now);  // Reads back what was written.
  mark_configured();
  std::array<std::uint16_t, kPolled> words{};
  if (modbus::read_registers(result.answer, words)) {
    if ((words[kState] & kConfigured) == 0) return note_reset(now);
    report_ = {result.request_end,
               {.T_degC = kTenth * words[kTemperature],
                .sensor_good = words[kSensor] == 0,
                .output = kPerThousand * words[kOutput]}};
    does_set_ = words[zone_register::kSetPoint];
    does_run_ = words[zone_register::kRun] != 0;
    if (wanted_) choose_step();
  }
  ask_at(step_ == Step::kPoll ? polled_at_ + kPollPeriod : now);
}

std::optional<SerialZone::Report> SerialZone::take_report() {
  return std::exchange(report_, std::nullopt);
}

}  // namespace meltbench::machine
