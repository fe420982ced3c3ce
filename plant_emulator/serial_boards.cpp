#include "plant_emulator/serial_boards.hpp"

#include <algorithm>

namespace meltbench::emulator {

void SerialBoards::add_line(std::string name, const serial::LineSettings& settings) {
  const auto timing = modbus::make_line_timing(settings.baud_rate, serial::bits_per_character(settings));
  names_.push_back(std::move(name));
  lines_.push_back({modbus::RtuServer{timing}, {}});
  lines_.back().answers.reserve(2 * modbus::kMaxFrame);
}

board::RtuBoard& SerialBoards::add(std::unique_ptr<board::RtuBoard> board, config::BoardKind kind,
                                   const std::string& line, ProcessFaults& process) {
  const auto at = std::find(names_.begin(), names_.end(), line) - names_.begin();
  modbus::RtuServer& server = lines_.at(static_cast<std::size_t>(at)).server;
  board->attach(server);
  boards_.push_back(std::move(board));
  gates_.emplace_back(*boards_.back(), kind, process, server);
  return *boards_.back();
}

void SerialBoards::start(Instant now) {
  for (const auto& board : boards_) board->start(now);
}

void SerialBoards::on_bytes(Instant now, const SerialArrival& arrival) {
  if (arrival.line < lines_.size()) lines_[arrival.line].server.on_bytes(now, arrival.bytes);
}

void SerialBoards::on_time(Instant now) {
  for (RtuGate& gate : gates_) {
    if (gate.next_deadline() <= now) gate.on_time(now);
  }
  for (Line& line : lines_) {
    if (line.server.next_deadline() <= now) line.server.on_time(now, line.answers);
  }
}

Instant SerialBoards::next_deadline() const {
  Instant next = Instant::never();
  for (const RtuGate& gate : gates_) next = std::min(next, gate.next_deadline());
  for (const Line& line : lines_) next = std::min(next, line.server.next_deadline());
  return next;
}

void SerialBoards::begin(std::size_t number, const fault::Fault& fault, Instant now) {
  for (RtuGate& gate : gates_) {
    if (fault.target == fault::Target::kBoard && gate.board().name() == fault.object) gate.begin(number, fault, now);
  }
}

void SerialBoards::end(std::size_t number, Instant now) {
  for (RtuGate& gate : gates_) gate.end(number, now);
}

void SerialBoards::forget_dark_events() {
  for (RtuGate& gate : gates_) gate.forget_dark_events();
}

void SerialBoards::on_lines(std::span<const LinkState> lines) {
  for (std::size_t i = 0; i < std::min(lines.size(), lines_.size()); ++i) {
    if (lines[i] == LinkState::kDown) lines_[i].server.reset();
  }
}

void SerialBoards::write_answers(Outbox& out) {
  for (std::size_t i = 0; i < lines_.size(); ++i) {
    if (lines_[i].answers.empty()) continue;
    out.write(static_cast<std::uint8_t>(i), lines_[i].answers);
    lines_[i].answers.clear();
  }
}

}  // namespace meltbench::emulator
