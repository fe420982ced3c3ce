#include "protocols/can/frame_bits.hpp"

#include <algorithm>

namespace meltbench::can {
namespace {

struct CrcLayout {
  std::uint32_t initial, polynomial;
  unsigned width;
};

constexpr CrcLayout layout_of(Crc::Kind kind) {
  switch (kind) {
    case Crc::Kind::k17:
      return {1U << 16U, 0x1685B, 17};
    case Crc::Kind::k21:
      return {1U << 20U, 0x102899, 21};
    case Crc::Kind::k15:
      break;
  }
  return {0, 0x4599, 15};
}

/// Walks over the bits of a frame in the order of the wire.
class FrameWalk {
 public:
  explicit FrameWalk(FrameBits& bits) : bits_{bits} {}

  void walk(const CanFrame& frame) {
    if (frame.fd) {
      walk_fd(frame);
    } else {
      walk_classic(frame);
    }
    data_rate_ = false;
    fixed(true, Field::kAck);
    fixed(true, Field::kAckDelimiter);
    for (int i = 0; i < 7; ++i) fixed(true, Field::kEnd);
  }

 private:
  void walk_classic(const CanFrame& frame) {
    crc_ = Crc{Crc::Kind::k15};
    const bool remote = frame.kind == FrameKind::kRemote;
    identifier(frame, remote);
    if (frame.extended) number(0, 1, Field::kReserved1);
    number(0, 1, Field::kReserved0);
    number(data_length_code(frame), 4, Field::kLength);
    for (const std::uint8_t byte : frame.data()) number(byte, 8, Field::kData);
    number(crc_.value(), 15, Field::kCrc);
    if (run_ == 5) stuff();
    fixed(true, Field::kCrcDelimiter);
  }

  void walk_fd(const CanFrame& frame) {
    counts_stuff_ = true;
    crc_ = Crc{frame.length <= 16 ? Crc::Kind::k17 : Crc::Kind::k21};
    identifier(frame, false);
    number(1, 1, frame.extended ? Field::kReserved1 : Field::kReserved0);  // FDF
    number(0, 1, Field::kReserved0);
    number(frame.brs ? 1 : 0, 1, Field::kReserved0);
    data_rate_ = frame.brs;
    number(frame.esi ? 1 : 0, 1, Field::kReserved0);
    number(data_length_code(frame), 4, Field::kLength);
    for (const std::uint8_t byte : frame.data()) number(byte, 8, Field::kData);
    // The fixed stuff bit before the stuff count stands also for a stuff bit that would be due here.
    const std::uint32_t count = encode_stuff_count(stuff_count_);
    for (unsigned i = 4; i-- > 0;) crc_.push(((count >> i) & 1U) != 0);
    const std::uint64_t field = (std::uint64_t{count} << crc_.width()) | crc_.value();
    const unsigned width = 4 + crc_.width();
    for (unsigned i = 0; i < width; ++i) {
      if (i % 4 == 0) bits_.push_back(WireBit{last_ = !last_, true, data_rate_, Field::kCrc});
      fixed(((field >> (width - 1 - i)) & 1U) != 0, Field::kCrc);
    }
    fixed(true, Field::kCrcDelimiter);
  }

  void identifier(const CanFrame& frame, bool remote) {
    number(0, 1, Field::kStart);
    const std::uint32_t base = frame.extended ? frame.id >> 18U : frame.id;
    number(base >> 3U, 8, Field::kId28To21);
    number(base & 7U, 3, Field::kId20To18);
    if (!frame.extended) {
      number(remote ? 1 : 0, 1, Field::kSubstitute);
      number(0, 1, Field::kIde);
      return;
    }
    number(1, 1, Field::kSubstitute);
    number(1, 1, Field::kIde);
    number((frame.id >> 13U) & 0x1FU, 5, Field::kId17To13);
    number((frame.id >> 5U) & 0xFFU, 8, Field::kId12To5);
    number(frame.id & 0x1FU, 5, Field::kId4To0);
    number(remote ? 1 : 0, 1, Field::kRemote);
  }

  /// Bits under the stuffing rule, most significant first; they and (FD) their stuff bits go into the check sum.
  void number(std::uint32_t value, unsigned width, Field field) {
    for (unsigned i = width; i-- > 0;) {
      if (run_ == 5) stuff();
      const bool recessive = ((value >> i) & 1U) != 0;
      run_ = recessive == last_ ? run_ + 1 : 1;
      last_ = recessive;
      field_ = field;
      crc_.push(recessive);
      bits_.push_back(WireBit{recessive, false, data_rate_, field});
    }
  }

  void stuff() {
    last_ = !last_;
    run_ = 1;
    ++stuff_count_;
    if (counts_stuff_) crc_.push(last_);
    bits_.push_back(WireBit{last_, true, data_rate_, field_});
  }

  void fixed(bool recessive, Field field) {
    last_ = recessive;
    bits_.push_back(WireBit{recessive, false, data_rate_, field});
  }

  FrameBits& bits_;
  Crc crc_{Crc::Kind::k15};
  Field field_ = Field::kNone;
  bool last_ = true;
  bool data_rate_ = false;
  bool counts_stuff_ = false;
  unsigned run_ = 0;
  unsigned stuff_count_ = 0;
};

}  // namespace

Crc::Crc(Kind kind)
    : value_{layout_of(kind).initial},
      polynomial_{layout_of(kind).polynomial},
      mask_{(1U << layout_of(kind).width) - 1U},
      width_{layout_of(kind).width} {}

bool is_arbitration(Field field) {
  switch (field) {
    case Field::kId28To21:
    case Field::kId20To18:
    case Field::kSubstitute:
    case Field::kIde:
    case Field::kId17To13:
    case Field::kId12To5:
    case Field::kId4To0:
    case Field::kRemote:
      return true;
    default:
      return false;
  }
}

void encode_frame(const CanFrame& frame, FrameBits& bits) {
  bits.clear();
  FrameWalk{bits}.walk(frame);
}

std::uint32_t arbitration_key(const CanFrame& frame) {
  const std::uint32_t remote = frame.kind == FrameKind::kRemote ? 1U : 0U;
  if (!frame.extended) return frame.id << 21U | remote << 20U;
  return (frame.id >> 18U) << 21U | 3U << 19U | (frame.id & 0x3FFFFU) << 1U | remote;
}

std::uint32_t encode_stuff_count(unsigned count) {
  const unsigned low = count & 7U;
  const unsigned gray = low ^ (low >> 1U);
  const unsigned parity = (gray ^ (gray >> 1U) ^ (gray >> 2U)) & 1U;
  return gray << 1U | parity;
}

unsigned data_length_code(const CanFrame& frame) {
  if (!frame.fd) return frame.raw_dlc != 0 ? frame.raw_dlc : frame.length;
  return to_fd_dlc(frame.length);
}

std::uint8_t length_of_code(unsigned code, bool fd) {
  const std::uint8_t length = from_fd_dlc(code & 0xFU);
  return fd ? length : std::min(length, static_cast<std::uint8_t>(kMaxClassicLength));
}

}  // namespace meltbench::can
