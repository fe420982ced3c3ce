#include "controller/machine/serial_unit.hpp"

#include <fmt/format.h>

#include <utility>

#include "protocols/modbus/pdu.hpp"

namespace meltbench::machine {

namespace {

using Outcome = modbus::ClientResult::Outcome;
constexpr std::uint8_t kBasicIdentification = 1, kProductCodeObject = 1;

}  // namespace

SerialUnit::SerialUnit(const ControllerSettings& settings, const BoardSettings& board, std::string_view what,
                       std::uint8_t unit, std::string_view product_code)
    : label_{fmt::format("{} (unit {} on {})", what, unit, board.line)},
      unit_{unit},
      product_code_{product_code},
      timing_{timing_of(settings, board.line)},
      boot_timeout_{settings.boot_timeout} {}

modbus::Pdu SerialUnit::make_request(Instant now) {
  due_at_ = Instant::never();
  if (!boot_until_) boot_until_ = now + boot_timeout_;
  return known_ ? make_own_request(now) : modbus::make_read_identification(kBasicIdentification, 0);
}

void SerialUnit::on_result(Instant now, const modbus::ClientResult& result) {
  if (result.outcome == Outcome::kTimeout) return on_silence(now, result.attempts);
  if (std::exchange(lost_, false)) {
    news_ = fmt::format("{} answers again", label_);
    if (known_) {
      known_ = false;
      restart();
      return ask_at(now);
    }
  }
  if (result.outcome == Outcome::kException) {
    return complain(
        configured_ ? "device-refused" : "configuration-failed",
        fmt::format(" refuses a request: {}; is it the device that the rig says?", modbus::text(result.exception)));
  }
  known_ ? on_answer(now, result) : identify(now, result);
}

void SerialUnit::identify(Instant now, const modbus::ClientResult& result) {
  const std::string_view product = modbus::find_identification(result.answer, kProductCodeObject);
  if (product != product_code_) {
    return complain("identity-mismatch",
                    fmt::format(" says that it is \"{}\", expected \"{}\"", product, product_code_));
  }
  known_ = true;
  ask_at(now);
}

void SerialUnit::complain(std::string_view code, std::string_view what) {
  troubles_.push_back({code, fmt::format("{}{}", label_, what)});
}

void SerialUnit::note_reset(Instant now) {
  complain("device-reset", " was reset and has lost its configuration");
  known_ = false;
  restart();
  ask_at(now);
}

void SerialUnit::on_silence(Instant now, unsigned attempts) {
  due_at_ = now;
  if (!configured_) {
    if (now < *boot_until_) return;
    due_at_ = Instant::never();
    return complain("boot-timeout", fmt::format(" has not answered for {:.3g} s; power, wiring, unit and baud rate?",
                                                to_s(boot_timeout_)));
  }
  if (std::exchange(lost_, true)) return;
  complain("device-lost", fmt::format(": no answer to {} requests; has it lost power or its cable?", attempts));
}

std::optional<Trouble> SerialUnit::take_trouble() {
  if (troubles_.empty()) return {};
  Trouble trouble = std::move(troubles_.front());
  troubles_.erase(troubles_.begin());
  return trouble;
}

std::optional<std::string> SerialUnit::take_news() {
  return std::exchange(news_, std::nullopt);
}

}  // namespace meltbench::machine
