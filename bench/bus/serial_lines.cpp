#include "bench/bus/serial_lines.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <stdexcept>

namespace meltbench::bus {

SerialLines::SerialLines(std::span<const config::RigLine> lines) {
  for (const config::RigLine& line : lines) lines_.push_back({line.name, {}, SerialLine{line.settings}});
}

void SerialLines::add_participant(std::span<const std::string> names) {
  std::vector<Place> places;
  for (const std::string& name : names) {
    const auto found = std::ranges::find(lines_, name, &Line::name);
    if (found == lines_.end()) throw std::invalid_argument{fmt::format("the rig has no line \"{}\"", name)};
    places.push_back({static_cast<std::size_t>(found - lines_.begin()), 0});
  }
  for (std::size_t own_line = 0; own_line < places.size(); ++own_line) {
    Line& line = lines_[places[own_line].line];
    places[own_line].end = line.wire.add_end();
    line.ends.push_back({places_.size(), static_cast<std::uint8_t>(own_line)});
  }
  states_.emplace_back(places.size(), LinkState::kUp);
  places_.push_back(std::move(places));
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
