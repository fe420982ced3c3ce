#include "bench/bus/serial_line.hpp"

#include <algorithm>

namespace meltbench::bus {

std::size_t SerialLine::add_end() {
  plugged_.push_back(true);
  busy_until_.emplace_back();
  return busy_until_.size() - 1;
}

void SerialLine::write(Instant now, std::size_t sender, std::span<const std::uint8_t> bytes) {
  if (!plugged_[sender] || bytes.empty()) return;
  Piece piece;
  if (!spare_.empty()) {
    std::swap(piece.delivery.bytes, spare_.back());
    spare_.pop_back();
  }
  piece.delivery.sender = sender;
  piece.delivery.bytes.assign(bytes.begin(), bytes.end());
  const Nanos late = fault_ != nullptr ? fault_->strike(now, sender, piece.delivery.bytes) : Nanos{};
  if (piece.delivery.bytes.empty()) return;
  piece.begin = std::max(now, busy_until_[sender]) + late;
  piece.delivery.at = piece.begin + serial::transmission_time(settings_, piece.delivery.bytes.size());
  busy_until_[sender] = piece.delivery.at;
  for (Piece& other : under_way_) {
    collide(piece, other);
    collide(other, piece);
  }
  under_way_.push_back(std::move(piece));
  find_next();
}

/// Notes which bytes of `piece` overlap with `other`.
void SerialLine::collide(Piece& piece, const Piece& other) const {
  if (piece.delivery.sender == other.delivery.sender) return;
  const Instant from = std::max(piece.begin, other.begin);
  const Instant to = std::min(piece.delivery.at, other.delivery.at);
  if (from >= to) return;
  const Nanos character = serial::transmission_time(settings_, 1);
  const auto first = static_cast<std::size_t>((from - piece.begin) / character);
  const auto last = static_cast<std::size_t>((to - piece.begin - 1ns) / character);
  const std::size_t end = std::min(last + 1, piece.delivery.bytes.size());
  const bool none_yet = piece.garbled_to == 0;
  piece.garbled_from = none_yet ? std::min(first, end - 1) : std::min(piece.garbled_from, first);
  piece.garbled_to = std::max(piece.garbled_to, end);
}

const LineDelivery& SerialLine::take() {
  Piece& piece = under_way_[next_];
  // Two drivers against each other: which bits win is anybody's guess, but none may come through as it was.
  for (std::size_t i = piece.garbled_from; i < piece.garbled_to; ++i) piece.delivery.bytes[i] ^= 0xA5U;
  std::swap(taken_, piece.delivery);
  spare_.push_back(std::move(piece.delivery.bytes));
  under_way_.erase(under_way_.begin() + static_cast<std::ptrdiff_t>(next_));
  find_next();
  return taken_;
}

void SerialLine::unplug(Instant now, std::size_t end) {
  plugged_[end] = false;
  busy_until_[end] = now;
  for (Piece& piece : under_way_) {
    LineDelivery& delivery = piece.delivery;
    if (delivery.sender != end || delivery.at <= now) continue;
    const Nanos sent = std::max(now - piece.begin, Nanos{});
    delivery.bytes.resize(static_cast<std::size_t>(sent / serial::transmission_time(settings_, 1)));
    piece.garbled_to = std::min(piece.garbled_to, delivery.bytes.size());
    delivery.at = now;
  }
  std::erase_if(under_way_, [](const Piece& piece) { return piece.delivery.bytes.empty(); });
  find_next();
}

void SerialLine::find_next() {
  next_delivery_ = Instant::never();
  for (std::size_t i = 0; i < under_way_.size(); ++i) {
    const LineDelivery& delivery = under_way_[i].delivery;
    const bool first = delivery.at < next_delivery_ ||
                       (delivery.at == next_delivery_ && delivery.sender < under_way_[next_].delivery.sender);
    if (!first) continue;
    next_ = i;
    next_delivery_ = delivery.at;
  }
}

}  // namespace meltbench::bus
