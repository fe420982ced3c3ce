#pragma once
/// A frame as the bits that cross the wire (ISO 11898-1), classic and FD, stuff bits included.

#include <array>
#include <cstdint>
#include <span>

#include "protocols/can/frame.hpp"

namespace meltbench::can {

/// Where in a frame a bit lies. The values are the error locations of linux/can/error.h (CAN_ERR_PROT_LOC_...).
/// FD: FDF is kReserved1 (extended) or kReserved0 (standard); res, BRS and ESI are kReserved0; the stuff count is kCrc.
enum class Field : std::uint8_t {
  kNone = 0x00,
  kStart = 0x03,
  kId28To21 = 0x02,    ///< Standard: bits 10..3.
  kId20To18 = 0x06,    ///< Standard: bits 2..0.
  kSubstitute = 0x04,  ///< Extended: SRR; standard: RTR; FD: RRS.
  kIde = 0x05,
  kId17To13 = 0x07,
  kId12To5 = 0x0F,
  kId4To0 = 0x0E,
  kRemote = 0x0C,  ///< Extended: RTR or RRS.
  kReserved1 = 0x0D,
  kReserved0 = 0x09,
  kLength = 0x0B,
  kData = 0x0A,
  kCrc = 0x08,
  kCrcDelimiter = 0x18,
  kAck = 0x19,
  kAckDelimiter = 0x1B,
  kEnd = 0x1A,
  kIntermission = 0x12,
};

/// True where two senders may differ without an error: the one that sends recessive has lost.
[[nodiscard]] bool is_arbitration(Field field);

/// One bit on the wire. Recessive = 1.
struct WireBit {
  bool recessive : 1 = true;
  bool stuff : 1 = false;      ///< Put in by the stuffing rule, or at a fixed place of an FD frame's CRC field.
  bool data_rate : 1 = false;  ///< FD with bit rate switch: ESI to CRC delimiter.
  Field field = Field::kNone;
};

/// The bits of one frame from start of frame to the last bit of end of frame, as its sender drives them (acknowledge
/// slot recessive). Sized for the longest frame, 64 bytes with an extended identifier.
class FrameBits {
 public:
  [[nodiscard]] std::span<const WireBit> bits() const { return {bits_.data(), size_}; }
  void clear() { size_ = 0; }
  void push_back(WireBit bit) { bits_[size_++] = bit; }

 private:
  std::array<WireBit, 768> bits_{};
  std::size_t size_ = 0;
};

/// Bits of a data or remote frame. @pre is_valid(frame), not an error frame. Cost: about 2 ns per bit.
void encode_frame(const CanFrame& frame, FrameBits& bits);

/// The arbitration field as a number: of several frames that start at once the one with the smallest key wins.
/// Base identifier, RTR or SRR, IDE, rest of the identifier, RTR, in the order of the wire; dominant = 0.
[[nodiscard]] std::uint32_t arbitration_key(const CanFrame& frame);

/// Check sums, bit by bit. CRC-15 x^15+x^14+x^10+x^8+x^7+x^4+x^3+1 (classic), CRC-17 and CRC-21 of FD up to 16 and
/// above 16 data bytes, whose first bit is preset.
class Crc {
 public:
  enum class Kind : std::uint8_t { k15, k17, k21 };
  explicit Crc(Kind kind);
  void push(bool bit) {
    const bool carry = ((value_ >> (width_ - 1U)) & 1U) != static_cast<std::uint32_t>(bit);
    value_ = ((value_ << 1U) ^ (carry ? polynomial_ : 0U)) & mask_;
  }
  [[nodiscard]] std::uint32_t value() const { return value_; }
  [[nodiscard]] unsigned width() const { return width_; }

 private:
  std::uint32_t value_;
  std::uint32_t polynomial_;
  std::uint32_t mask_;
  unsigned width_;
};

/// Stuff count of an FD frame as it is sent: Gray code of count mod 8, then an even parity bit.
[[nodiscard]] std::uint32_t encode_stuff_count(unsigned count);

/// Data length code 0..15 of a frame: of its length, or the raw one that it carries.
[[nodiscard]] unsigned data_length_code(const CanFrame& frame);
/// Bytes that a data length code stands for: up to 8 (classic) or 64 (FD).
[[nodiscard]] std::uint8_t length_of_code(unsigned code, bool fd);

}  // namespace meltbench::can
