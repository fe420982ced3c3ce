#pragma once

#include <cstdint>
#include <vector>

#include "protocols/can/frame.hpp"
#include "protocols/can/frame_length.hpp"

namespace meltbench::bus {

/// In which order a node offers its frames to the bus.
enum class TxOrder : std::uint8_t {
  kPriority,  ///< A mailbox per frame: of those that wait the one with the highest priority, oldest first.
  kFifo,      ///< As queued.
};

/// A frame that waits to be sent.
struct Pending {
  can::CanFrame frame;
  std::uint32_t key = 0;  ///< can::arbitration_key(frame).
  can::FrameLength length;
  Instant queued_at;
};

/// Frames of one node that wait for the bus; the one on the wire counts until it is through. Its memory is taken once.
class TransmitQueue {
 public:
  /// @param capacity  1..65535 frames.
  TransmitQueue(std::size_t capacity, TxOrder order);

  /// @returns false if it is full.
  [[nodiscard]] bool push(Instant at, const can::CanFrame& frame);
  /// The one to send next, of those queued not later than `at`; null if there is none. Valid until it is removed.
  [[nodiscard]] const Pending* head(Instant at) const;
  void remove(const Pending& pending);
  void clear();
  [[nodiscard]] bool empty() const { return order_.empty(); }
  [[nodiscard]] std::size_t size() const { return order_.size(); }
  /// How many more it takes.
  [[nodiscard]] std::size_t room() const { return free_.size(); }

 private:
  std::vector<Pending> slots_;
  std::vector<std::uint16_t> free_;
  std::vector<std::uint16_t> order_;  ///< Numbers of slots; the last is the next to send.
  TxOrder tx_order_;
};

}  // namespace meltbench::bus
