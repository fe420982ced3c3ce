#include "protocols/canopen/types.hpp"

#include <fmt/format.h>

namespace meltbench::canopen {

std::size_t size_of(DataType type) {
  using enum DataType;
  switch (type) {
    case kBoolean:
    case kInteger8:
    case kUnsigned8:
      return 1;
    case kInteger16:
    case kUnsigned16:
      return 2;
    case kInteger24:
    case kUnsigned24:
      return 3;
    case kInteger32:
    case kUnsigned32:
    case kReal32:
      return 4;
    case kInteger40:
    case kUnsigned40:
      return 5;
    case kInteger48:
    case kUnsigned48:
    case kTimeOfDay:
    case kTimeDifference:
      return 6;
    case kInteger56:
    case kUnsigned56:
      return 7;
    case kInteger64:
    case kUnsigned64:
    case kReal64:
      return 8;
    case kVisibleString:
    case kOctetString:
    case kUnicodeString:
    case kDomain:
      return 0;
  }
  return 0;
}

bool is_known(DataType type) {
  return text(type) != "unknown type";
}

bool is_signed(DataType type) {
  using enum DataType;
  switch (type) {
    case kInteger8:
    case kInteger16:
    case kInteger24:
    case kInteger32:
    case kInteger40:
    case kInteger48:
    case kInteger56:
    case kInteger64:
      return true;
    default:
      return false;
  }
}

bool is_real(DataType type) {
  return type == DataType::kReal32 || type == DataType::kReal64;
}

std::string_view text(DataType type) {
  using enum DataType;
  switch (type) {
    case kBoolean:
      return "BOOLEAN";
    case kInteger8:
      return "INTEGER8";
    case kInteger16:
      return "INTEGER16";
    case kInteger24:
      return "INTEGER24";
    case kInteger32:
      return "INTEGER32";
    case kInteger40:
      return "INTEGER40";
    case kInteger48:
      return "INTEGER48";
    case kInteger56:
      return "INTEGER56";
    case kInteger64:
      return "INTEGER64";
    case kUnsigned8:
      return "UNSIGNED8";
    case kUnsigned16:
      return "UNSIGNED16";
    case kUnsigned24:
      return "UNSIGNED24";
    case kUnsigned32:
      return "UNSIGNED32";
    case kUnsigned40:
      return "UNSIGNED40";
    case kUnsigned48:
      return "UNSIGNED48";
    case kUnsigned56:
      return "UNSIGNED56";
    case kUnsigned64:
      return "UNSIGNED64";
    case kReal32:
      return "REAL32";
    case kReal64:
      return "REAL64";
    case kVisibleString:
      return "VISIBLE_STRING";
    case kOctetString:
      return "OCTET_STRING";
    case kUnicodeString:
      return "UNICODE_STRING";
    case kTimeOfDay:
      return "TIME_OF_DAY";
    case kTimeDifference:
      return "TIME_DIFFERENCE";
    case kDomain:
      return "DOMAIN";
  }
  return "unknown type";
}

std::string text(ObjectAddress address) {
  return fmt::format("0x{:04X}:{}", address.index, address.sub);
}

std::string_view text(AbortCode code) {
  using enum AbortCode;
  switch (code) {
    case kNone:
      return "no error";
    case kToggle:
      return "toggle bit not alternated";
    case kTimeout:
      return "SDO protocol timed out";
    case kBadCommand:
      return "command specifier not valid or unknown";
    case kBadBlockSize:
      return "invalid block size";
    case kBadSequence:
      return "invalid sequence number";
    case kBadCrc:
      return "CRC error";
    case kOutOfMemory:
      return "out of memory";
    case kUnsupportedAccess:
      return "unsupported access to an object";
    case kWriteOnly:
      return "attempt to read a write-only object";
    case kReadOnly:
      return "attempt to write a read-only object";
    case kNoObject:
      return "object does not exist";
    case kNotMappable:
      return "object cannot be mapped to the PDO";
    case kPdoLength:
      return "mapped objects exceed the PDO length";
    case kIncompatible:
      return "general parameter incompatibility";
    case kInternalIncompatible:
      return "general internal incompatibility in the device";
    case kHardware:
      return "access failed due to a hardware error";
    case kLengthMismatch:
      return "data type or length does not match";
    case kTooLong:
      return "value is too long";
    case kTooShort:
      return "value is too short";
    case kNoSubIndex:
      return "sub-index does not exist";
    case kInvalidValue:
      return "invalid value";
    case kTooHigh:
      return "value is too high";
    case kTooLow:
      return "value is too low";
    case kMaxBelowMin:
      return "maximum is less than minimum";
    case kNoResource:
      return "resource not available";
    case kGeneral:
      return "general error";
    case kCannotStore:
      return "data cannot be transferred or stored";
    case kLocalControl:
      return "data cannot be stored because of local control";
    case kDeviceState:
      return "data cannot be stored in the present device state";
    case kNoDictionary:
      return "no object dictionary present";
    case kNoData:
      return "no data available";
  }
  return "unknown abort code";
}

std::string_view text(NmtState state) {
  switch (state) {
    case NmtState::kInitialising:
      return "initialising";
    case NmtState::kStopped:
      return "stopped";
    case NmtState::kOperational:
      return "operational";
    case NmtState::kPreOperational:
      return "pre-operational";
  }
  return "unknown state";
}

bool cob_id::is_restricted(std::uint32_t id) {
  constexpr std::array<std::array<std::uint32_t, 2>, 7> kRestricted{
      {{0x000, 0x07F}, {0x101, 0x180}, {0x581, 0x5FF}, {0x601, 0x67F}, {0x6E0, 0x6FF}, {0x701, 0x77F}, {0x780, 0x7FF}}};
  for (const auto& [first, last] : kRestricted) {
    if (id >= first && id <= last) return true;
  }
  return false;
}

}  // namespace meltbench::canopen
