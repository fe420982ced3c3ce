#include "bench/log/serial_log.hpp"

#include <charconv>
#include <cmath>
#include <string_view>

#include "bench/log/log_error.hpp"
#include "bench/log/words.hpp"
#include "protocols/can/hex.hpp"

namespace meltbench::log {

void SerialLogReader::fail(const std::string& why) const {
  throw LogError{lines_.place() + ": " + why, "a line is \"(SECONDS) LINE SENDER BYTES\", bytes as hexadecimal digits"};
}

bool SerialLogReader::next(SerialEntry& entry) {
  std::string_view text;
  while (lines_.next(text)) {
    if (lines_.is_torn()) return false;
    if (!text.starts_with('(')) continue;
    constexpr double kMost_s = 9e9;  // As nanoseconds in 64 bits.
    const std::string_view stamp = take_word(text);
    double at_s = 0.0;
    const char* const end = stamp.data() + stamp.size() - 1;
    const auto [rest, error] = std::from_chars(stamp.data() + 1, end, at_s, std::chars_format::fixed);
    if (stamp.size() < 3 || stamp.back() != ')' || error != std::errc{} || rest != end) fail("no time in brackets");
    if (!(at_s >= 0.0 && at_s < kMost_s)) fail("a time of no calendar");
    entry.at = Instant{Nanos{std::llround(at_s * 1e6) * 1000}};
    entry.line = take_word(text);
    entry.sender = take_word(text);
    const std::string_view digits = take_word(text);
    if (digits.empty() || digits.size() % 2 != 0) fail("no whole bytes");
    entry.bytes.clear();
    for (std::size_t i = 0; i < digits.size(); i += 2) {
      const auto byte = can::parse_hex(digits.substr(i, 2));
      if (!byte) fail("bytes that are no hexadecimal digits");
      entry.bytes.push_back(static_cast<std::uint8_t>(*byte));
    }
    return true;
  }
  return false;
}

}  // namespace meltbench::log
