#include "protocols/can/frame_length.hpp"

#include <array>

#include "protocols/can/frame_bits.hpp"

namespace meltbench::can {
namespace {

constexpr unsigned kDelimiterAckAndEnd = 1 + 2 + 7;  // CRC delimiter, acknowledge slot and delimiter, end of frame.
constexpr unsigned kFullRun = 5;

/// What the stuffing rule has seen: how many equal bits in a row, and their level. Fits an index: run * 2 + level.
struct StuffState {
  std::uint8_t index = 1;  ///< Of an idle bus: no run yet, recessive.
  std::uint8_t stuffed = 0;
};

constexpr StuffState push_bit(std::uint8_t index, unsigned level) {
  unsigned run = index / 2U;
  unsigned last = index % 2U;
  std::uint8_t stuffed = 0;
  if (run == kFullRun) {
    last = 1U - last;
    run = 1;
    stuffed = 1;
  }
  run = level == last ? run + 1 : 1;
  return {static_cast<std::uint8_t>(run * 2 + level), stuffed};
}

constexpr std::size_t kStates = 2 * (kFullRun + 1);
using ByBit = std::array<std::array<StuffState, 2>, kStates>;
using ByByte = std::array<std::array<StuffState, 256>, kStates>;

constexpr ByBit make_bit_table() {
  ByBit table{};
  for (std::uint8_t state = 0; state < kStates; ++state) {
    for (unsigned level = 0; level < 2; ++level) table[state][level] = push_bit(state, level);
  }
  return table;
}

constexpr ByByte make_byte_table() {
  ByByte table{};
  for (std::uint8_t state = 0; state < kStates; ++state) {
    for (unsigned byte = 0; byte < 256; ++byte) {
      StuffState sum{state, 0};
      for (unsigned i = 8; i-- > 0;) {
        const StuffState next = push_bit(sum.index, (byte >> i) & 1U);
        sum = {next.index, static_cast<std::uint8_t>(sum.stuffed + next.stuffed)};
      }
      table[state][byte] = sum;
    }
  }
  return table;
}

constexpr std::array<std::uint16_t, 256> make_crc15_table() {
  std::array<std::uint16_t, 256> table{};
  for (unsigned byte = 0; byte < 256; ++byte) {
    unsigned value = byte << 7U;
    for (int i = 0; i < 8; ++i) value = ((value << 1U) ^ ((value & 0x4000U) != 0 ? 0x4599U : 0U)) & 0x7FFFU;
    table[byte] = static_cast<std::uint16_t>(value);
  }
  return table;
}

constexpr ByBit kByBit = make_bit_table();
constexpr ByByte kByByte = make_byte_table();
constexpr std::array<std::uint16_t, 256> kCrc15 = make_crc15_table();

/// Counts stuff bits. Tables, because the bits of a frame are as good as random: a branch on them costs ten times that.
class StuffCounter {
 public:
  void push_bits(std::uint64_t value, unsigned width) {
    for (unsigned i = width; i-- > 0;) add(kByBit[index_][(value >> i) & 1U]);
  }
  void push_byte(std::uint8_t byte) { add(kByByte[index_][byte]); }
  [[nodiscard]] unsigned count() const { return count_; }
  [[nodiscard]] bool one_is_due() const { return index_ / 2U == kFullRun; }

