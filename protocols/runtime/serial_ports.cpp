#include "protocols/runtime/serial_ports.hpp"

#include <fmt/format.h>

#include <algorithm>

namespace meltbench::runtime {
namespace {

constexpr Nanos kLookPeriod = 100ms;

}  // namespace

SerialPorts::SerialPorts(std::span<const std::string> names, std::span<link::SerialLink* const> links)
    : states_(names.size(), LinkState::kUp) {
  for (std::size_t number = 0; number < names.size(); ++number) {
    lines_.push_back({.name = names[number], .link = links[number]});
  }
}

bool SerialPorts::collect(const RealTimeClock& clock, Instant now, std::vector<Event>& events) {
  bool changed = false;
  for (std::size_t number = 0; number < lines_.size(); ++number) {
    Line& line = lines_[number];
    if (line.unplugged) continue;
    if (states_[number] == LinkState::kDown) {
      if (read_monotonic() < line.next_look) continue;
      line.next_look = read_monotonic() + kLookPeriod;
      if (!line.link->reopen()) continue;
      note_up(number, now, events);
      changed = true;
    }
    while (const auto received = line.link->receive()) {
      const Instant at = std::min(clock.to_instant(received->at_monotonic), now);
      inbox_.add(at, static_cast<std::uint8_t>(number), received->bytes);
    }
    if (!line.link->is_up()) {
      note_down(number, now, events);
      changed = true;
    }
    note_losses(line, now, events);
  }
  return changed;
}

void SerialPorts::plug(std::span<const LinkState> states) {
  for (std::size_t number = 0; number < lines_.size(); ++number) {
    const bool in = number >= states.size() || states[number] == LinkState::kUp;
    if (lines_[number].unplugged == !in) continue;
    lines_[number].unplugged = !in;
    states_[number] = in ? LinkState::kUp : LinkState::kDown;
  }
}

void SerialPorts::note_down(std::size_t number, Instant now, std::vector<Event>& events) {
  Line& line = lines_[number];
  states_[number] = LinkState::kDown;
  line.next_look = read_monotonic() + kLookPeriod;
  line.down_since = now;
  line.told_lost_bytes = line.lost_bytes;  // They were lost because it went down, which is told here.
  ++line.downs;
  events.push_back(
      {now, Severity::kWarning, "port-down", fmt::format("the port of serial line {} has gone", line.name)});
}

void SerialPorts::note_up(std::size_t number, Instant now, std::vector<Event>& events) {
  const Line& line = lines_[number];
  states_[number] = LinkState::kUp;
  events.push_back({now, Severity::kInfo, "port-up",
                    fmt::format("the port of serial line {} is there again after {:.1f} s; times gone so far: {}",
                                line.name, to_s(now - line.down_since), line.downs)});
}

void SerialPorts::note_losses(Line& line, Instant now, std::vector<Event>& events) {
  if (line.lost_bytes == line.told_lost_bytes) return;
  line.told_lost_bytes = line.lost_bytes;
  events.push_back(
      {now, Severity::kWarning, "port-full",
       fmt::format("the port of serial line {} takes no more; bytes lost so far: {}", line.name, line.lost_bytes)});
}

void SerialPorts::write(const Outbox& out) {
  for (const SerialPiece& piece : out.serial()) {
    if (piece.line >= lines_.size() || states_[piece.line] == LinkState::kDown) continue;
    Line& line = lines_[piece.line];
    const auto bytes = out.serial_bytes(piece);
    line.lost_bytes += bytes.size() - line.link->write(bytes);
  }
}

std::size_t SerialPorts::watch(std::span<pollfd> watched) const {
  std::size_t count = 0;
  for (const Line& line : lines_) {
    if (count < watched.size() && line.link->fd() >= 0) watched[count++] = {line.link->fd(), POLLIN, 0};
  }
  return count;
}

Nanos SerialPorts::next_look() const {
  Nanos next = Nanos::max();
  for (std::size_t number = 0; number < lines_.size(); ++number) {
    if (states_[number] == LinkState::kDown && !lines_[number].unplugged)
      next = std::min(next, lines_[number].next_look);
  }
  return next;
}

}  // namespace meltbench::runtime
