#pragma once
/// What a device puts behind its Modbus addresses.

#include <cstdint>
#include <span>
#include <string_view>

#include "protocols/modbus/types.hpp"

namespace meltbench::modbus {

/// Who the device is, function 43/14: its text objects by number. 0 vendor, 1 product code, 2 revision are mandatory;
/// 3 URL, 4 product name, 5 model name. At most 7; each up to 200 characters.
using Identity = std::span<const std::string_view>;

/// The addresses of one unit, as on the wire (from 0). A server asks covers() before anything else, so the others see
/// addresses that are there, and of a write that is refused by its address nothing is done.
class RegisterMap {
 public:
  virtual ~RegisterMap() = default;

  [[nodiscard]] virtual bool supports(Function function) const = 0;
  /// All of first .. first + count - 1 are there and may be read, or written.
  [[nodiscard]] virtual bool covers(Table table, std::uint16_t first, std::uint16_t count, bool to_write) const = 0;

  /// @param table  kInputRegisters or kHoldingRegisters.
  virtual ExceptionCode read_registers(Instant now, Table table, std::uint16_t first,
                                       std::span<std::uint16_t> values) = 0;
  /// All or nothing: refused, no value has changed.
  virtual ExceptionCode write_registers(Instant now, std::uint16_t first, std::span<const std::uint16_t> values) = 0;
  /// @param table  kCoils or kDiscreteInputs.
  virtual ExceptionCode read_bits(Instant now, Table table, std::uint16_t first, std::span<bool> values) = 0;
  virtual ExceptionCode write_coils(Instant now, std::uint16_t first, std::span<const bool> values) = 0;

  [[nodiscard]] virtual Identity identity() const = 0;
};

}  // namespace meltbench::modbus
