#include "bench/bus/frame_reader.hpp"

namespace meltbench::bus {

using can::Field;
using Verdict = FrameReader::Verdict;

Verdict FrameReader::push(bool recessive) {
  if (!is_stuffed()) return stage_ == Stage::kFdCrc ? push_fd_crc(recessive) : push_fixed(recessive);
  if (run_ == 5) {
    if (recessive == last_) return Verdict::kStuffError;
    last_ = recessive;
    run_ = 1;
    ++stuff_count_;
    crc17_.push(recessive);
    crc21_.push(recessive);
    if (stage_ == Stage::kCrcDelimiter) run_ = 0;  // It was the one behind the check sum.
    return Verdict::kGoesOn;
  }
  run_ = recessive == last_ ? run_ + 1 : 1;
  last_ = recessive;
  field_ = locate();
  take(recessive);
  return bad_form_ ? Verdict::kFormError : Verdict::kGoesOn;
}

void FrameReader::take(bool recessive) {
  if (stage_ != Stage::kCrc) crc15_.push(recessive);
  crc17_.push(recessive);
  crc21_.push(recessive);
  value_ = value_ << 1U | (recessive ? 1U : 0U);
  if (stage_ == Stage::kData && left_ % 8 == 1) {
    const std::size_t index = frame_.length - 1U - (left_ - 1U) / 8U;
    frame_.bytes[index] = static_cast<std::uint8_t>(value_);
  }
  if (--left_ == 0) finish_stage();
}

void FrameReader::enter(Stage stage, unsigned bits) {
  stage_ = stage;
  left_ = bits;
  value_ = 0;
}

void FrameReader::finish_stage() {
  const bool bit = (value_ & 1U) != 0;
  switch (stage_) {
    case Stage::kStart:
      return enter(Stage::kBase, 11);
    case Stage::kBase:
      frame_.id = value_;
      return enter(Stage::kSubstitute, 1);
    case Stage::kSubstitute:
      remote_bit_ = bit;
      return enter(Stage::kIde, 1);
    case Stage::kIde:
      frame_.extended = bit;
      return bit ? enter(Stage::kExtension, 18) : enter(Stage::kFormat, 1);
    case Stage::kExtension:
      frame_.id = frame_.id << 18U | value_;
      return enter(Stage::kRemote, 1);
    case Stage::kRemote:
      remote_bit_ = bit;
      return enter(Stage::kFormat, 1);
    case Stage::kFormat:
      frame_.fd = bit;
      if (bit) return enter(Stage::kFdReserved, 1);
      if (remote_bit_) frame_.kind = can::FrameKind::kRemote;
      return frame_.extended ? enter(Stage::kReserved, 1) : enter(Stage::kLength, 4);
    case Stage::kReserved:
      return enter(Stage::kLength, 4);
    case Stage::kFdReserved:
      bad_form_ = bit;
      return enter(Stage::kBrs, 1);
    case Stage::kBrs:
      frame_.brs = bit;
      return enter(Stage::kEsi, 1);
    case Stage::kEsi:
      frame_.esi = bit;
      return enter(Stage::kLength, 4);
    case Stage::kLength:
      return finish_length();
    case Stage::kData:
      return frame_.fd ? enter(Stage::kFdCrc, 0) : enter(Stage::kCrc, 15);
    case Stage::kCrc:
      crc_wrong_ = value_ != crc15_.value();
      return enter(Stage::kCrcDelimiter, 1);
    default:
      return;
  }
}

void FrameReader::finish_length() {
  const std::uint32_t code = value_;
  frame_.length = can::length_of_code(code, frame_.fd);
  if (!frame_.fd && code > can::kMaxClassicLength) frame_.raw_dlc = static_cast<std::uint8_t>(code);
  const auto bits = 8U * static_cast<unsigned>(frame_.data().size());
  if (bits > 0) return enter(Stage::kData, bits);
  frame_.fd ? enter(Stage::kFdCrc, 0) : enter(Stage::kCrc, 15);
}

/// The FD check sum field: left_ counts its bits upwards, without the fixed stuff bit before every fourth of them.
Verdict FrameReader::push_fd_crc(bool recessive) {
  field_ = Field::kCrc;
  const bool is_long = frame_.length > 16;
  if (left_ % 4 == 0 && run_ != 0) {
    if (recessive == last_) return Verdict::kFormError;
    last_ = recessive;
    run_ = 0;  // This fixed stuff bit is through.
    return Verdict::kGoesOn;
  }
  last_ = recessive;
  run_ = 1;
  value_ = value_ << 1U | (recessive ? 1U : 0U);
  ++left_;
  if (left_ <= 4) {
    crc17_.push(recessive);
    crc21_.push(recessive);
    if (left_ == 4) {
      crc_wrong_ = value_ != can::encode_stuff_count(stuff_count_);
      value_ = 0;
    }
  } else if (left_ == 4U + (is_long ? 21U : 17U)) {
    crc_wrong_ = crc_wrong_ || value_ != (is_long ? crc21_ : crc17_).value();
    enter(Stage::kCrcDelimiter, 1);
  }
  return Verdict::kGoesOn;
}

Verdict FrameReader::push_fixed(bool recessive) {
  field_ = locate();
  switch (stage_) {
    case Stage::kCrcDelimiter:
      enter(Stage::kAck, 1);
      return recessive ? Verdict::kGoesOn : Verdict::kFormError;
    case Stage::kAck:
      enter(Stage::kAckDelimiter, 1);
      return Verdict::kGoesOn;
    case Stage::kAckDelimiter:
      enter(Stage::kEnd, 7);
      if (!recessive) return Verdict::kFormError;
      return crc_wrong_ ? Verdict::kCrcError : Verdict::kGoesOn;
    default:
      if (--left_ == 0) return Verdict::kFrame;
      return recessive ? Verdict::kGoesOn : Verdict::kFormError;
  }
}

Field FrameReader::locate() const {
  switch (stage_) {
    case Stage::kStart:
      return Field::kStart;
    case Stage::kBase:
      return left_ > 3 ? Field::kId28To21 : Field::kId20To18;
    case Stage::kSubstitute:
      return Field::kSubstitute;
    case Stage::kIde:
      return Field::kIde;
    case Stage::kExtension:
      return left_ > 13 ? Field::kId17To13 : left_ > 5 ? Field::kId12To5 : Field::kId4To0;
    case Stage::kRemote:
      return Field::kRemote;
    case Stage::kFormat:
      return frame_.extended ? Field::kReserved1 : Field::kReserved0;
    case Stage::kReserved:
    case Stage::kFdReserved:
    case Stage::kBrs:
    case Stage::kEsi:
      return Field::kReserved0;
    case Stage::kLength:
      return Field::kLength;
    case Stage::kData:
      return Field::kData;
    case Stage::kCrc:
    case Stage::kFdCrc:
      return Field::kCrc;
    case Stage::kCrcDelimiter:
      return Field::kCrcDelimiter;
    case Stage::kAck:
      return Field::kAck;
    case Stage::kAckDelimiter:
      return Field::kAckDelimiter;
    case Stage::kEnd:
      return Field::kEnd;
  }
  return Field::kNone;
}

}  // namespace meltbench::bus
