#pragma once
/// A frame as a string of '0' and '1', written straight from the tables of ISO 11898-1 and without any code of the
/// product: text in, text out, the check sum by long division. Slow, and for comparison only.

#include <cstdint>
#include <initializer_list>
#include <string>
#include <string_view>

#include "protocols/can/frame.hpp"

namespace meltbench::test {

struct EncodedFrame {
  std::string bits;                ///< From start of frame to end of frame.
  std::size_t data_rate_bits = 0;  ///< Of these, at the data bit rate.
};

inline std::string join(std::initializer_list<std::string_view> pieces) {
  std::string text;
  for (const std::string_view piece : pieces) text.append(piece);
  return text;
}

inline std::string binary(std::uint64_t value, int width) {
  std::string text;
  for (int i = width - 1; i >= 0; --i) text += ((value >> i) & 1U) != 0 ? '1' : '0';
  return text;
}

/// Remainder of bits * x^width by the polynomial (written out with its leading 1); `preset` goes to the first `width`
/// bits, as a register does that does not start from zero.
inline std::string divide(std::string bits, const std::string& polynomial, const std::string& preset) {
  const std::size_t width = polynomial.size() - 1;
  const std::size_t length = bits.size();
  bits += std::string(width, '0');
  for (std::size_t i = 0; i < width; ++i) bits[i] = bits[i] == preset[i] ? '0' : '1';
  for (std::size_t i = 0; i < length; ++i) {
    if (bits[i] == '0') continue;
    for (std::size_t j = 0; j <= width; ++j) bits[i + j] = bits[i + j] == polynomial[j] ? '0' : '1';
  }
  return bits.substr(length);
}

/// Puts the opposite bit after every five equal ones; the ones put in count as the beginning of the next five.
/// @param at_the_end  also if the five end the text.
inline std::string stuff(const std::string& bits, bool at_the_end) {
  std::string out;
  int equal = 0;
  for (std::size_t i = 0; i < bits.size(); ++i) {
    equal = !out.empty() && out.back() == bits[i] ? equal + 1 : 1;
    out += bits[i];
    if (equal == 5 && (at_the_end || i + 1 < bits.size())) {
      out += bits[i] == '0' ? '1' : '0';
      equal = 1;
    }
  }
  return out;
}

inline std::string arbitration_and_ide(const can::CanFrame& frame) {
  const std::string rtr = frame.kind == can::FrameKind::kRemote ? "1" : "0";
  if (!frame.extended) return join({"0", binary(frame.id, 11), rtr, "0"});
  return join({"0", binary(frame.id >> 18U, 11), "11", binary(frame.id & 0x3FFFFU, 18), rtr});
}

inline std::string data_bits(const can::CanFrame& frame) {
  std::string text;
  for (const std::uint8_t byte : frame.data()) text += binary(byte, 8);
  return text;
}

inline EncodedFrame encode_classic(const can::CanFrame& frame) {
  const std::string reserved = frame.extended ? "00" : "0";
  const unsigned dlc = frame.raw_dlc != 0 ? frame.raw_dlc : frame.length;
  const std::string covered = join({arbitration_and_ide(frame), reserved, binary(dlc, 4), data_bits(frame)});
  const std::string crc = divide(covered, "1100010110011001", std::string(15, '0'));
  return {join({stuff(covered + crc, true), "1", "11", "1111111"}), 0};
}

inline EncodedFrame encode_fd(const can::CanFrame& frame) {
  static constexpr unsigned kLengths[] = {0, 1, 2, 3, 4, 5, 6, 7, 8, 12, 16, 20, 24, 32, 48, 64};
  unsigned dlc = 0;
  while (kLengths[dlc] != frame.length) ++dlc;
  const std::string to_brs = join({arbitration_and_ide(frame), "1", "0", frame.brs ? "1" : "0"});
  const std::string behind = join({frame.esi ? "1" : "0", binary(dlc, 4), data_bits(frame)});
  const std::string stuffed = stuff(to_brs + behind, false);
  const std::size_t count = stuffed.size() - to_brs.size() - behind.size();
  static const char* const kGray[] = {"000", "001", "011", "010", "110", "111", "101", "100"};
  std::string sbc = kGray[count % 8];
  int ones = 0;
  for (const char bit : sbc) ones += bit == '1' ? 1 : 0;
  sbc += ones % 2 == 1 ? "1" : "0";
  const bool is_long = frame.length > 16;
  const std::string polynomial = is_long ? binary(0x302899, 22) : binary(0x3685B, 18);
  const std::string crc = divide(stuffed + sbc, polynomial, join({"1", std::string(is_long ? 20 : 16, '0')}));
  std::string field;
  const std::string plain = sbc + crc;
  for (std::size_t i = 0; i < plain.size(); ++i) {
    if (i % 4 == 0) {
      const char before = field.empty() ? stuffed.back() : field.back();
      field += before == '0' ? '1' : '0';
    }
    field += plain[i];
  }
  EncodedFrame result{join({stuffed, field, "1", "11", "1111111"}), 0};
  if (frame.brs) result.data_rate_bits = result.bits.size() - stuff(to_brs, false).size() - 9;
  return result;
}

inline EncodedFrame encode_bit_by_bit(const can::CanFrame& frame) {
  return frame.fd ? encode_fd(frame) : encode_classic(frame);
}

}  // namespace meltbench::test
