#include "bench/record/recording.hpp"

#include <algorithm>
#include <cstring>
#include <utility>

namespace meltbench::record {
namespace {

// Packed::flags: two bits of FrameKind, then one bit each.
constexpr std::uint8_t kKindMask = 0x03;
constexpr std::uint8_t kExtended = 0x04;
constexpr std::uint8_t kFd = 0x08;
constexpr std::uint8_t kBrs = 0x10;
constexpr std::uint8_t kEsi = 0x20;

std::uint8_t pack_flags(const can::CanFrame& frame) {
  unsigned flags = static_cast<unsigned>(frame.kind) & kKindMask;
  if (frame.extended) flags |= kExtended;
  if (frame.fd) flags |= kFd;
  if (frame.brs) flags |= kBrs;
  if (frame.esi) flags |= kEsi;
  return static_cast<std::uint8_t>(flags);
}

Instant cut_to_us(Instant at) {
  return at - at.since_start % 1us;
}

/// The pieces of a signal's name that make a unit. What is not listed is part of the name.
constexpr std::array<std::string_view, 22> kUnits{"m",   "s",   "ms", "us",  "ns", "kg",  "g", "h",
                                                  "min", "K",   "Pa", "bar", "N",  "W",   "J", "rad",
                                                  "rev", "rpm", "V",  "A",   "Hz", "degC"};

bool is_unit(std::string_view word) {
  // "m2", "m3": a length to a power.
  if (word.size() == 2 && word[0] == 'm' && (word[1] == '2' || word[1] == '3')) return true;
  return std::find(kUnits.begin(), kUnits.end(), word) != kUnits.end();
}

}  // namespace

bool RunInfo::is_unseen(std::string_view name) const {
  return std::find(unseen.begin(), unseen.end(), name.substr(0, name.find('.'))) != unseen.end();
}

std::string_view to_text(EndReason reason) {
  switch (reason) {
    case EndReason::kCompleted:
      return "completed";
    case EndReason::kInterrupted:
      return "interrupted";
    case EndReason::kParticipantLost:
      return "participant-lost";
    case EndReason::kCutShort:
      return "cut-short";
  }
  return "cut-short";
}

void FrameLog::push_back(Instant at, const can::CanFrame& frame, std::uint8_t sender) {
  Packed packed{cut_to_us(at), frame.id, pack_flags(frame), frame.length, frame.raw_dlc, sender};
  if (frame.length <= can::kMaxClassicLength) {
    std::memcpy(packed.data.data(), frame.bytes.data(), packed.data.size());
  } else {
    const auto index = static_cast<std::uint64_t>(long_data_.size());
    std::memcpy(packed.data.data(), &index, sizeof index);
    long_data_.push_back(frame.bytes);
  }
  frames_.push_back(packed);
}

RecordedFrame FrameLog::operator[](std::size_t index) const {
  const Packed& packed = frames_[index];
  RecordedFrame result{packed.at, packed.sender, {}};
  can::CanFrame& frame = result.frame;
  frame.id = packed.id;
  frame.kind = static_cast<can::FrameKind>(packed.flags & kKindMask);
  frame.extended = (packed.flags & kExtended) != 0;
  frame.fd = (packed.flags & kFd) != 0;
  frame.brs = (packed.flags & kBrs) != 0;
  frame.esi = (packed.flags & kEsi) != 0;
  frame.length = packed.length;
  frame.raw_dlc = packed.raw_dlc;
  if (packed.length <= can::kMaxClassicLength) {
    std::memcpy(frame.bytes.data(), packed.data.data(), packed.data.size());
  } else {
    std::uint64_t long_index = 0;
    std::memcpy(&long_index, packed.data.data(), sizeof long_index);
    frame.bytes = long_data_[long_index];
  }
  return result;
}

bool FrameLog::is_error(std::size_t index) const {
  return (frames_[index].flags & kKindMask) == static_cast<std::uint8_t>(can::FrameKind::kError);
}

bool FrameLog::is_standard_data(std::size_t index, std::uint32_t cob_id) const {
  const Packed& packed = frames_[index];
  return packed.id == cob_id && (packed.flags & (kKindMask | kExtended)) == 0;
}

std::optional<std::size_t> Recording::find_signal(std::string_view name) const {
  const auto found = std::find_if(signals.begin(), signals.end(), [&](const SignalInfo& s) { return s.name == name; });
  if (found == signals.end()) return std::nullopt;
  return static_cast<std::size_t>(found - signals.begin());
}

std::string unit_of_signal(std::string_view name) {
  const std::size_t dot = name.rfind('.');
  std::string_view rest = dot == std::string_view::npos ? name : name.substr(dot + 1);
  std::string unit;
  // From the end: a unit, then as often as there is "_per" before it, another one.
  while (true) {
    const std::size_t bar = rest.rfind('_');
    if (bar == std::string_view::npos || !is_unit(rest.substr(bar + 1))) return {};
    std::string longer{rest.substr(bar + 1)};
    if (!unit.empty()) longer.append("/").append(unit);
    unit = std::move(longer);
    rest = rest.substr(0, bar);
    if (!rest.ends_with("_per")) return unit;
    rest.remove_suffix(4);
  }
}

}  // namespace meltbench::record
