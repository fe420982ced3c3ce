#include "protocols/modbus/pdu.hpp"

#include <algorithm>

namespace meltbench::modbus {

namespace {

constexpr std::uint16_t kCoilOn = 0xFF00;

void push_function(Pdu& pdu, Function function) {
  pdu.push_byte(static_cast<std::uint8_t>(function));
}

void push_registers(Pdu& pdu, std::span<const std::uint16_t> values) {
  pdu.push_byte(static_cast<std::uint8_t>(2 * values.size()));
  for (const std::uint16_t value : values) pdu.push_word(value);
}

constexpr std::size_t bytes_of_bits(std::size_t bits) {
  return (bits + 7) / 8;
}

/// Walks the objects of an answer to function 43/14. @returns false if they do not end where it ends.
template <class Visit>
bool visit_objects(std::span<const std::uint8_t> answer, Visit visit) {
  constexpr std::size_t kCountAt = 6;
  if (answer.size() <= kCountAt || answer[1] != kReadIdentification) return false;
  std::size_t at = kCountAt + 1;
  for (unsigned i = 0; i < answer[kCountAt]; ++i) {
    if (at + 2 > answer.size() || at + 2U + answer[at + 1] > answer.size()) return false;
    visit(answer[at], answer.subspan(at + 2, answer[at + 1]));
    at += 2U + answer[at + 1];
  }
  return at == answer.size();
}

/// The answer repeats so many bytes of the request.
bool echoes(std::span<const std::uint8_t> request, std::span<const std::uint8_t> answer, std::size_t size) {
  return request.size() >= size && answer.size() == size && std::equal(answer.begin(), answer.end(), request.begin());
}

}  // namespace

Pdu::Pdu(std::initializer_list<std::uint8_t> bytes) {
  for (const std::uint8_t byte : bytes) push_byte(byte);
}

void Pdu::push_byte(std::uint8_t byte) {
  if (size_ < bytes_.size()) bytes_[size_++] = byte;
}

void Pdu::push_word(std::uint16_t word) {
  push_byte(static_cast<std::uint8_t>(word >> 8U));
  push_byte(static_cast<std::uint8_t>(word & 0xFFU));
}

void Pdu::push_bytes(std::span<const std::uint8_t> bytes) {
  for (const std::uint8_t byte : bytes) push_byte(byte);
}

Pdu make_read(Function function, std::uint16_t first, std::uint16_t count) {
  Pdu pdu;
  push_function(pdu, function);
  pdu.push_word(first);
  pdu.push_word(count);
  return pdu;
}

Pdu make_write_coil(std::uint16_t address, bool on) {
  return make_read(Function::kWriteCoil, address, on ? kCoilOn : 0);
}

Pdu make_write_register(std::uint16_t address, std::uint16_t value) {
  return make_read(Function::kWriteRegister, address, value);
}

Pdu make_write_coils(std::uint16_t first, std::span<const bool> values) {
  Pdu pdu = make_read(Function::kWriteCoils, first, static_cast<std::uint16_t>(values.size()));
  pdu.push_byte(static_cast<std::uint8_t>(bytes_of_bits(values.size())));
  for (std::size_t i = 0; i < values.size(); i += 8) {
    unsigned byte = 0;
    for (std::size_t bit = 0; bit < 8 && i + bit < values.size(); ++bit) byte |= (values[i + bit] ? 1U : 0U) << bit;
    pdu.push_byte(static_cast<std::uint8_t>(byte));
  }
  return pdu;
}

Pdu make_write_registers(std::uint16_t first, std::span<const std::uint16_t> values) {
  Pdu pdu = make_read(Function::kWriteRegisters, first, static_cast<std::uint16_t>(values.size()));
  push_registers(pdu, values);
  return pdu;
}

Pdu make_read_write(std::uint16_t read_first, std::uint16_t read_count, std::uint16_t write_first,
                    std::span<const std::uint16_t> values) {
  Pdu pdu = make_read(Function::kReadWriteRegisters, read_first, read_count);
  pdu.push_word(write_first);
  pdu.push_word(static_cast<std::uint16_t>(values.size()));
  push_registers(pdu, values);
  return pdu;
}

Pdu make_read_identification(std::uint8_t code, std::uint8_t object) {
  return {static_cast<std::uint8_t>(Function::kEncapsulated), kReadIdentification, code, object};
}

bool fits(std::span<const std::uint8_t> request, std::span<const std::uint8_t> answer) {
  if (request.empty() || answer.size() < 2) return false;
  if (answer[0] == (request[0] | kExceptionBit)) return answer.size() == 2 && answer[1] != 0;
  if (answer[0] != request[0]) return false;
  const auto has_bytes = [&](std::size_t count) { return answer[1] == count && answer.size() == count + 2; };
  switch (static_cast<Function>(request[0])) {
    case Function::kReadCoils:
    case Function::kReadDiscreteInputs:
      return has_bytes(bytes_of_bits(load_word(request, 3)));
    case Function::kReadHoldingRegisters:
    case Function::kReadInputRegisters:
    case Function::kReadWriteRegisters:
      return has_bytes(2U * load_word(request, 3));
    case Function::kWriteCoil:
    case Function::kWriteRegister:
    case Function::kWriteCoils:
    case Function::kWriteRegisters:
      return echoes(request, answer, 5);
    case Function::kEncapsulated:
      return answer.size() > 6 && answer[2] == request[2] && visit_objects(answer, [](std::uint8_t, const auto&) {});
  }
  return false;
}

ExceptionCode exception_of(std::span<const std::uint8_t> answer) {
  if (answer.size() < 2 || (answer[0] & kExceptionBit) == 0) return ExceptionCode::kNone;
  return static_cast<ExceptionCode>(answer[1]);
}

bool read_registers(std::span<const std::uint8_t> answer, std::span<std::uint16_t> values) {
  if (answer.size() != 2 + 2 * values.size() || answer[1] != 2 * values.size()) return false;
  for (std::size_t i = 0; i < values.size(); ++i) values[i] = load_word(answer, 2 + 2 * i);
  return true;
}

bool read_bits(std::span<const std::uint8_t> answer, std::span<bool> values) {
  const std::size_t count = bytes_of_bits(values.size());
  if (answer.size() != 2 + count || answer[1] != count) return false;
  for (std::size_t i = 0; i < values.size(); ++i) values[i] = (answer[2 + i / 8] >> (i % 8) & 1U) != 0;
  return true;
}

std::string_view find_identification(std::span<const std::uint8_t> answer, std::uint8_t object) {
  std::string_view found;
  visit_objects(answer, [&](std::uint8_t id, std::span<const std::uint8_t> value) {
    if (id == object) found = {reinterpret_cast<const char*>(value.data()), value.size()};
  });
  return found;
}

void append_frame(std::uint8_t unit, std::span<const std::uint8_t> pdu, std::vector<std::uint8_t>& out) {
  const std::size_t begin = out.size();
  out.push_back(unit);
  out.insert(out.end(), pdu.begin(), pdu.end());
  const std::uint16_t crc = calc_crc(std::span{out}.subspan(begin));
  out.push_back(static_cast<std::uint8_t>(crc & 0xFFU));
  out.push_back(static_cast<std::uint8_t>(crc >> 8U));
}

}  // namespace meltbench::modbus
