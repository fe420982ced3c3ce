#pragma once
/// Requests as a client makes them, and what their answers hold.

#include <array>
#include <cstddef>
#include <cstdint>
#include <initializer_list>
#include <span>
#include <string_view>
#include <vector>

#include "protocols/modbus/types.hpp"

namespace meltbench::modbus {

/// Function code and data, at most kMaxPdu bytes. A value: no heap.
class Pdu {
 public:
  Pdu() = default;
  Pdu(std::initializer_list<std::uint8_t> bytes);

  void push_byte(std::uint8_t byte);  ///< Ignored when full.
  void push_word(std::uint16_t word);
  void push_bytes(std::span<const std::uint8_t> bytes);

  [[nodiscard]] std::span<const std::uint8_t> bytes() const { return {bytes_.data(), size_}; }
  [[nodiscard]] std::size_t size() const { return size_; }
  void clear() { size_ = 0; }
  std::uint8_t& operator[](std::size_t at) { return bytes_[at]; }

 private:
  std::array<std::uint8_t, kMaxPdu> bytes_{};
  std::size_t size_ = 0;
};

/// @param function  one of the four that read.
[[nodiscard]] Pdu make_read(Function function, std::uint16_t first, std::uint16_t count);
[[nodiscard]] Pdu make_write_coil(std::uint16_t address, bool on);
[[nodiscard]] Pdu make_write_register(std::uint16_t address, std::uint16_t value);
/// @pre 1..kMaxWriteBits values.
[[nodiscard]] Pdu make_write_coils(std::uint16_t first, std::span<const bool> values);
/// @pre 1..kMaxWriteRegisters values.
[[nodiscard]] Pdu make_write_registers(std::uint16_t first, std::span<const std::uint16_t> values);
/// @pre 1..kMaxReadWriteRegisters values.
[[nodiscard]] Pdu make_read_write(std::uint16_t read_first, std::uint16_t read_count, std::uint16_t write_first,
                                  std::span<const std::uint16_t> values);
/// @param code  1 basic, 2 regular, 3 extended objects from `object` on, 4 that one object.
[[nodiscard]] Pdu make_read_identification(std::uint8_t code, std::uint8_t object);

/// True if `answer` can be the answer to `request`: function, counts and echo fit, or it is an exception to it.
[[nodiscard]] bool fits(std::span<const std::uint8_t> request, std::span<const std::uint8_t> answer);

/// kNone for a good answer.
[[nodiscard]] ExceptionCode exception_of(std::span<const std::uint8_t> answer);

/// Registers of an answer to function 3, 4 or 23. @returns false if it does not hold exactly so many.
[[nodiscard]] bool read_registers(std::span<const std::uint8_t> answer, std::span<std::uint16_t> values);
/// Bits of an answer to function 1 or 2. @returns false if its byte count is not that of so many.
[[nodiscard]] bool read_bits(std::span<const std::uint8_t> answer, std::span<bool> values);

/// One object of an answer to function 43/14; empty if it is not among them. The text lives as long as the answer.
[[nodiscard]] std::string_view find_identification(std::span<const std::uint8_t> answer, std::uint8_t object);

/// Appends a frame: unit, PDU, checksum.
void append_frame(std::uint8_t unit, std::span<const std::uint8_t> pdu, std::vector<std::uint8_t>& out);
/// Bytes of such a frame.
[[nodiscard]] constexpr std::size_t frame_size(std::size_t pdu_size) {
  return pdu_size + 3;
}

}  // namespace meltbench::modbus
