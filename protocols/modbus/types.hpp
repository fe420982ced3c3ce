#pragma once
/// Names, limits, checksum and line times of Modbus RTU.
///
/// Sources: MODBUS Application Protocol Specification V1.1b3 and MODBUS over Serial Line V1.02, modbus.org.

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string_view>

#include "protocols/time/instant.hpp"

namespace meltbench::modbus {

/// The function codes that are spoken here.
enum class Function : std::uint8_t {
  kReadCoils = 1,
  kReadDiscreteInputs = 2,
  kReadHoldingRegisters = 3,
  kReadInputRegisters = 4,
  kWriteCoil = 5,
  kWriteRegister = 6,
  kWriteCoils = 15,
  kWriteRegisters = 16,
  kReadWriteRegisters = 23,  ///< Writes first, then reads.
  kEncapsulated = 43,        ///< With kReadIdentification.
};

inline constexpr std::uint8_t kReadIdentification = 14;  ///< MEI type of function 43: who the device is.
inline constexpr std::uint8_t kExceptionBit = 0x80;      ///< Of the function code in an answer: refused.

/// Why a request was refused; kNone: it was not.
enum class ExceptionCode : std::uint8_t {
  kNone = 0,
  kIllegalFunction = 1,
  kIllegalAddress = 2,
  kIllegalValue = 3,
  kDeviceFailure = 4,
  kAcknowledge = 5,  ///< Accepted, takes long.
  kBusy = 6,
  kMemoryParity = 8,
  kGatewayPath = 0x0A,
  kGatewayTarget = 0x0B,
};
/// "illegal address"; a code that the specification does not have: "unknown exception".
[[nodiscard]] std::string_view text(ExceptionCode code);

inline constexpr std::uint8_t kBroadcast = 0;  ///< Unit that all devices listen to: write functions, nobody answers.
inline constexpr std::uint8_t kMaxUnit = 247;

inline constexpr std::size_t kMaxFrame = 256;          ///< Unit, PDU and checksum.
inline constexpr std::size_t kMaxPdu = kMaxFrame - 3;  ///< Function code and data.
inline constexpr std::size_t kMinFrame = 4;

inline constexpr std::uint16_t kMaxReadBits = 2000;
inline constexpr std::uint16_t kMaxWriteBits = 1968;
inline constexpr std::uint16_t kMaxReadRegisters = 125;
inline constexpr std::uint16_t kMaxWriteRegisters = 123;
inline constexpr std::uint16_t kMaxReadWriteRegisters = 121;  ///< To write, with function 23.

/// The four tables of a device.
enum class Table : std::uint8_t { kCoils, kDiscreteInputs, kInputRegisters, kHoldingRegisters };

/// The checksum that ends a frame, low byte first: polynomial 0xA001 (reflected), start 0xFFFF; of "123456789" 0x4B37.
[[nodiscard]] std::uint16_t calc_crc(std::span<const std::uint8_t> bytes);

/// Big-endian word at bytes[at], bytes[at + 1]. @pre they are there.
[[nodiscard]] std::uint16_t load_word(std::span<const std::uint8_t> bytes, std::size_t at);

/// Times on a line. A frame is followed by silence of at least t3_5; characters of one frame follow each other within
/// t1_5. USB adapters and ptys cannot keep t1_5, so a reader here takes gaps up to t3_5.
struct LineTiming {
  Nanos character;
  Nanos t1_5;
  Nanos t3_5;

  /// Time that so many characters take on the wire.
  [[nodiscard]] constexpr Nanos on_wire(std::size_t characters) const {
    return character * static_cast<Nanos::rep>(characters);
  }
};

/// Above 19,200 baud t1_5 and t3_5 are fixed: 750 and 1750 us.
/// @param bits_per_character  start, data, parity and stop bits: 11 with 8E1 or 8N2, 10 with 8N1.
/// @pre baud_rate > 0.
[[nodiscard]] LineTiming make_line_timing(std::uint32_t baud_rate, unsigned bits_per_character = 11);

/// Which word of a 32-bit value has the lower address. The specification does not say; devices of both kinds are sold.
enum class WordOrder : std::uint8_t { kHighFirst = 0, kLowFirst = 1 };

/// 32-bit values in two registers.
using WordPair = std::array<std::uint16_t, 2>;
[[nodiscard]] WordPair to_words(std::uint32_t value, WordOrder order);
[[nodiscard]] WordPair to_words(float value, WordOrder order);
/// @pre words.size() >= 2.
[[nodiscard]] std::uint32_t to_u32(std::span<const std::uint16_t> words, WordOrder order);
[[nodiscard]] float to_float(std::span<const std::uint16_t> words, WordOrder order);

}  // namespace meltbench::modbus
