#include "plant_emulator/board_gate.hpp"

#include <algorithm>

#include "protocols/canopen/types.hpp"

namespace meltbench::emulator {

namespace {

using fault::Fault;
using fault::Kind;

constexpr std::uint32_t kEmcyBase = 0x080, kSdoResponseBase = 0x580, kNodeControlBase = 0x700;

Nanos nanos_from_ms(double ms) {
  return nanos_from_s(ms * 1e-3);
}

/// An expedited answer with four bytes to who asks for 1018:2.
bool is_product_code(const can::CanFrame& frame, std::uint8_t node_id) {
  return frame.id == kSdoResponseBase + node_id && frame.length == 8 && frame.bytes[0] == 0x43 &&
         frame.bytes[1] == 0x18 && frame.bytes[2] == 0x10 && frame.bytes[3] == 2;
}

}  // namespace

const Fault* BoardGate::find(Kind kind) const {
  const auto found =
      std::find_if(faults_.begin(), faults_.end(), [&](const Active& one) { return one.fault.kind() == kind; });
  return found == faults_.end() ? nullptr : &found->fault;
}

void BoardGate::power_up(Instant now, canopen::Frames& out) {
  const std::size_t from = out.size();
  board_.start(now, out);
  filter(now, from, out);
}

void BoardGate::wake_up(Instant now, canopen::Frames& out) {
  watchdog_at_ = Instant::never();
  board_.hang(false);
  process_.freeze(kind_, false);
  power_up(now, out);
}

void BoardGate::begin(std::size_t number, const Fault& fault, Instant now, canopen::Frames& out) {
  if (fault.kind() == Kind::kReboot) return power_up(now, out);
  faults_.push_back({number, fault});
  switch (fault.kind()) {
    case Kind::kOff:
      return process_.cut_power(kind_);
    case Kind::kHang:
      board_.hang(true);
      if (const double ms = fault.value("watchdog_ms"); ms > 0) watchdog_at_ = now + nanos_from_ms(ms);
      return process_.freeze(kind_, true);
    case Kind::kWrongIdentity:
      return power_up(now, out);
    case Kind::kEmcyStorm:
      next_storm_ = now;
      return;
    default:
      return;
  }
}

void BoardGate::end(std::size_t number, Instant now, canopen::Frames& out) {
  const auto found =
      std::find_if(faults_.begin(), faults_.end(), [&](const Active& one) { return one.number == number; });
  if (found == faults_.end()) return;
  const Kind kind = found->fault.kind();
  faults_.erase(found);
  if (find(kind) != nullptr) return;  // Another one of the same kind is still on.
  switch (kind) {
    case Kind::kOff:
      static_cast<void>(board_.take_events());
      process_.restore_power(kind_);
      return power_up(now, out);
    case Kind::kHang:
      return wake_up(now, out);
    case Kind::kWrongIdentity:
      return power_up(now, out);
    case Kind::kEmcyStorm:
      next_storm_ = Instant::never();
      return;
    default:
      return;
  }
}

void BoardGate::on_frame(Instant now, const can::CanFrame& frame, canopen::Frames& out) {
  const std::size_t from = out.size();
  // Who hangs still has its CAN interrupt, which counts heartbeats and answers SYNC from the last values.
  const bool is_heartbeat = frame.id > kNodeControlBase && frame.id < kNodeControlBase + 0x80;
  if (find(Kind::kHang) == nullptr || frame.id == canopen::cob_id::kSync || is_heartbeat) {
    board_.on_frame(now, frame, out);
  }
  if (out.size() > from) filter(now, from, out);
}

void BoardGate::on_time(Instant now, canopen::Frames& out) {
  while (!late_.empty() && late_.front().due <= now) {
    out.push_back(late_.front().frame);
    late_.pop_front();
  }
  storm(now, out);
  if (watchdog_at_ <= now) {
    std::erase_if(faults_, [](const Active& one) { return one.fault.kind() == Kind::kHang; });
    wake_up(now, out);
  }
  if (board_.next_deadline() > now) return;
  const std::size_t from = out.size();
  board_.on_time(now, out);
  filter(now, from, out);
}

Instant BoardGate::next_deadline() const {
  const Instant next = std::min({board_.next_deadline(), next_storm_, watchdog_at_});
  return late_.empty() ? next : std::min(next, late_.front().due);
}

void BoardGate::storm(Instant now, canopen::Frames& out) {
  const Fault* fault = find(Kind::kEmcyStorm);
  if (fault == nullptr || next_storm_ > now) return;
  next_storm_ = now + nanos_from_ms(fault->value("period_ms"));
  if (is_dark()) return;
  const auto code = static_cast<std::uint16_t>(fault->value("code"));
  const auto low = static_cast<std::uint8_t>(code & 0xFFU);
  const auto high = static_cast<std::uint8_t>(code >> 8U);
  constexpr std::uint8_t kGeneric = 0x01;
  out.push_back(can::make_frame(kEmcyBase + board_.node().node_id(), {low, high, kGeneric, 0, 0, 0, 0, 0}));
}

bool BoardGate::is_swallowed(can::CanFrame& frame) const {
  if (is_dark()) return true;
  const std::uint8_t node_id = board_.node().node_id();
  if (const Fault* swap = find(Kind::kWrongIdentity); swap != nullptr && is_product_code(frame, node_id)) {
    auto product = static_cast<std::uint32_t>(swap->value("product"));
    for (std::size_t i = 4; i < 8; ++i, product >>= 8U) frame.bytes[i] = static_cast<std::uint8_t>(product & 0xFFU);
  }
  return frame.id == kNodeControlBase + node_id && find(Kind::kHeartbeatLost) != nullptr;
}

void BoardGate::filter(Instant now, std::size_t from, canopen::Frames& out) {
  if (faults_.empty()) return;
  const Fault* slow = find(Kind::kSlow);
  std::size_t kept = from;
  for (std::size_t i = from; i < out.size(); ++i) {
    can::CanFrame frame = out[i];
    if (is_swallowed(frame)) continue;
    if (slow != nullptr) {
      const Instant due = now + nanos_from_ms(slow->value("delay_ms"));
      late_.push_back({late_.empty() ? due : std::max(due, late_.back().due), frame});
    } else {
      out[kept++] = frame;
    }
  }
  out.resize(kept);
}

}  // namespace meltbench::emulator
