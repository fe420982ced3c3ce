#pragma once
/// A unit on the desk: ten of everything, and a way to refuse.

#include <array>
#include <vector>

#include "protocols/modbus/pdu.hpp"
#include "protocols/modbus/register_map.hpp"

namespace meltbench::modbus {

/// Bytes of a frame: unit, PDU, checksum.
inline std::vector<std::uint8_t> make_frame(std::uint8_t unit, const Pdu& pdu) {
  std::vector<std::uint8_t> bytes;
  append_frame(unit, pdu.bytes(), bytes);
  return bytes;
}

class SmallMap final : public RegisterMap {
 public:
  static constexpr std::size_t kSize = 10;
  static constexpr std::uint16_t kReadOnly = 9;  ///< Among the holding registers.

  std::array<bool, kSize> coils{}, inputs{};
  std::array<std::uint16_t, kSize> input_registers{}, holding{};
  ExceptionCode refuses = ExceptionCode::kNone;  ///< What execution ends with.
  std::vector<std::string_view> objects{"Desk", "D-10", "1.0"};
  bool knows_all = true;
  int writes = 0;

  [[nodiscard]] bool supports(Function function) const override {
    return knows_all || function == Function::kReadHoldingRegisters;
  }
  [[nodiscard]] bool covers(Table table, std::uint16_t first, std::uint16_t count, bool to_write) const override {
    const bool read_only = to_write && table == Table::kHoldingRegisters && first + count > kReadOnly;
    return first + count <= static_cast<int>(kSize) && !read_only;
  }
  ExceptionCode read_registers(Instant, Table table, std::uint16_t first, std::span<std::uint16_t> values) override {
    const auto& from = table == Table::kInputRegisters ? input_registers : holding;
    std::copy_n(from.begin() + first, values.size(), values.begin());
    return refuses;
  }
  ExceptionCode write_registers(Instant, std::uint16_t first, std::span<const std::uint16_t> values) override {
    if (refuses != ExceptionCode::kNone) return refuses;
    ++writes;
    std::copy(values.begin(), values.end(), holding.begin() + first);
    return ExceptionCode::kNone;
  }
  ExceptionCode read_bits(Instant, Table table, std::uint16_t first, std::span<bool> values) override {
    const auto& from = table == Table::kCoils ? coils : inputs;
    std::copy_n(from.begin() + first, values.size(), values.begin());
    return refuses;
  }
  ExceptionCode write_coils(Instant, std::uint16_t first, std::span<const bool> values) override {
    if (refuses != ExceptionCode::kNone) return refuses;
    ++writes;
    std::copy(values.begin(), values.end(), coils.begin() + first);
    return ExceptionCode::kNone;
  }
  [[nodiscard]] Identity identity() const override { return objects; }
};

}  // namespace meltbench::modbus
