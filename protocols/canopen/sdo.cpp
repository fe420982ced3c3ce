#include "protocols/canopen/sdo.hpp"

#include <algorithm>

namespace meltbench::canopen {
namespace {

constexpr std::array<std::uint16_t, 256> make_crc_table() {
  std::array<std::uint16_t, 256> table{};
  for (std::uint32_t byte = 0; byte < 256; ++byte) {
    std::uint32_t crc = byte << 8;
    for (int bit = 0; bit < 8; ++bit) crc = (crc & 0x8000U) != 0 ? crc << 1 ^ 0x1021U : crc << 1;
    table[byte] = static_cast<std::uint16_t>(crc);
  }
  return table;
}

constexpr auto kCrcTable = make_crc_table();

}  // namespace

std::uint16_t calc_crc16(std::span<const std::uint8_t> bytes, std::uint16_t crc) {
  for (const std::uint8_t byte : bytes) {
    crc = static_cast<std::uint16_t>(crc << 8 ^ kCrcTable[static_cast<std::uint8_t>(crc >> 8 ^ byte)]);
  }
  return crc;
}

bool is_sdo_frame(const can::CanFrame& frame, std::uint32_t id) {
  return frame.id == id && frame.kind == can::FrameKind::kData && !frame.extended && !frame.fd && frame.length == 8;
}

can::CanFrame make_sdo_frame(std::uint32_t id, std::uint8_t command, ObjectAddress address, std::uint32_t data) {
  can::CanFrame frame;
  frame.id = id;
  frame.length = 8;
  frame.bytes[0] = command;
  store(std::span{frame.bytes}, 1, address.index);
  frame.bytes[3] = address.sub;
  store(std::span{frame.bytes}, 4, data);
  return frame;
}

can::CanFrame make_abort_frame(std::uint32_t id, ObjectAddress address, AbortCode code) {
  return make_sdo_frame(id, 0x80, address, static_cast<std::uint32_t>(code));
}

std::uint8_t append_block(std::uint32_t id, std::span<const std::uint8_t> data, std::size_t offset,
                          std::uint8_t block_size, Frames& out) {
  std::uint8_t segments = 0;
  bool last = false;
  while (!last && segments < block_size) {
    const std::size_t size = std::min(kSegmentBytes, data.size() - offset);
    last = offset + size == data.size();
    ++segments;
    can::CanFrame frame = make_sdo_frame(id, static_cast<std::uint8_t>(segments | (last ? 0x80 : 0)), {});
    std::copy_n(data.begin() + static_cast<std::ptrdiff_t>(offset), size, frame.bytes.begin() + 1);
    out.push_back(frame);
    offset += size;
  }
  return segments;
}

std::uint8_t count_unused_bytes(std::size_t size) {
  if (size == 0) return kSegmentBytes;
  return static_cast<std::uint8_t>((kSegmentBytes - size % kSegmentBytes) % kSegmentBytes);
}

void BlockReceiver::begin(std::uint8_t block_size) {
  block_size_ = block_size;
  complete_ = false;
  begin_next_block();
}

void BlockReceiver::begin_next_block() {
  acknowledged_ = 0;
}

BlockReceiver::Outcome BlockReceiver::on_segment(std::span<const std::uint8_t> frame, std::vector<std::uint8_t>& data) {
  const bool last = (frame[0] & 0x80U) != 0;
  const std::uint8_t number = frame[0] & 0x7FU;
  if (number == acknowledged_ + 1 && number <= block_size_) {
    data.insert(data.end(), frame.begin() + 1, frame.begin() + 8);
    acknowledged_ = number;
    complete_ = last;
  }
  return last || number >= block_size_ ? Outcome::kBlockEnd : Outcome::kMore;
}

}  // namespace meltbench::canopen
