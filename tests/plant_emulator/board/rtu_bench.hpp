#pragma once
/// An RTU board on the desk: a process that does what the test says, and a master that speaks in PDUs.

#include <algorithm>
#include <array>
#include <vector>

#include "plant_emulator/board/rtu_board.hpp"
#include "protocols/modbus/pdu.hpp"
#include "tests/plant_emulator/board/board_bench.hpp"

namespace meltbench::board {

/// Serves one board the way the emulator does.
template <class Kind>
class RtuBench {
 public:
  static constexpr std::uint8_t kUnit = 1;

  template <class Settings>
  explicit RtuBench(const Settings& settings, std::uint64_t seed = 1)
      : board{"board", kUnit, settings, Chance{seed, "board"}, process} {
    board.attach(server_);
    board.start(now);
    run_to(now);
  }

  void run_to(Instant to) {
    for (Instant due = next_deadline(); due <= to; due = next_deadline()) {
      advance(std::max(due, now));
      board.on_time(now);
      server_.on_time(now, answer_);
      advance(now);
    }
    advance(to);
    board.settle(now);
  }

  /// Sends a request that ends now, and waits for the answer. @returns its PDU; empty if there was none.
  std::vector<std::uint8_t> ask(const modbus::Pdu& request, std::uint8_t unit = kUnit) {
    std::vector<std::uint8_t> frame;
    modbus::append_frame(unit, request.bytes(), frame);
    answer_.clear();
    server_.on_bytes(now, frame);
    advance(now);
    run_to(now + 10ms);
    if (answer_.size() < modbus::kMinFrame) return {};
    return {answer_.begin() + 1, answer_.end() - 2};
  }
  /// 0 = done, else the exception's code.
  int order(const modbus::Pdu& request, std::uint8_t unit = kUnit) {
    return static_cast<int>(modbus::exception_of(ask(request, unit)));
  }

  int write(std::uint16_t at, float value, modbus::WordOrder order_of_words = modbus::WordOrder::kHighFirst) {
    return order(modbus::make_write_registers(at, modbus::to_words(value, order_of_words)));
  }
  int write(std::uint16_t at, std::uint16_t value) { return order(modbus::make_write_register(at, value)); }
  std::uint16_t read(std::uint16_t at, std::uint8_t unit = kUnit) {
    std::array<std::uint16_t, 1> word{};
    const auto answer = ask(modbus::make_read(modbus::Function::kReadHoldingRegisters, at, 1), unit);
    if (!modbus::read_registers(answer, word)) throw std::runtime_error("read refused");
    return word[0];
  }
  float read_float(std::uint16_t at, modbus::WordOrder order_of_words = modbus::WordOrder::kHighFirst) {
    std::array<std::uint16_t, 2> words{};
    const auto answer = ask(modbus::make_read(modbus::Function::kReadHoldingRegisters, at, 2));
    if (!modbus::read_registers(answer, words)) throw std::runtime_error("read refused");
    return modbus::to_float(words, order_of_words);
  }

  FakeProcess process;
  Kind board;
  Instant now{};

 private:
  [[nodiscard]] Instant next_deadline() const { return std::min(board.next_deadline(), server_.next_deadline()); }
  void advance(Instant to) {
    for (Instant touch = board.next_touch(to); touch <= to; touch = board.next_touch(to)) {
      process.advance_to(touch);
      board.touch(touch);
    }
    process.advance_to(to);
    now = to;
  }

  modbus::RtuServer server_{modbus::make_line_timing(115'200)};
  std::vector<std::uint8_t> answer_;
};

}  // namespace meltbench::board
