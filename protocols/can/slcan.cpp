#include "protocols/can/slcan.hpp"

#include <array>

#include "protocols/can/hex.hpp"

namespace meltbench::can {
namespace {

constexpr std::array<std::uint32_t, 9> kBitRates{10'000,  20'000,  50'000,  100'000,  125'000,
                                                 250'000, 500'000, 800'000, 1'000'000};

/// Lower case: 11-bit identifier; upper case: 29-bit.
char letter_of(const CanFrame& frame) {
  char letter = 't';
  if (frame.kind == FrameKind::kRemote)
    letter = 'r';
  else if (frame.fd)
    letter = frame.brs ? 'b' : 'd';
  return frame.extended ? static_cast<char>(letter - 'a' + 'A') : letter;
}

/// Sets what the letter says. False: it begins no frame.
bool read_letter(char letter, CanFrame& frame) {
  frame.extended = letter >= 'A' && letter <= 'Z';
  const char lower = frame.extended ? static_cast<char>(letter - 'A' + 'a') : letter;
  frame.kind = lower == 'r' ? FrameKind::kRemote : FrameKind::kData;
  frame.fd = lower == 'd' || lower == 'b';
  frame.brs = lower == 'b';
  return lower == 't' || lower == 'r' || frame.fd;
}

}  // namespace

bool append_slcan(std::string& out, const CanFrame& frame) {
  if (frame.kind == FrameKind::kError) return false;
  out.push_back(letter_of(frame));
  append_hex(out, frame.id, frame.extended ? 8 : 3);
  out.push_back(kHexDigits[frame.fd ? to_fd_dlc(frame.length) : frame.length]);
  for (const std::uint8_t byte : frame.data()) append_hex(out, byte, 2);
  out.push_back(kSlcanEnd);
  return true;
}

std::optional<SlcanFrame> parse_slcan(std::string_view line) {
  SlcanFrame read;
  CanFrame& frame = read.frame;
  if (line.empty() || !read_letter(line.front(), frame)) return std::nullopt;
  line.remove_prefix(1);

  const std::size_t id_digits = frame.extended ? 8 : 3;
  if (line.size() < id_digits + 1) return std::nullopt;
  const auto id = parse_hex(line.substr(0, id_digits));
  const int dlc = hex_value(line[id_digits]);
  if (!id || dlc < 0 || (!frame.fd && dlc > 8)) return std::nullopt;
  frame.id = *id;
  frame.length = frame.fd ? from_fd_dlc(static_cast<std::size_t>(dlc)) : static_cast<std::uint8_t>(dlc);
  line.remove_prefix(id_digits + 1);

  const std::size_t size = frame.data().size();
  if (line.size() < 2 * size) return std::nullopt;
  for (std::size_t i = 0; i < size; ++i) {
    const auto byte = parse_hex(line.substr(2 * i, 2));
    if (!byte) return std::nullopt;
    frame.bytes[i] = static_cast<std::uint8_t>(*byte);
  }
  line.remove_prefix(2 * size);

  if (line.size() == 4 || line.size() == 8) {
    read.stamp = parse_hex(line);
    if (!read.stamp) return std::nullopt;
  } else if (!line.empty()) {
    return std::nullopt;
  }
  if (!is_valid(frame)) return std::nullopt;
  return read;
}

std::optional<char> slcan_bit_rate_digit(std::uint32_t bit_rate_bit_per_s) {
  const auto* found = std::ranges::find(kBitRates, bit_rate_bit_per_s);
  if (found == kBitRates.end()) return std::nullopt;
  return static_cast<char>('0' + (found - kBitRates.begin()));
}

void SlcanLines::feed(std::span<const std::uint8_t> bytes) {
  text_.erase(0, read_);
  read_ = 0;
  for (const std::uint8_t byte : bytes) {
    if (byte != '\n') text_.push_back(static_cast<char>(byte));
  }
}

std::optional<std::string_view> SlcanLines::next() {
  while (true) {
    const std::size_t end = text_.find_first_of("\r\a", read_);
    if (end == std::string::npos) break;
    if (const auto line = take_until(end)) return line;
  }
  if (text_.size() - read_ > kMaxLine) {
    text_.resize(read_);
    skipping_ = true;
  }
  return std::nullopt;
}

/// The line that ends at `end`, if it is not to be skipped; the BEL that ends a line is left to be read next.
std::optional<std::string_view> SlcanLines::take_until(std::size_t end) {
  const std::string_view line{text_.data() + read_, end - read_};
  const bool refused = text_[end] == kSlcanRefused;
  const bool good = !skipping_ && line.size() <= kMaxLine;
  if (refused && line.empty() && !skipping_) {
    read_ = end + 1;
    return std::string_view{text_.data() + end, 1};
  }
  read_ = refused ? end : end + 1;
  skipping_ = false;
  if (good) return line;
  ++dropped_;
  return std::nullopt;
}

void SlcanLines::clear() {
  text_.clear();
  read_ = 0;
  skipping_ = false;
}

}  // namespace meltbench::can
