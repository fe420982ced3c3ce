#pragma once

#include <vector>

#include "protocols/participant/participant.hpp"

namespace meltbench {

/// What has arrived on serial lines for a participant that is yet to be woken. Keeps its memory.
class SerialInbox {
 public:
  void add(Instant at, std::uint8_t line, std::span<const std::uint8_t> bytes) {
    arrivals_.push_back({at, line, bytes});
    bytes_.insert(bytes_.end(), bytes.begin(), bytes.end());
  }
  [[nodiscard]] bool empty() const { return arrivals_.empty(); }
  /// In the order in which they were added. Good until the next add() or clear().
  [[nodiscard]] std::span<const SerialArrival> arrivals() {
    std::size_t first = 0;
    for (SerialArrival& arrival : arrivals_) {
      arrival.bytes = std::span{bytes_}.subspan(first, arrival.bytes.size());
      first += arrival.bytes.size();
    }
    return arrivals_;
  }
  void clear() {
    arrivals_.clear();
    bytes_.clear();
  }

 private:
  std::vector<SerialArrival> arrivals_;  ///< Their bytes are put right by arrivals(): bytes_ moves as it grows.
  std::vector<std::uint8_t> bytes_;
};

}  // namespace meltbench
