#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

#include "protocols/time/instant.hpp"

namespace meltbench::serial {

enum class Parity : std::uint8_t { kNone, kEven, kOdd };

/// How the characters of an asynchronous serial line look: one start bit, eight data bits, parity, stop bits.
/// The default is that of Modbus RTU (Modbus over serial line V1.02, 2.5.1): 19200 baud, 8E1.
struct LineSettings {
  std::uint32_t baud_rate = 19200;  ///< [bit/s] > 0
  Parity parity = Parity::kEven;
  std::uint8_t stop_bits = 1;  ///< 1 or 2

  bool operator==(const LineSettings&) const = default;
};

/// "8E1", "8N1", "8O1", "8N2": what write_format() gives. @returns nothing if it is none of them.
[[nodiscard]] constexpr std::optional<LineSettings> with_format(LineSettings line, std::string_view format) {
  if (format != "8E1" && format != "8N1" && format != "8O1" && format != "8N2") return std::nullopt;
  line.parity = format[1] == 'E' ? Parity::kEven : format[1] == 'O' ? Parity::kOdd : Parity::kNone;
  line.stop_bits = static_cast<std::uint8_t>(format[2] - '0');
  return line;
}
[[nodiscard]] inline std::string write_format(const LineSettings& line) {
  const char parity = line.parity == Parity::kEven ? 'E' : line.parity == Parity::kOdd ? 'O' : 'N';
  return std::string{'8', parity, static_cast<char>('0' + line.stop_bits)};
}

/// 10 for 8N1, 11 for 8E1, 8O1 and 8N2.
[[nodiscard]] constexpr std::uint32_t bits_per_character(const LineSettings& line) {
  return 1U + 8U + (line.parity == Parity::kNone ? 0U : 1U) + line.stop_bits;
}

/// Time on the line of `characters` that follow each other without a gap: characters · bits per character / baud rate,
/// rounded up to whole nanoseconds. @pre characters < 8e8 (no overflow).
[[nodiscard]] constexpr Nanos transmission_time(const LineSettings& line, std::size_t characters) {
  const auto bits = static_cast<std::int64_t>(characters) * bits_per_character(line);
  return Nanos{(bits * 1'000'000'000 + line.baud_rate - 1) / line.baud_rate};
}

}  // namespace meltbench::serial
