#include "protocols/link/bench_message.hpp"

#include <algorithm>

namespace meltbench::link {
namespace {

/// A frame as it stands in a message; `length` data bytes follow it.
struct FrameHeader {
  std::int64_t at_ns;
  std::uint32_t id;
  std::uint8_t flags;
  std::uint8_t length;
  std::uint8_t raw_dlc;
  std::uint8_t reserved;
};
static_assert(sizeof(FrameHeader) == 16);

constexpr std::uint8_t kExtended = 1U << 2U;
constexpr std::uint8_t kFd = 1U << 3U;
constexpr std::uint8_t kBrs = 1U << 4U;
constexpr std::uint8_t kEsi = 1U << 5U;
constexpr std::uint8_t kKindMask = 3U;

}  // namespace

void MessageWriter::put_text(std::string_view text) {
  put(static_cast<std::uint32_t>(text.size()));
  put_bytes(text.data(), text.size());
}

void MessageWriter::put_frame(Instant at, const can::CanFrame& frame) {
  const auto flags =
      static_cast<std::uint8_t>(static_cast<std::uint8_t>(frame.kind) | (frame.extended ? kExtended : 0) |
                                (frame.fd ? kFd : 0) | (frame.brs ? kBrs : 0) | (frame.esi ? kEsi : 0));
  put(FrameHeader{at.since_start.count(), frame.id, flags, frame.length, frame.raw_dlc, 0});
  put_bytes(frame.bytes.data(), frame.data().size());
}

void MessageWriter::put_numbers(std::span<const double> numbers) {
  put_bytes(numbers.data(), numbers.size_bytes());
}

std::string_view MessageReader::take_text() {
  const auto size = take<std::uint32_t>();
  if (rest_.size() < size) {
    ok_ = false;
    rest_ = {};
    return {};
  }
  const std::string_view text{reinterpret_cast<const char*>(rest_.data()), size};
  rest_ = rest_.subspan(size);
  return text;
}

can::StampedFrame MessageReader::take_frame() {
  const auto header = take<FrameHeader>();
  can::StampedFrame stamped{Instant{Nanos{header.at_ns}}, {}};
  can::CanFrame& frame = stamped.frame;
  frame.id = header.id;
  frame.kind = static_cast<can::FrameKind>(header.flags & kKindMask);
  frame.extended = (header.flags & kExtended) != 0;
  frame.fd = (header.flags & kFd) != 0;
  frame.brs = (header.flags & kBrs) != 0;
  frame.esi = (header.flags & kEsi) != 0;
  frame.length = header.length;
  frame.raw_dlc = header.raw_dlc;
  if ((header.flags & kKindMask) > 2 || !can::is_valid(frame) || rest_.size() < frame.data().size()) {
    ok_ = false;
    rest_ = {};
    return {};
  }
  const std::size_t size = frame.data().size();
  std::copy_n(rest_.begin(), size, frame.bytes.begin());  // Not memcpy: nothing left is a null pointer.
  rest_ = rest_.subspan(size);
  return stamped;
}

void MessageReader::take_numbers(std::span<double> numbers) {
  if (rest_.size() < numbers.size_bytes()) {
    ok_ = false;
    rest_ = {};
    return;
  }
  if (!numbers.empty()) std::memcpy(numbers.data(), rest_.data(), numbers.size_bytes());
  rest_ = rest_.subspan(numbers.size_bytes());
}

}  // namespace meltbench::link
