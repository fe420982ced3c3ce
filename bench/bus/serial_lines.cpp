#include "bench/bus/serial_lines.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <stdexcept>

namespace meltbench::bus {

SerialLines::SerialLines(std::span<const config::RigLine> lines,
                         std::span<const std::span<const std::string>> of_participants)
    : places_(of_participants.size()), states_(of_participants.size()) {
  std::vector<std::vector<LineEnd>> ends(lines.size());
  for (std::size_t participant = 0; participant < of_participants.size(); ++participant) {
    for (const std::string& name : of_participants[participant]) {
      const auto found = std::ranges::find(lines, name, &config::RigLine::name);
      if (found == lines.end()) throw std::invalid_argument{fmt::format("the rig has no line \"{}\"", name)};
      const auto number = static_cast<std::size_t>(found - lines.begin());
      places_[participant].push_back({number, ends[number].size()});
      ends[number].push_back({participant, static_cast<std::uint8_t>(states_[participant].size())});
      states_[participant].push_back(LinkState::kUp);
    }
  }
  for (std::size_t number = 0; number < lines.size(); ++number) {
    lines_.push_back({lines[number].name, ends[number], SerialLine{lines[number].settings, ends[number].size()}});
  }
}

void SerialLines::write(Instant now, std::size_t participant, std::uint8_t own_line,
                        std::span<const std::uint8_t> bytes) {
  if (own_line >= places_[participant].size()) return;
  const Place place = places_[participant][own_line];
  lines_[place.line].wire.write(now, place.end, bytes);
  find_next();
}

HeardPiece SerialLines::take() {
  Line& line = lines_[next_];
  const LineDelivery& delivery = line.wire.take();
  listeners_.clear();
  for (std::size_t end = 0; end < line.ends.size(); ++end) {
    if (end != delivery.sender && line.wire.is_plugged(end)) listeners_.push_back(line.ends[end]);
  }
  find_next();
  return {delivery.at, line.name, line.ends[delivery.sender].participant, delivery.bytes, listeners_};
}

void SerialLines::plug(Instant now, std::size_t participant, std::uint8_t own_line, bool in) {
  const Place place = places_[participant][own_line];
  states_[participant][own_line] = in ? LinkState::kUp : LinkState::kDown;
  if (in)
    lines_[place.line].wire.plug(place.end);
  else
    lines_[place.line].wire.unplug(now, place.end);
  find_next();
}

SerialLine* SerialLines::find(std::string_view name) {
  const auto found = std::ranges::find(lines_, name, &Line::name);
  return found == lines_.end() ? nullptr : &found->wire;
}

void SerialLines::find_next() {
  next_delivery_ = Instant::never();
  for (std::size_t number = 0; number < lines_.size(); ++number) {
    const Instant at = lines_[number].wire.next_delivery();
    if (at >= next_delivery_) continue;
    next_delivery_ = at;
    next_ = number;
  }
}

}  // namespace meltbench::bus
