#include "protocols/modbus/frame_reader.hpp"

#include <utility>

namespace meltbench::modbus {

namespace {

constexpr std::size_t kFixed = 8;  // Unit, function, two words, checksum.

std::optional<std::size_t> find_counted(std::span<const std::uint8_t> begin, std::size_t count_at) {
  if (begin.size() <= count_at) return {};
  return count_at + 1 + begin[count_at] + 2;
}

/// Unit, 43, 14, code, conformity, more, next, count, then id, length and text of each object.
std::optional<std::size_t> find_identification_length(std::span<const std::uint8_t> begin) {
  constexpr std::size_t kCountAt = 7;
  if (begin.size() <= 2 || begin[2] != kReadIdentification || begin.size() <= kCountAt) return {};
  std::size_t end = kCountAt + 1;
  for (unsigned object = 0; object < begin[kCountAt]; ++object) {
    if (begin.size() <= end + 1) return {};
    end += 2U + begin[end + 1];
  }
  return end + 2;
}

std::optional<std::size_t> find_request_length(std::span<const std::uint8_t> begin) {
  switch (static_cast<Function>(begin[1])) {
    case Function::kReadCoils:
    case Function::kReadDiscreteInputs:
    case Function::kReadHoldingRegisters:
    case Function::kReadInputRegisters:
    case Function::kWriteCoil:
    case Function::kWriteRegister:
      return kFixed;
    case Function::kWriteCoils:
    case Function::kWriteRegisters:
      return find_counted(begin, 6);
    case Function::kReadWriteRegisters:
      return find_counted(begin, 10);
    case Function::kEncapsulated:
      if (begin.size() <= 2 || begin[2] != kReadIdentification) return {};
      return 7;
  }
  return {};
}

std::optional<std::size_t> find_answer_length(std::span<const std::uint8_t> begin) {
  if ((begin[1] & kExceptionBit) != 0) return 5;
  switch (static_cast<Function>(begin[1])) {
    case Function::kReadCoils:
    case Function::kReadDiscreteInputs:
    case Function::kReadHoldingRegisters:
    case Function::kReadInputRegisters:
    case Function::kReadWriteRegisters:
      return find_counted(begin, 2);
    case Function::kWriteCoil:
    case Function::kWriteRegister:
    case Function::kWriteCoils:
    case Function::kWriteRegisters:
      return kFixed;
    case Function::kEncapsulated:
      return find_identification_length(begin);
  }
  return {};
}

}  // namespace

std::optional<std::size_t> find_length(Direction direction, std::span<const std::uint8_t> begin) {
  if (begin.size() < 2) return {};
  return direction == Direction::kRequests ? find_request_length(begin) : find_answer_length(begin);
}

std::size_t FrameReader::take(Instant at, std::span<const std::uint8_t> bytes) {
  if (bytes.empty()) return 0;
  // Bytes of a pty come all at once, so this may be before the last byte: no gap then.
  const Instant first_sent = at - timing_.on_wire(bytes.size());
  if (last_byte_at_ && first_sent - *last_byte_at_ > timing_.t3_5) end_by_silence(first_sent);
  if (frame_) return 0;  // Silence had ended one; it comes first.
  last_byte_at_ = at;
  for (std::size_t taken = 0; taken < bytes.size();) {
    if (garbled_) return bytes.size();
    if (size_ == bytes_.size()) {
      garble();
      return bytes.size();
    }
    bytes_[size_++] = bytes[taken++];
    const auto length = find_length(direction_, std::span{bytes_}.first(size_));
    if (length && *length > bytes_.size()) garble();
    if (length && size_ == *length) complete(at - timing_.on_wire(bytes.size() - taken));
    if (frame_) {
      last_byte_at_ = frame_->at;
      return taken;
    }
  }
  return bytes.size();
}

void FrameReader::on_time(Instant now) {
  if (last_byte_at_ && now - *last_byte_at_ >= timing_.t3_5) end_by_silence(*last_byte_at_ + timing_.t3_5);
}

void FrameReader::end_by_silence(Instant at) {
  if (size_ > 0 && !garbled_) {
    // A frame whose length is known and that is still here has broken off.
    const bool broken = size_ < kMinFrame || find_length(direction_, std::span{bytes_}.first(size_)).has_value();
    if (broken)
      garble();
    else
      complete(at);
  }
  reset();
}

void FrameReader::complete(Instant at) {
  const std::size_t end = size_ - 2;
  const auto expected = static_cast<std::uint16_t>(bytes_[end] | (bytes_[end + 1] << 8U));
  if (calc_crc(std::span{bytes_}.first(end)) != expected) return garble();
  frame_ = Frame{bytes_[0], std::span{bytes_}.subspan(1, end - 1), at};
  size_ = 0;
}

void FrameReader::garble() {
  garbled_ = true;
  ++frames_lost_;
}

std::optional<Frame> FrameReader::take_frame() {
  return std::exchange(frame_, std::nullopt);
}

Instant FrameReader::next_deadline() const {
  if (size_ == 0 || garbled_) return Instant::never();
  return *last_byte_at_ + timing_.t3_5;
}

}  // namespace meltbench::modbus
