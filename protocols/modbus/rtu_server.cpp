#include "protocols/modbus/rtu_server.hpp"

#include <algorithm>
#include <array>

namespace meltbench::modbus {

namespace {

using Bytes = std::span<const std::uint8_t>;

/// One request on its way through the checks.
class Execution {
 public:
  Execution(Instant now, Bytes request, RegisterMap& map) : now_{now}, request_{request}, map_{map} {}

  ExceptionCode run(Pdu& answer) {
    const auto function = static_cast<Function>(request_[0]);
    if (!map_.supports(function)) return ExceptionCode::kIllegalFunction;
    switch (function) {
      case Function::kReadCoils:
        return read_bits(Table::kCoils, answer);
      case Function::kReadDiscreteInputs:
        return read_bits(Table::kDiscreteInputs, answer);
      case Function::kReadHoldingRegisters:
        return read_registers(Table::kHoldingRegisters, answer);
      case Function::kReadInputRegisters:
        return read_registers(Table::kInputRegisters, answer);
      case Function::kWriteCoil:
        return write_coil(answer);
      case Function::kWriteRegister:
        return write_register(answer);
      case Function::kWriteCoils:
        return write_coils(answer);
      case Function::kWriteRegisters:
        return write_registers(answer);
      case Function::kReadWriteRegisters:
        return read_write(answer);
      case Function::kEncapsulated:
        return identify(answer);
    }
    return ExceptionCode::kIllegalFunction;
  }

 private:
  [[nodiscard]] std::uint16_t word(std::size_t at) const { return load_word(request_, at); }
  [[nodiscard]] std::uint16_t first() const { return word(1); }
  [[nodiscard]] std::uint16_t count() const { return word(3); }
  [[nodiscard]] bool covers(Table table, std::uint16_t from, std::uint16_t many, bool to_write) const {
    constexpr unsigned kAddresses = 0x10000;
    return unsigned{from} + many <= kAddresses && map_.covers(table, from, many, to_write);
  }
  void begin(Pdu& answer) const { answer.push_byte(request_[0]); }
  void echo(Pdu& answer) const { answer.push_bytes(request_.first(5)); }

  ExceptionCode read_bits(Table table, Pdu& answer) {
    if (count() < 1 || count() > kMaxReadBits) return ExceptionCode::kIllegalValue;
    if (!covers(table, first(), count(), false)) return ExceptionCode::kIllegalAddress;
    std::array<bool, kMaxReadBits> values{};
    const std::span<bool> used = std::span{values}.first(count());
    if (const auto refused = map_.read_bits(now_, table, first(), used); refused != ExceptionCode::kNone) {
      return refused;
    }
    begin(answer);
    answer.push_byte(static_cast<std::uint8_t>((used.size() + 7) / 8));
    for (std::size_t i = 0; i < used.size(); i += 8) {
      unsigned byte = 0;
      for (std::size_t bit = 0; bit < 8 && i + bit < used.size(); ++bit) byte |= (used[i + bit] ? 1U : 0U) << bit;
      answer.push_byte(static_cast<std::uint8_t>(byte));
    }
    return ExceptionCode::kNone;
  }

  ExceptionCode read_registers(Table table, Pdu& answer) {
    if (count() < 1 || count() > kMaxReadRegisters) return ExceptionCode::kIllegalValue;
    if (!covers(table, first(), count(), false)) return ExceptionCode::kIllegalAddress;
    return append_registers(table, answer);
  }

  ExceptionCode append_registers(Table table, Pdu& answer) {
    std::array<std::uint16_t, kMaxReadRegisters> values{};
    const std::span<std::uint16_t> used = std::span{values}.first(count());
    if (const auto refused = map_.read_registers(now_, table, first(), used); refused != ExceptionCode::kNone) {
      return refused;
    }
    begin(answer);
    answer.push_byte(static_cast<std::uint8_t>(2 * used.size()));
    for (const std::uint16_t value : used) answer.push_word(value);
    return ExceptionCode::kNone;
  }

  ExceptionCode write_coil(Pdu& answer) {
    constexpr std::uint16_t kOn = 0xFF00;
    if (word(3) != kOn && word(3) != 0) return ExceptionCode::kIllegalValue;
    if (!covers(Table::kCoils, first(), 1, true)) return ExceptionCode::kIllegalAddress;
    const std::array value{word(3) == kOn};
    echo(answer);
    return map_.write_coils(now_, first(), value);
  }

