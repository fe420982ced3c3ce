#include "protocols/can/candump.hpp"

#include <array>

#include "protocols/can/hex.hpp"

namespace meltbench::can {
namespace {

constexpr std::uint32_t kErrorFlag = 0x2000'0000;

constexpr std::array<char, 512> make_byte_text() {
  std::array<char, 512> text{};
  for (std::size_t byte = 0; byte < 256; ++byte) {
    text[2 * byte] = kHexDigits[byte >> 4U];
    text[2 * byte + 1] = kHexDigits[byte & 0xFU];
  }
  return text;
}
constexpr auto kByteText = make_byte_text();

void append_bytes(std::string& out, std::span<const std::uint8_t> bytes) {
  for (const std::uint8_t byte : bytes) out.append(&kByteText[2U * byte], 2);
}

/// Sets id, extended and kind from the 3 or 8 digits before '#'.
bool parse_id(std::string_view digits, CanFrame& frame) {
  const auto value = parse_hex(digits);
  if (!value) return false;
  if (digits.size() == 3) {
    frame.id = *value;
    return true;
  }
  if (digits.size() != 8) return false;
  if ((*value & kErrorFlag) != 0) {
    frame.kind = FrameKind::kError;
    frame.id = *value & ~kErrorFlag;
  } else {
    frame.extended = true;
    frame.id = *value;
  }
  return true;
}

/// Takes byte pairs, with single dots between them, off the front of `text`. False on half a byte or too many.
bool parse_bytes(std::string_view& text, std::size_t limit, CanFrame& frame) {
  frame.length = 0;
  while (!text.empty() && text.front() != '_') {
    if (text.front() == '.' && frame.length > 0) text.remove_prefix(1);
    if (text.size() < 2 || frame.length >= limit) return false;
    const auto byte = parse_hex(text.substr(0, 2));
    if (!byte) return false;
    frame.bytes[frame.length++] = static_cast<std::uint8_t>(*byte);
    text.remove_prefix(2);
  }
  return true;
}

/// Reads "_9" .. "_F", the raw DLC of a classic frame of 8 bytes; nothing left of it is fine too.
bool parse_raw_dlc(std::string_view text, CanFrame& frame) {
  if (text.empty()) return true;
  if (text.size() != 2 || text[0] != '_') return false;
  const int dlc = hex_value(text[1]);
  if (dlc < 9) return false;
  frame.raw_dlc = static_cast<std::uint8_t>(dlc);
  return true;
}

bool parse_remote(std::string_view text, CanFrame& frame) {
  frame.kind = FrameKind::kRemote;
  if (!text.empty() && text.front() >= '0' && text.front() <= '8') {
    frame.length = static_cast<std::uint8_t>(text.front() - '0');
    text.remove_prefix(1);
  }
  return parse_raw_dlc(text, frame);
}

bool parse_fd(std::string_view text, CanFrame& frame) {
  const int flags = text.empty() ? -1 : hex_value(text.front());
  if (flags < 0) return false;
  frame.fd = true;
  frame.brs = (flags & 1) != 0;
  frame.esi = (flags & 2) != 0;
  text.remove_prefix(1);
  return parse_bytes(text, kMaxFdLength, frame) && text.empty();
}

bool parse_payload(std::string_view text, CanFrame& frame) {
  if (!text.empty() && text.front() == '#') return parse_fd(text.substr(1), frame);
  if (!text.empty() && (text.front() == 'R' || text.front() == 'r')) {
    return frame.kind != FrameKind::kError && parse_remote(text.substr(1), frame);
  }
  return parse_bytes(text, kMaxClassicLength, frame) && parse_raw_dlc(text, frame);
}

ParsedLogLine bad(std::string_view complaint, std::size_t column) {
  ParsedLogLine result;
  result.complaint = complaint;
  result.column = column;
  return result;
}

bool is_digit(char character) {
  return character >= '0' && character <= '9';
}

/// Reads "seconds.fraction" with 6 or 9 digits of fraction. Seconds are limited to 10 digits: no overflow.
std::optional<Instant> parse_time(std::string_view text) {
  const std::size_t dot = text.find('.');
  if (dot == std::string_view::npos || dot == 0 || dot > 10) return std::nullopt;
  const std::string_view fraction = text.substr(dot + 1);
  if (fraction.size() != 6 && fraction.size() != 9) return std::nullopt;
  std::int64_t seconds = 0;
  for (const char digit : text.substr(0, dot)) {
    if (!is_digit(digit)) return std::nullopt;
    seconds = 10 * seconds + (digit - '0');
  }
  if (seconds >= 9'000'000'000) return std::nullopt;  // 2^63 ns are 9.2e9 s.
  std::int64_t nanoseconds = 0;
  for (const char digit : fraction) {
    if (!is_digit(digit)) return std::nullopt;
    nanoseconds = 10 * nanoseconds + (digit - '0');
  }
  if (fraction.size() == 6) nanoseconds *= 1000;
  return Instant{Nanos{seconds * 1'000'000'000 + nanoseconds}};
}

}  // namespace

void append_candump(std::string& out, const CanFrame& frame) {
  if (frame.kind == FrameKind::kError) {
    append_hex(out, frame.id | kErrorFlag, 8);
  } else {
    append_hex(out, frame.id, frame.extended ? 8 : 3);
  }
  out.push_back('#');
  if (frame.kind == FrameKind::kRemote) {
    out.push_back('R');
    if (frame.length > 0) out.push_back(static_cast<char>('0' + frame.length));
  } else if (frame.fd) {
    out.push_back('#');
    out.push_back(static_cast<char>('0' + (frame.brs ? 1 : 0) + (frame.esi ? 2 : 0)));
  }
  append_bytes(out, frame.data());
  if (frame.raw_dlc != 0) {
    out.push_back('_');
    out.push_back(kHexDigits[frame.raw_dlc & 0xFU]);
  }
}

std::string to_candump(const CanFrame& frame) {
  std::string text;
  append_candump(text, frame);
  return text;
}

std::optional<CanFrame> parse_candump(std::string_view text) {
  const std::size_t hash = text.find('#');
  if (hash == std::string_view::npos) return std::nullopt;
  CanFrame frame;
  if (!parse_id(text.substr(0, hash), frame) || !parse_payload(text.substr(hash + 1), frame) || !is_valid(frame)) {
    return std::nullopt;
  }
  return frame;
}

void append_log_line(std::string& out, Instant at, std::string_view device, const CanFrame& frame) {
  std::array<char, 20> stamp{"(0000000000.000000)"};
  std::int64_t microseconds = at.since_start.count() / 1000;
  for (std::size_t position = 17; position > 0; --position) {
    if (position == 11) continue;  // The point.
    stamp[position] = static_cast<char>('0' + microseconds % 10);
    microseconds /= 10;
  }
  out.append(stamp.data(), 19);
  out.push_back(' ');
  out.append(device);
  out.push_back(' ');
  append_candump(out, frame);
  out.push_back('\n');
}

ParsedLogLine parse_log_line(std::string_view line) {
  while (!line.empty() && (line.back() == '\n' || line.back() == '\r' || line.back() == ' ')) line.remove_suffix(1);
  ParsedLogLine result;
  if (line.empty() || line.front() != '(') {
    result.kind = LogLineKind::kComment;
    return result;
  }
  const std::size_t close = line.find(')');
  if (close == std::string_view::npos) return bad("time stamp without its closing ')'", 1);
  const auto at = parse_time(line.substr(1, close - 1));
  if (!at) return bad("time stamp is not seconds with 6 or 9 digits of fraction", 2);
  const std::size_t device_start = close + 2;
  const std::size_t device_end = line.find(' ', std::min(device_start, line.size()));
  if (device_end == std::string_view::npos || line[close + 1] != ' ' || device_end == device_start) {
    return bad("expected ' device frame' after the time stamp", close + 2);
  }
  std::string_view text = line.substr(device_end + 1);
  char direction = ' ';
  if (text.ends_with(" T") || text.ends_with(" R")) {
    direction = text.back();
    text.remove_suffix(2);
  }
  const auto frame = parse_candump(text);
  if (!frame) return bad("not a frame, e.g. 123#DEADBEEF", device_end + 2);
  result.kind = LogLineKind::kFrame;
  result.line = LogLine{*at, line.substr(device_start, device_end - device_start), *frame, direction};
  return result;
}

}  // namespace meltbench::can
