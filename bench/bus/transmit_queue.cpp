#include "bench/bus/transmit_queue.hpp"

#include <algorithm>

#include "protocols/can/frame_bits.hpp"

namespace meltbench::bus {

TransmitQueue::TransmitQueue(std::size_t capacity, TxOrder order) : slots_(capacity), tx_order_{order} {
  free_.reserve(capacity);
  order_.reserve(capacity);
  clear();
}

void TransmitQueue::clear() {
  free_.clear();
  order_.clear();
  for (std::size_t i = slots_.size(); i-- > 0;) free_.push_back(static_cast<std::uint16_t>(i));
}

bool TransmitQueue::push(Instant at, const can::CanFrame& frame) {
  if (free_.empty()) return false;
  const std::uint16_t slot = free_.back();
  free_.pop_back();
  slots_[slot] = {frame, can::arbitration_key(frame), can::calc_frame_length(frame), at};
  auto place = order_.begin();
  if (tx_order_ == TxOrder::kPriority) {
    // From the end come smaller keys, and of equal keys the older ones.
    place = std::find_if(order_.begin(), order_.end(),
                         [&](std::uint16_t other) { return slots_[other].key <= slots_[slot].key; });
  }
  order_.insert(place, slot);
  return true;
}

const Pending* TransmitQueue::head(Instant at) const {
  for (std::size_t i = order_.size(); i-- > 0;) {
    const Pending& pending = slots_[order_[i]];
    if (pending.queued_at <= at) return &pending;
    if (tx_order_ == TxOrder::kFifo) break;
  }
  return nullptr;
}

void TransmitQueue::remove(const Pending& pending) {
  const auto slot = static_cast<std::uint16_t>(&pending - slots_.data());
  std::erase(order_, slot);
  free_.push_back(slot);
}

}  // namespace meltbench::bus
