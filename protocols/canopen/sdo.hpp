#pragma once
/// What SDO server and client have in common: block segments, CRC, abort frames.

#include <cstdint>
#include <span>
#include <vector>

#include "protocols/canopen/types.hpp"

namespace meltbench::canopen {

inline constexpr std::uint8_t kMaxBlockSize = 127;  ///< Segments in one block.
inline constexpr std::size_t kSegmentBytes = 7;
inline constexpr Nanos kDefaultSdoTimeout = 500ms;  ///< Longest wait of either side for the other.

/// CRC of block transfers: polynomial 0x1021, start 0, not reflected; of "123456789" 0x31C3. Can be continued with
/// `crc`.
[[nodiscard]] std::uint16_t calc_crc16(std::span<const std::uint8_t> bytes, std::uint16_t crc = 0);

/// True if the frame has the shape of an SDO on this identifier: classic data frame, 11 bits, 8 bytes.
[[nodiscard]] bool is_sdo_frame(const can::CanFrame& frame, std::uint32_t id);

/// The object that an SDO frame is about. @pre at least 4 bytes; segments have none.
[[nodiscard]] inline ObjectAddress sdo_address(std::span<const std::uint8_t> frame) {
  return {load<std::uint16_t>(frame, 1), frame[3]};
}

/// An SDO frame: command byte, address, last four bytes.
[[nodiscard]] can::CanFrame make_sdo_frame(std::uint32_t id, std::uint8_t command, ObjectAddress address,
                                           std::uint32_t data = 0);
[[nodiscard]] can::CanFrame make_abort_frame(std::uint32_t id, ObjectAddress address, AbortCode code);

/// Appends segments of `data` from byte `offset` on, at most `block_size`, numbered from 1, the last of all with the
/// end bit. Empty data is one segment without content. @returns the number of segments.
std::uint8_t append_block(std::uint32_t id, std::span<const std::uint8_t> data, std::size_t offset,
                          std::uint8_t block_size, Frames& out);

/// Unused bytes in the last segment of a transfer of so many bytes.
[[nodiscard]] std::uint8_t count_unused_bytes(std::size_t size);

/// Puts the segments of a block transfer together. A segment out of order ends what this block can deliver; the rest of
/// it is ignored and the sender repeats from acknowledged() on.
class BlockReceiver {
 public:
  enum class Outcome : std::uint8_t { kMore, kBlockEnd };

  void begin(std::uint8_t block_size);
  void begin_next_block();

  /// Takes one segment; in order: appends its 7 bytes to `data`.
  /// @returns kBlockEnd when the sender now waits for an acknowledge.
  Outcome on_segment(std::span<const std::uint8_t> frame, std::vector<std::uint8_t>& data);

  [[nodiscard]] std::uint8_t acknowledged() const { return acknowledged_; }
  [[nodiscard]] std::uint8_t block_size() const { return block_size_; }
  [[nodiscard]] bool is_complete() const { return complete_; }  ///< The segment with the end bit has come in order.

 private:
  std::uint8_t block_size_ = kMaxBlockSize;
  std::uint8_t acknowledged_ = 0;
  bool complete_ = false;
};

}  // namespace meltbench::canopen
