#pragma once
/// Hexadecimal digits, as the text forms of frames need them.

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

namespace meltbench::can {

inline constexpr std::string_view kHexDigits = "0123456789ABCDEF";

/// Value of one digit, or -1.
[[nodiscard]] constexpr int hex_value(char digit) {
  if (digit >= '0' && digit <= '9') return digit - '0';
  if (digit >= 'A' && digit <= 'F') return digit - 'A' + 10;
  if (digit >= 'a' && digit <= 'f') return digit - 'a' + 10;
  return -1;
}

/// Appends the last `digits` digits of the value, upper case.
inline void append_hex(std::string& out, std::uint32_t value, int digits) {
  for (int shift = 4 * (digits - 1); shift >= 0; shift -= 4) out.push_back(kHexDigits[(value >> shift) & 0xFU]);
}

/// @returns nothing if there is anything but digits. @pre at most 8 digits.
[[nodiscard]] inline std::optional<std::uint32_t> parse_hex(std::string_view digits) {
  std::uint32_t value = 0;
  for (const char digit : digits) {
    const int nibble = hex_value(digit);
    if (nibble < 0) return std::nullopt;
    value = value << 4U | static_cast<std::uint32_t>(nibble);
  }
  return value;
}

}  // namespace meltbench::can
