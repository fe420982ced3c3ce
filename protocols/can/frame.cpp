#include "protocols/can/frame.hpp"

namespace meltbench::can {
namespace {

constexpr std::array<std::uint8_t, 16> kFdLengths{0, 1, 2, 3, 4, 5, 6, 7, 8, 12, 16, 20, 24, 32, 48, 64};

}  // namespace

bool CanFrame::operator==(const CanFrame& other) const {
  return id == other.id && kind == other.kind && extended == other.extended && fd == other.fd && brs == other.brs &&
         esi == other.esi && length == other.length && raw_dlc == other.raw_dlc &&
         std::ranges::equal(data(), other.data());
}

CanFrame make_frame(std::uint32_t id, std::span<const std::uint8_t> data) {
  CanFrame frame;
  frame.id = id & kMaxStandardId;
  frame.length = static_cast<std::uint8_t>(std::min(data.size(), kMaxClassicLength));
  std::copy_n(data.begin(), frame.length, frame.bytes.begin());
  return frame;
}

CanFrame make_frame(std::uint32_t id, std::initializer_list<std::uint8_t> data) {
  return make_frame(id, std::span{data.begin(), data.size()});
}

bool is_valid(const CanFrame& frame) {
  const bool id_fits =
      frame.id <= (frame.extended || frame.kind == FrameKind::kError ? kMaxExtendedId : kMaxStandardId);
  const bool length_fits =
      frame.fd ? std::ranges::find(kFdLengths, frame.length) != kFdLengths.end() : frame.length <= kMaxClassicLength;
  const bool flags_fit = frame.fd ? frame.kind == FrameKind::kData : !frame.brs && !frame.esi;
  const bool dlc_fits = frame.raw_dlc == 0 || (!frame.fd && frame.length == kMaxClassicLength && frame.raw_dlc >= 9 &&
                                               frame.raw_dlc <= 15 && frame.kind != FrameKind::kError);
  return id_fits && length_fits && flags_fit && dlc_fits;
}

std::uint8_t round_up_to_fd_length(std::size_t length) {
  return *std::ranges::lower_bound(kFdLengths, static_cast<std::uint8_t>(std::min(length, kMaxFdLength)));
}

std::uint8_t to_fd_dlc(std::size_t length) {
  return static_cast<std::uint8_t>(std::ranges::lower_bound(kFdLengths, static_cast<std::uint8_t>(length)) -
                                   kFdLengths.begin());
}

std::uint8_t from_fd_dlc(std::size_t dlc) {
  return kFdLengths[dlc];
}

}  // namespace meltbench::can