 private:
  void add(StuffState step) {
    index_ = step.index;
    count_ += step.stuffed;
  }
  std::uint8_t index_ = StuffState{}.index;
  unsigned count_ = 0;
};

/// Bits of known width, most significant first.
struct Head {
  std::uint64_t value = 0;
  unsigned width = 0;
  void push(std::uint64_t bits, unsigned count) {
    value = value << count | bits;
    width += count;
  }
};

/// Start of frame to the bit before FDF or r0 (standard), FDF or r1 (extended).
Head make_identifier(const CanFrame& frame) {
  const std::uint64_t remote = frame.kind == FrameKind::kRemote ? 1 : 0;
  Head head;
  head.push(0, 1);
  if (frame.extended) {
    head.push(frame.id >> 18U, 11);
    head.push(3, 2);
    head.push(frame.id & 0x3FFFFU, 18);
    head.push(remote, 1);
  } else {
    head.push(frame.id, 11);
    head.push(remote << 1U, 2);
  }
  return head;
}

FrameLength calc_classic_length(const CanFrame& frame) {
  Head head = make_identifier(frame);
  head.push(0, frame.extended ? 2 : 1);
  head.push(data_length_code(frame), 4);
  Crc head_crc{Crc::Kind::k15};
  for (unsigned i = head.width; i-- > 0;) head_crc.push(((head.value >> i) & 1U) != 0);
  std::uint32_t crc = head_crc.value();
  StuffCounter stuffing;
  stuffing.push_bits(head.value, head.width);
  for (const std::uint8_t byte : frame.data()) {
    stuffing.push_byte(byte);
    crc = ((crc << 8U) ^ kCrc15[((crc >> 7U) ^ byte) & 0xFFU]) & 0x7FFFU;
  }
  stuffing.push_bits(crc, 15);
  const unsigned stuffed = stuffing.count() + (stuffing.one_is_due() ? 1U : 0U);
  const unsigned data = 8U * static_cast<unsigned>(frame.data().size());
  return {static_cast<std::uint16_t>(head.width + data + 15 + stuffed + kDelimiterAckAndEnd), 0};
}

/// Stuff count, check sum and their fixed stuff bits.
unsigned crc_field_bits(const CanFrame& frame) {
  return frame.length <= 16 ? 4 + 17 + 6 : 4 + 21 + 7;
}

FrameLength split(const CanFrame& frame, unsigned head, unsigned rest) {
  if (!frame.brs) return {static_cast<std::uint16_t>(head + rest + kDelimiterAckAndEnd), 0};
  // The CRC delimiter is the last bit at the data rate.
  return {static_cast<std::uint16_t>(head + kDelimiterAckAndEnd - 1), static_cast<std::uint16_t>(rest + 1)};
}

FrameLength calc_fd_length(const CanFrame& frame) {
  Head head = make_identifier(frame);
  head.push(frame.brs ? 5 : 4, 3);  // FDF, res, BRS.
  StuffCounter stuffing;
  stuffing.push_bits(head.value, head.width);
  const unsigned stuffed_head = head.width + stuffing.count();
  stuffing.push_bits((frame.esi ? 16U : 0U) | data_length_code(frame), 5);
  for (const std::uint8_t byte : frame.data()) stuffing.push_byte(byte);
  const unsigned all = head.width + 5 + 8U * static_cast<unsigned>(frame.length) + stuffing.count();
  return split(frame, stuffed_head, all - stuffed_head + crc_field_bits(frame));
}

}  // namespace

FrameLength calc_frame_length(const CanFrame& frame) {
  return frame.fd ? calc_fd_length(frame) : calc_classic_length(frame);
}

FrameLength calc_longest_frame(const CanFrame& frame) {
  const auto data = 8U * static_cast<unsigned>(frame.data().size());
  if (!frame.fd) {
    const unsigned stuffed = (frame.extended ? 54U : 34U) + data;
    return {static_cast<std::uint16_t>(stuffed + (stuffed - 1) / 4 + kDelimiterAckAndEnd), 0};
  }
  const unsigned head = frame.extended ? 36 : 17;  // SOF to BRS.
  const unsigned rest = 5 + data;                  // ESI, DLC, data.
  // With a bit rate switch BRS is recessive after a dominant bit: a run of equal bits begins with it.
  if (frame.brs) return split(frame, head + (head - 2) / 4, rest + rest / 4 + crc_field_bits(frame));
  return split(frame, head, rest + (head + rest - 1) / 4 + crc_field_bits(frame));
}

}  // namespace meltbench::can
