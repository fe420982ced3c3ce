#include "plant_emulator/rtu_gate.hpp"

#include <algorithm>

namespace meltbench::emulator {

namespace {

using fault::Fault;
using fault::Kind;

Nanos nanos_from_ms(double ms) {
  return nanos_from_s(ms * 1e-3);
}

}  // namespace

const Fault* RtuGate::find(Kind kind) const {
  const auto found =
      std::find_if(faults_.begin(), faults_.end(), [&](const Active& one) { return one.fault.kind() == kind; });
  return found == faults_.end() ? nullptr : &found->fault;
}

void RtuGate::tell_line() {
  const Fault* slow = find(Kind::kSlow);
  for (const std::uint8_t unit : board_.units()) {
    server_.set_present(unit, !is_away());
    server_.set_extra_delay(unit, slow != nullptr ? nanos_from_ms(slow->value("delay_ms")) : Nanos{});
  }
}

void RtuGate::wake_up(Instant now) {
  watchdog_at_ = Instant::never();
  process_.freeze(kind_, false);
  static_cast<void>(board_.take_events());
  board_.start(now);
}

void RtuGate::begin(std::size_t number, const Fault& fault, Instant now) {
  if (fault.kind() == Kind::kReboot) return board_.start(now);
  faults_.push_back({number, fault});
  if (fault.kind() == Kind::kOff) process_.cut_power(kind_);
  if (fault.kind() == Kind::kHang) {
    process_.freeze(kind_, true);
    if (const double ms = fault.value("watchdog_ms"); ms > 0) watchdog_at_ = now + nanos_from_ms(ms);
  }
  tell_line();
}

void RtuGate::end(std::size_t number, Instant now) {
  const auto found =
      std::find_if(faults_.begin(), faults_.end(), [&](const Active& one) { return one.number == number; });
  if (found == faults_.end()) return;
  const Kind kind = found->fault.kind();
  faults_.erase(found);
  if (find(kind) != nullptr) return;  // Another one of the same kind is still on.
  if (kind == Kind::kOff) process_.restore_power(kind_);
  if (kind == Kind::kOff || kind == Kind::kHang) wake_up(now);
  tell_line();
}

void RtuGate::on_time(Instant now) {
  if (watchdog_at_ <= now) {
    std::erase_if(faults_, [](const Active& one) { return one.fault.kind() == Kind::kHang; });
    wake_up(now);
    tell_line();
  }
  if (!is_away() && board_.next_deadline() <= now) board_.on_time(now);
}

Instant RtuGate::next_deadline() const {
  return is_away() ? watchdog_at_ : std::min(board_.next_deadline(), watchdog_at_);
}

}  // namespace meltbench::emulator
