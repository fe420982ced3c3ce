#include "protocols/canopen/manager.hpp"

#include <algorithm>
#include <utility>

#include <fmt/format.h>

namespace meltbench::canopen {
namespace {

std::uint16_t offset_index(std::uint16_t first, unsigned number) {
  return static_cast<std::uint16_t>(first + number - 1);
}

/// Numbers of up to 8 bytes as hex with their width, anything longer as its size.
std::string describe(std::span<const std::uint8_t> value) {
  if (value.empty()) return "empty";
  if (value.size() > 8) return fmt::format("a value of {} bytes", value.size());
  std::uint64_t number = 0;
  std::memcpy(&number, value.data(), value.size());
  return fmt::format("0x{:0{}X}", number, 2 * value.size());
}

}  // namespace

can::CanFrame make_nmt_command(NmtCommand command, std::uint8_t node) {
  return can::make_frame(cob_id::kNmt, {static_cast<std::uint8_t>(command), node});
}

can::CanFrame make_sync(std::optional<std::uint8_t> counter) {
  return counter ? can::make_frame(cob_id::kSync, {*counter}) : can::make_frame(cob_id::kSync, {});
}

void PeriodicTimer::start(Instant first, Nanos period) {
  due_ = first;
  period_ = period;
}

bool PeriodicTimer::take(Instant now) {
  if (now < due_) return false;
  const std::int64_t late_periods = (now - due_) / period_;
  missed_ += static_cast<std::uint64_t>(late_periods);
  due_ += period_ * (late_periods + 1);
  return true;
}

void PdoConfiguration::append_steps(std::vector<SdoStep>& steps) const {
  const std::uint16_t parameters = offset_index(pdo_parameter_index(direction), number);
  const std::uint16_t map = offset_index(pdo_mapping_index(direction), number);
  const std::string purpose = fmt::format("{}PDO{}", direction == PdoDirection::kReceive ? "R" : "T", number);
  const std::uint32_t cob_id =
      id | (extended ? kCobIdExtended : 0U) | (direction == PdoDirection::kTransmit ? kPdoNoRemote : 0U);

  steps.push_back(write_step(parameters, 1, cob_id | kPdoInvalid, purpose + ": switch off"));
  steps.push_back(write_step(parameters, 2, type, purpose + ": transmission type"));
  if (inhibit_100us) steps.push_back(write_step(parameters, 3, *inhibit_100us, purpose + ": inhibit time"));
  if (event_ms) steps.push_back(write_step(parameters, 5, *event_ms, purpose + ": event timer"));
  if (sync_start) steps.push_back(write_step(parameters, 6, *sync_start, purpose + ": SYNC start value"));
  if (!mapping.empty()) {
    steps.push_back(write_step(map, 0, std::uint8_t{0}, purpose + ": close the mapping"));
    std::uint8_t sub = 0;
    for (const Item& item : mapping) {
      const auto entry = static_cast<std::uint32_t>(item.address.index << 16 | item.address.sub << 8 | item.bits);
      steps.push_back(write_step(map, ++sub, entry, purpose + ": map " + text(item.address)));
    }
    steps.push_back(write_step(map, 0, sub, purpose + ": open the mapping"));
  }
  steps.push_back(write_step(parameters, 1, cob_id, purpose + ": switch on"));
}

std::uint8_t PdoConfiguration::length() const {
  unsigned bits = 0;
  for (const Item& item : mapping) bits += item.bits;
  return static_cast<std::uint8_t>(bits / 8);
}

ConfigurationQueue::ConfigurationQueue(std::uint8_t node, std::string name, Nanos timeout)
    : name_{std::move(name)}, client_{node, timeout} {}

void ConfigurationQueue::start(Instant now, std::vector<SdoStep> steps, Frames& out) {
  cancel(now, out);
  steps_ = std::move(steps);
  next_ = 0;
  failure_.clear();
  status_ = Status::kBusy;
  begin_step(now, out);
}

void ConfigurationQueue::cancel(Instant now, Frames& out) {
  client_.cancel(now, out);
  status_ = Status::kIdle;
}

void ConfigurationQueue::begin_step(Instant now, Frames& out) {
  if (next_ == steps_.size()) {
    status_ = Status::kDone;
    return;
  }
  const SdoStep& step = steps_[next_];
  if (step.kind == SdoStep::Kind::kWrite) {
    client_.start_download(now, step.address, step.value, out);
  } else {
    client_.start_upload(now, step.address, out);
  }
}

void ConfigurationQueue::on_frame(Instant now, const can::CanFrame& frame, Frames& out) {
  if (status_ != Status::kBusy) return;
  client_.on_frame(now, frame, out);
  conclude(now, out);
}

void ConfigurationQueue::on_time(Instant now, Frames& out) {
  if (status_ != Status::kBusy) return;
  client_.on_time(now, out);
  conclude(now, out);
}

void ConfigurationQueue::conclude(Instant now, Frames& out) {
  if (client_.status() == SdoStatus::kBusy) return;
  const SdoResult& result = client_.result();
  SdoStep& step = steps_[next_];
  if (result.status != SdoStatus::kDone) {
    const std::string_view what = step.kind == SdoStep::Kind::kWrite ? "write " : "read ";
    const std::string value = step.kind == SdoStep::Kind::kWrite ? " (value " + describe(step.value) + ")" : "";
    return fail(fmt::format("{}{}{}", what, text(result), value));
  }
  if (step.kind == SdoStep::Kind::kExpect && step.value != result.value) {
    return fail(fmt::format("{} is {}, expected {}", text(step.address), describe(result.value), describe(step.value)));
  }
  if (step.kind == SdoStep::Kind::kRead) step.value = result.value;
  ++next_;
  begin_step(now, out);
}

void ConfigurationQueue::fail(std::string what) {
  const std::string& purpose = steps_[next_].purpose;
  failure_ = fmt::format("{} (node {}): {}{}{}", name_, client_.server(), purpose, purpose.empty() ? "" : ": ", what);
  status_ = Status::kFailed;
}

}  // namespace meltbench::canopen