  ExceptionCode write_register(Pdu& answer) {
    if (!covers(Table::kHoldingRegisters, first(), 1, true)) return ExceptionCode::kIllegalAddress;
    const std::array value{word(3)};
    echo(answer);
    return map_.write_registers(now_, first(), value);
  }

  ExceptionCode write_coils(Pdu& answer) {
    const std::size_t bytes = request_.size() - 6;
    const bool fits = request_[5] == bytes && bytes == (count() + 7U) / 8U;
    if (count() < 1 || count() > kMaxWriteBits || !fits) return ExceptionCode::kIllegalValue;
    if (!covers(Table::kCoils, first(), count(), true)) return ExceptionCode::kIllegalAddress;
    std::array<bool, kMaxWriteBits> values{};
    for (std::size_t i = 0; i < count(); ++i) values[i] = (request_[6 + i / 8] >> (i % 8) & 1U) != 0;
    echo(answer);
    return map_.write_coils(now_, first(), std::span{values}.first(count()));
  }

  ExceptionCode write_registers(Pdu& answer) {
    const bool fits = request_[5] == 2 * count() && request_.size() == 6U + 2U * count();
    if (count() < 1 || count() > kMaxWriteRegisters || !fits) return ExceptionCode::kIllegalValue;
    if (!covers(Table::kHoldingRegisters, first(), count(), true)) return ExceptionCode::kIllegalAddress;
    echo(answer);
    return write_words(first(), count(), 6);
  }

  ExceptionCode read_write(Pdu& answer) {
    const std::uint16_t write_first = word(5), write_count = word(7);
    const bool fits = request_[9] == 2 * write_count && request_.size() == 10U + 2U * write_count;
    if (count() < 1 || count() > kMaxReadRegisters || write_count < 1 || write_count > kMaxReadWriteRegisters ||
        !fits) {
      return ExceptionCode::kIllegalValue;
    }
    if (!covers(Table::kHoldingRegisters, first(), count(), false) ||
        !covers(Table::kHoldingRegisters, write_first, write_count, true)) {
      return ExceptionCode::kIllegalAddress;
    }
    if (const auto refused = write_words(write_first, write_count, 10); refused != ExceptionCode::kNone) {
      return refused;
    }
    return append_registers(Table::kHoldingRegisters, answer);
  }

  ExceptionCode write_words(std::uint16_t from, std::uint16_t many, std::size_t at) {
    std::array<std::uint16_t, kMaxWriteRegisters> values{};
    for (std::size_t i = 0; i < many; ++i) values[i] = word(at + 2 * i);
    return map_.write_registers(now_, from, std::span{values}.first(many));
  }

  /// Objects from one on; what does not fit is announced by "more" and the number of the next one.
  ExceptionCode identify(Pdu& answer) const {
    constexpr std::uint8_t kBasic = 1, kSingle = 4;
    constexpr std::uint8_t kRegularStreamAndSingle = 0x82;
    constexpr std::size_t kMoreAt = 4, kNextAt = 5, kCountAt = 6;
    if (request_[1] != kReadIdentification) return ExceptionCode::kIllegalFunction;
    const std::uint8_t code = request_[2];
    if (code < kBasic || code > kSingle) return ExceptionCode::kIllegalValue;
    const Identity objects = map_.identity();
    std::size_t next = request_[3];
    if (code == kSingle && next >= objects.size()) return ExceptionCode::kIllegalAddress;
    constexpr std::size_t kBasicObjects = 3;
    std::size_t end = objects.size();
    if (code == kSingle) end = next + 1;
    if (code == kBasic) end = std::min(kBasicObjects, end);
    if (next >= end) next = 0;  // A stream from an object that is not there begins with the first.
    begin(answer);
    for (const std::uint8_t byte :
         {kReadIdentification, code, kRegularStreamAndSingle, std::uint8_t{0}, std::uint8_t{0}, std::uint8_t{0}}) {
      answer.push_byte(byte);
    }
    for (; next < end; ++next) {
      const std::string_view text = objects[next];
      if (answer.size() + 2 + text.size() > kMaxPdu) {
        answer[kMoreAt] = 0xFF;
        answer[kNextAt] = static_cast<std::uint8_t>(next);
        break;
      }
      answer.push_byte(static_cast<std::uint8_t>(next));
      answer.push_byte(static_cast<std::uint8_t>(text.size()));
      for (const char letter : text) answer.push_byte(static_cast<std::uint8_t>(letter));
      ++answer[kCountAt];
    }
    return ExceptionCode::kNone;
  }

