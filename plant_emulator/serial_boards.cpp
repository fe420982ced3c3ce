#include "plant_emulator/serial_boards.hpp"

#include <algorithm>

namespace meltbench::emulator {

void SerialBoards::add_line(std::string name, const serial::LineSettings& settings) {
  const auto timing = modbus::make_line_timing(settings.baud_rate, serial::bits_per_character(settings));
  names_.push_back(std::move(name));
  lines_.push_back({modbus::RtuServer{timing}, {}});
  lines_.back().answers.reserve(2 * modbus::kMaxFrame);
}

board::RtuBoard& SerialBoards::add(std::unique_ptr<board::RtuBoard> board, const std::string& line) {
  const auto at = std::find(names_.begin(), names_.end(), line) - names_.begin();
  board->attach(lines_.at(static_cast<std::size_t>(at)).server);
  boards_.push_back(std::move(board));
  return *boards_.back();
}

void SerialBoards::start(Instant now) {
  for (const auto& board : boards_) board->start(now);
}

void SerialBoards::on_bytes(Instant now, const SerialArrival& arrival) {
  if (arrival.line < lines_.size()) lines_[arrival.line].server.on_bytes(now, arrival.bytes);
}

void SerialBoards::on_time(Instant now) {
  for (const auto& board : boards_) {
    if (board->next_deadline() <= now) board->on_time(now);
  }
  for (Line& line : lines_) {
    if (line.server.next_deadline() <= now) line.server.on_time(now, line.answers);
  }
}

Instant SerialBoards::next_deadline() const {
  Instant next = Instant::never();
  for (const auto& board : boards_) next = std::min(next, board->next_deadline());
  for (const Line& line : lines_) next = std::min(next, line.server.next_deadline());
  return next;
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
