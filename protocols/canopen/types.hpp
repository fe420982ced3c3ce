#pragma once
/// Words of CANopen (CiA 301) that both sides of the wire share: data types, abort codes, NMT states, COB-IDs, byte
/// order.

#include <array>
#include <bit>
#include <compare>
#include <concepts>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "protocols/can/frame.hpp"

namespace meltbench::canopen {

/// Frames to be sent, in order. The caller owns and reuses it; everything here only appends.
using Frames = std::vector<can::CanFrame>;

static_assert(std::endian::native == std::endian::little,
              "values are copied to and from the wire as they lie in memory");

inline constexpr std::uint8_t kMaxNodeId = 127;

/// Standard data types by their index in the dictionary.
enum class DataType : std::uint16_t {
  kBoolean = 0x01,
  kInteger8 = 0x02,
  kInteger16 = 0x03,
  kInteger32 = 0x04,
  kUnsigned8 = 0x05,
  kUnsigned16 = 0x06,
  kUnsigned32 = 0x07,
  kReal32 = 0x08,
  kVisibleString = 0x09,
  kOctetString = 0x0A,
  kUnicodeString = 0x0B,
  kTimeOfDay = 0x0C,
  kTimeDifference = 0x0D,
  kDomain = 0x0F,
  kInteger24 = 0x10,
  kReal64 = 0x11,
  kInteger40 = 0x12,
  kInteger48 = 0x13,
  kInteger56 = 0x14,
  kInteger64 = 0x15,
  kUnsigned24 = 0x16,
  kUnsigned40 = 0x18,
  kUnsigned48 = 0x19,
  kUnsigned56 = 0x1A,
  kUnsigned64 = 0x1B,
};

/// Bytes of a value of this type on the wire; 0 for the types of variable length (strings, DOMAIN) and for unknown
/// ones.
[[nodiscard]] std::size_t size_of(DataType type);
[[nodiscard]] bool is_known(DataType type);
[[nodiscard]] bool is_signed(DataType type);
[[nodiscard]] bool is_real(DataType type);
[[nodiscard]] std::string_view text(DataType type);

/// Access as EDS files spell it: rww and rwr are rw that a PDO may only write or only read.
enum class AccessType : std::uint8_t { kReadOnly, kWriteOnly, kReadWrite, kReadWriteWrite, kReadWriteRead, kConst };

[[nodiscard]] constexpr bool is_readable(AccessType access) {
  return access != AccessType::kWriteOnly;
}
[[nodiscard]] constexpr bool is_writable(AccessType access) {
  return access != AccessType::kReadOnly && access != AccessType::kConst;
}

/// What an index holds, by its code in EDS files.
enum class ObjectCode : std::uint8_t { kDomain = 2, kVar = 7, kArray = 8, kRecord = 9 };

/// Place of a value in the dictionary.
struct ObjectAddress {
  std::uint16_t index = 0;
  std::uint8_t sub = 0;
  auto operator<=>(const ObjectAddress&) const = default;
};

/// "0x1018:1".
[[nodiscard]] std::string text(ObjectAddress address);

/// Why an SDO transfer was refused; kNone (0) is success.
enum class AbortCode : std::uint32_t {
  kNone = 0,
  kToggle = 0x0503'0000,
  kTimeout = 0x0504'0000,
  kBadCommand = 0x0504'0001,
  kBadBlockSize = 0x0504'0002,
  kBadSequence = 0x0504'0003,
  kBadCrc = 0x0504'0004,
  kOutOfMemory = 0x0504'0005,
  kUnsupportedAccess = 0x0601'0000,
  kWriteOnly = 0x0601'0001,
  kReadOnly = 0x0601'0002,
  kNoObject = 0x0602'0000,
  kNotMappable = 0x0604'0041,
  kPdoLength = 0x0604'0042,
  kIncompatible = 0x0604'0043,
  kInternalIncompatible = 0x0604'0047,
  kHardware = 0x0606'0000,
  kLengthMismatch = 0x0607'0010,
  kTooLong = 0x0607'0012,
  kTooShort = 0x0607'0013,
  kNoSubIndex = 0x0609'0011,
  kInvalidValue = 0x0609'0030,
  kTooHigh = 0x0609'0031,
  kTooLow = 0x0609'0032,
  kMaxBelowMin = 0x0609'0036,
  kNoResource = 0x060A'0023,
  kGeneral = 0x0800'0000,
  kCannotStore = 0x0800'0020,
  kLocalControl = 0x0800'0021,
  kDeviceState = 0x0800'0022,
  kNoDictionary = 0x0800'0023,
  kNoData = 0x0800'0024,
};

/// In words, e.g. "object does not exist"; "unknown abort code" for a code that is not in the list.
[[nodiscard]] std::string_view text(AbortCode code);

/// NMT state as in the heartbeat. kInitialising is what a boot-up message carries.
enum class NmtState : std::uint8_t {
  kInitialising = 0x00,
  kStopped = 0x04,
  kOperational = 0x05,
  kPreOperational = 0x7F
};
[[nodiscard]] std::string_view text(NmtState state);

/// First byte of an NMT command.
enum class NmtCommand : std::uint8_t {
  kStart = 0x01,
  kStop = 0x02,
  kEnterPreOperational = 0x80,
  kResetNode = 0x81,
  kResetCommunication = 0x82,
};

/// COB-IDs of the predefined connection set. @pre 1 <= node <= 127, 1 <= number <= 4.
namespace cob_id {
inline constexpr std::uint32_t kNmt = 0x000;
inline constexpr std::uint32_t kSync = 0x080;
inline constexpr std::uint32_t kTime = 0x100;
[[nodiscard]] constexpr std::uint32_t emcy(std::uint8_t node) {
  return 0x080U + node;
}
[[nodiscard]] constexpr std::uint32_t tpdo(unsigned number, std::uint8_t node) {
  return 0x080U + 0x100U * number + node;
}
[[nodiscard]] constexpr std::uint32_t rpdo(unsigned number, std::uint8_t node) {
  return 0x100U + 0x100U * number + node;
}
[[nodiscard]] constexpr std::uint32_t sdo_response(std::uint8_t node) {
  return 0x580U + node;
}
[[nodiscard]] constexpr std::uint32_t sdo_request(std::uint8_t node) {
  return 0x600U + node;
}
[[nodiscard]] constexpr std::uint32_t heartbeat(std::uint8_t node) {
  return 0x700U + node;
}
/// True for the identifiers that no PDO, SYNC or EMCY may be moved to.
[[nodiscard]] bool is_restricted(std::uint32_t id);
}  // namespace cob_id

/// Copies a number out of wire bytes. @pre at + sizeof(T) <= bytes.size().
template <class T>
requires std::integral<T> || std::floating_point<T>
[[nodiscard]] T load(std::span<const std::uint8_t> bytes, std::size_t at = 0) {
  T value;
  std::memcpy(&value, bytes.data() + at, sizeof value);
  return value;
}

/// Copies a number into wire bytes. @pre at + sizeof(T) <= bytes.size().
template <class T>
requires std::integral<T> || std::floating_point<T>
void store(std::span<std::uint8_t> bytes, std::size_t at, T value) {
  std::memcpy(bytes.data() + at, &value, sizeof value);
}

/// Wire bytes of one number: to_bytes<std::uint32_t>(5) is 05 00 00 00.
template <class T>
requires std::integral<T> || std::floating_point<T>
[[nodiscard]] std::vector<std::uint8_t> to_bytes(T value) {
  std::vector<std::uint8_t> bytes(sizeof value);
  store(std::span{bytes}, 0, value);
  return bytes;
}

}  // namespace meltbench::canopen