  Instant now_;
  Bytes request_;
  RegisterMap& map_;
};

/// Shortest PDU of a request with this function code.
std::size_t least_size(std::uint8_t function) {
  switch (static_cast<Function>(function)) {
    case Function::kReadCoils:
    case Function::kReadDiscreteInputs:
    case Function::kReadHoldingRegisters:
    case Function::kReadInputRegisters:
    case Function::kWriteCoil:
    case Function::kWriteRegister:
      return 5;
    case Function::kWriteCoils:
    case Function::kWriteRegisters:
      return 6;
    case Function::kReadWriteRegisters:
      return 10;
    case Function::kEncapsulated:
      return 2;  // Only the type of 43/14 makes it longer.
  }
  return 1;
}

bool is_write(std::uint8_t function) {
  switch (static_cast<Function>(function)) {
    case Function::kWriteCoil:
    case Function::kWriteRegister:
    case Function::kWriteCoils:
    case Function::kWriteRegisters:
      return true;
    default:
      return false;
  }
}

}  // namespace

Pdu execute(Instant now, std::span<const std::uint8_t> request, RegisterMap& map) {
  Pdu answer;
  if (request.empty() || request.size() < least_size(request[0])) return answer;
  const bool identifies =
      request[0] == static_cast<std::uint8_t>(Function::kEncapsulated) && request[1] == kReadIdentification;
  if (identifies && request.size() < 4) return answer;
  const ExceptionCode refused = Execution{now, request, map}.run(answer);
  if (refused != ExceptionCode::kNone) {
    answer = {static_cast<std::uint8_t>(request[0] | kExceptionBit), static_cast<std::uint8_t>(refused)};
  }
  return answer;
}

void RtuServer::add(std::uint8_t unit, RegisterMap& map, Nanos answer_delay) {
  units_.push_back({unit, &map, std::max(answer_delay, timing_.t3_5)});
}

RtuServer::Unit* RtuServer::find(std::uint8_t unit) {
  const auto found = std::find_if(units_.begin(), units_.end(), [&](const Unit& each) { return each.unit == unit; });
  return found == units_.end() ? nullptr : &*found;
}

void RtuServer::set_present(std::uint8_t unit, bool present) {
  if (Unit* const found = find(unit)) found->present = present;
  if (!present && answering_ == unit) answer_at_ = Instant::never();
}

void RtuServer::set_extra_delay(std::uint8_t unit, Nanos delay) {
  if (Unit* const found = find(unit)) found->extra_delay = delay;
}

void RtuServer::on_bytes(Instant at, std::span<const std::uint8_t> bytes) {
  while (!bytes.empty()) {
    bytes = bytes.subspan(reader_.take(at, bytes));
    if (const auto frame = reader_.take_frame()) handle(at, *frame);
  }
}

void RtuServer::on_time(Instant now, std::vector<std::uint8_t>& out) {
  reader_.on_time(now);
  if (const auto frame = reader_.take_frame()) handle(now, *frame);
  if (answer_at_ > now) return;
  append_frame(answering_, answer_.bytes(), out);
  answer_at_ = Instant::never();
}

Instant RtuServer::next_deadline() const {
  return std::min(reader_.next_deadline(), answer_at_);
}

void RtuServer::reset() {
  reader_.reset();
  answer_at_ = Instant::never();
}

void RtuServer::handle(Instant now, const Frame& frame) {
  if (frame.unit == kBroadcast) {
    if (!is_write(frame.pdu[0])) return;
    for (const Unit& unit : units_) {
      if (unit.present) static_cast<void>(execute(now, frame.pdu, *unit.map));
    }
    return;
  }
  const Unit* const unit = find(frame.unit);
  if (unit == nullptr || !unit->present) return;
  ++requests_;
  const Pdu answer = execute(now, frame.pdu, *unit->map);
  if (answer.size() == 0) return;
  answer_ = answer;
  if (exception_of(answer_.bytes()) != ExceptionCode::kNone) ++exceptions_;
  answering_ = frame.unit;
  answer_at_ = frame.at + unit->answer_delay + unit->extra_delay;
}

}  // namespace meltbench::modbus
