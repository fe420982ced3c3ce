#include "bench/fault/wire_faults.hpp"

#include <algorithm>

#include "bench/bus/bit_timed_medium.hpp"

namespace meltbench::fault {

namespace {

/// SplitMix64.
double draw(std::uint64_t seed, std::uint64_t number) {
  std::uint64_t x = seed + (number + 1) * 0x9e3779b97f4a7c15U;
  x = (x ^ (x >> 30U)) * 0xbf58476d1ce4e5b9U;
  x = (x ^ (x >> 27U)) * 0x94d049bb133111ebU;
  return static_cast<double>((x ^ (x >> 31U)) >> 11U) * 0x1p-53;
}

}  // namespace

Nanos LineFaults::strike(Instant /*now*/, std::size_t /*sender*/, std::vector<std::uint8_t>& bytes) {
  Nanos later{};
  for (Active& one : active) {
    switch (one.kind) {
      case Kind::kNoise:
        for (std::uint8_t& byte : bytes) {
          if (draw(one.seed, one.drawn++) < one.value) {
            byte = static_cast<std::uint8_t>(byte ^ (1U << static_cast<unsigned>(draw(~one.seed, one.drawn) * 8)));
          }
        }
        break;
      case Kind::kDrop:
        std::erase_if(bytes, [&](std::uint8_t) { return draw(one.seed, one.drawn++) < one.value; });
        break;
      case Kind::kHalfFrame:
        if (draw(one.seed, one.drawn++) < one.value) bytes.resize(bytes.size() / 2);
        break;
      case Kind::kWrongParity:
        bytes.clear();  // No receiver takes a character whose parity is wrong.
        break;
      case Kind::kStall:
        later += nanos_from_s(one.value * 1e-3);
        break;
      default:
        break;
    }
  }
  return later;
}

LineFaults& WireFaults::faults_of(const std::string& line) {
  const auto found =
      std::find_if(of_lines_.begin(), of_lines_.end(), [&](const OfLine& one) { return one.name == line; });
  if (found != of_lines_.end()) return *found->faults;
  of_lines_.push_back({line, std::make_unique<LineFaults>()});
  return *of_lines_.back().faults;
}

void WireFaults::plug(const std::string& line, bool in, bus::RunControl& run) const {
  const auto found = std::find(lines_.begin(), lines_.end(), line);
  if (found != lines_.end()) run.plug_line(emulator_, static_cast<std::uint8_t>(found - lines_.begin()), in);
}

void WireFaults::begin(std::size_t number, const Fault& fault, std::uint64_t seed, Instant now, bus::RunControl& run) {
  if (fault.target == Target::kBus) return set_bus(fault, seed, true, now, run);
  if (fault.target != Target::kLine) return;
  if (fault.kind() == Kind::kUnplugged) return plug(fault.object, false, run);
  LineFaults& faults = faults_of(fault.object);
  faults.active.push_back({number, fault.kind(), fault.values.empty() ? 0.0 : fault.values.front(), seed, 0});
  if (bus::SerialLine* line = run.find_line(fault.object)) line->set_fault(&faults);
}

void WireFaults::end(std::size_t number, const Fault& fault, Instant now, bus::RunControl& run) {
  if (fault.target == Target::kBus) return set_bus(fault, 0, false, now, run);
  if (fault.target != Target::kLine) return;
  if (fault.kind() == Kind::kUnplugged) return plug(fault.object, true, run);
  std::erase_if(faults_of(fault.object).active, [&](const LineFaults::Active& one) { return one.number == number; });
}

void WireFaults::set_bus(const Fault& fault, std::uint64_t seed, bool on, Instant now, bus::RunControl& run) const {
  bus::BitTimedMedium* medium = run.medium();
  if (medium == nullptr) return;  // Refused when the fault was read.
  bus::BitTimedBus& wire = medium->bus();
  const std::size_t node = fault.object.empty() ? 0 : medium->find_node(fault.object);
  if (node >= wire.node_count()) return;
  switch (fault.kind()) {
    case Kind::kShortCircuit:
      return wire.set_wire(now, on ? bus::WireState::kShorted : bus::WireState::kGood);
    case Kind::kStuckDominant:
      return wire.set_wire(now, on ? bus::WireState::kStuckDominant : bus::WireState::kGood);
    case Kind::kNoise:
      return wire.set_noise(now, on ? fault.value("bit_error_rate") : 0.0, seed);
    case Kind::kOpenCircuit:
      return wire.set_cut_off(now, node, on);
    case Kind::kBabble: {
      std::optional<can::CanFrame> frame;
      if (on) frame = can::make_frame(static_cast<std::uint32_t>(fault.value("id")), {0, 0, 0, 0, 0, 0, 0, 0});
      return wire.set_babble(now, node, frame);
    }
    case Kind::kWrongBitRate:
      return wire.set_bit_rate_divider(now, node, on ? static_cast<unsigned>(fault.value("divider")) : 1U);
    case Kind::kBusOff:
      if (on) return wire.force_bus_off(now, node);
      return wire.restart(now, node);
    default:
      return;
  }
}

}  // namespace meltbench::fault
