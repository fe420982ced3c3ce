#include "protocols/modbus/types.hpp"

#include <bit>

namespace meltbench::modbus {

namespace {

constexpr std::array<std::uint16_t, 256> make_crc_table() {
  std::array<std::uint16_t, 256> table{};
  for (unsigned byte = 0; byte < table.size(); ++byte) {
    unsigned crc = byte;
    for (int bit = 0; bit < 8; ++bit) crc = (crc & 1U) != 0 ? (crc >> 1U) ^ 0xA001U : crc >> 1U;
    table[byte] = static_cast<std::uint16_t>(crc);
  }
  return table;
}

constexpr std::array<std::uint16_t, 256> kCrcTable = make_crc_table();
constexpr std::uint32_t kFastestWithCountedGaps = 19'200;

}  // namespace

std::string_view text(ExceptionCode code) {
  switch (code) {
    case ExceptionCode::kNone:
      return "none";
    case ExceptionCode::kIllegalFunction:
      return "illegal function";
    case ExceptionCode::kIllegalAddress:
      return "illegal address";
    case ExceptionCode::kIllegalValue:
      return "illegal value";
    case ExceptionCode::kDeviceFailure:
      return "device failure";
    case ExceptionCode::kAcknowledge:
      return "acknowledge";
    case ExceptionCode::kBusy:
      return "busy";
    case ExceptionCode::kMemoryParity:
      return "memory parity error";
    case ExceptionCode::kGatewayPath:
      return "gateway path unavailable";
    case ExceptionCode::kGatewayTarget:
      return "gateway target does not answer";
  }
  return "unknown exception";
}

std::uint16_t calc_crc(std::span<const std::uint8_t> bytes) {
  std::uint16_t crc = 0xFFFF;
  for (const std::uint8_t byte : bytes) {
    crc = static_cast<std::uint16_t>((crc >> 8U) ^ kCrcTable[(crc ^ byte) & 0xFFU]);
  }
  return crc;
}

std::uint16_t load_word(std::span<const std::uint8_t> bytes, std::size_t at) {
  return static_cast<std::uint16_t>((bytes[at] << 8U) | bytes[at + 1]);
}

LineTiming make_line_timing(std::uint32_t baud_rate, unsigned bits_per_character) {
  const auto times = [&](Nanos::rep half_bits) {
    return Nanos{half_bits * bits_per_character * 1'000'000'000 / (2 * Nanos::rep{baud_rate})};
  };
  if (baud_rate > kFastestWithCountedGaps) return {times(2), 750us, 1750us};
  return {times(2), times(3), times(7)};
}

WordPair to_words(std::uint32_t value, WordOrder order) {
  const auto high = static_cast<std::uint16_t>(value >> 16U);
  const auto low = static_cast<std::uint16_t>(value & 0xFFFFU);
  return order == WordOrder::kHighFirst ? WordPair{high, low} : WordPair{low, high};
}

WordPair to_words(float value, WordOrder order) {
  return to_words(std::bit_cast<std::uint32_t>(value), order);
}

std::uint32_t to_u32(std::span<const std::uint16_t> words, WordOrder order) {
  const bool high_first = order == WordOrder::kHighFirst;
  return (std::uint32_t{words[high_first ? 0 : 1]} << 16U) | words[high_first ? 1 : 0];
}

float to_float(std::span<const std::uint16_t> words, WordOrder order) {
  return std::bit_cast<float>(to_u32(words, order));
}

}  // namespace meltbench::modbus
