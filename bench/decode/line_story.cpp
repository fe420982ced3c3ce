#include "bench/decode/line_story.hpp"

#include <fmt/format.h>

#include <algorithm>

#include "protocols/modbus/frame_reader.hpp"
#include "protocols/modbus/pdu.hpp"
#include "protocols/modbus/types.hpp"

namespace meltbench::decode {
namespace {

using Bytes = std::span<const std::uint8_t>;

constexpr Nanos kRow = 1s;               // Equal things closer than this are one finding.
constexpr Nanos kLeastSilence = 200ms;   // Longer than masters wait for an answer.
constexpr std::size_t kMaxPolls = 1000;  // Kinds of requests on a line.

bool has_good_checksum(Bytes frame) {
  if (frame.size() < modbus::kMinFrame) return false;
  const Bytes body = frame.first(frame.size() - 2);
  const unsigned crc = modbus::calc_crc(body);
  return frame[body.size()] == (crc & 0xFFU) && frame[body.size() + 1] == crc >> 8U;
}

/// The frame that these bytes begin with; empty if it is none.
Bytes cut_frame(modbus::Direction direction, Bytes bytes) {
  const auto length = modbus::find_length(direction, bytes);
  if (!length || *length > bytes.size() || !has_good_checksum(bytes.first(*length))) return {};
  return bytes.first(*length);
}

Bytes pdu_of(Bytes frame) {
  return frame.subspan(1, frame.size() - 3);
}

/// What is asked for, without the values that are written.
std::string describe_request(Bytes pdu) {
  const auto word = [&](std::size_t at) { return pdu.size() >= at + 2 ? modbus::load_word(pdu, at) : 0; };
  const auto many = [&](std::size_t at, std::string_view what) {
    return fmt::format("{} {}{} from {}", word(at + 2), what, word(at + 2) == 1 ? "" : "s", word(at));
  };
  switch (static_cast<modbus::Function>(pdu[0])) {
    case modbus::Function::kReadCoils:
      return "read " + many(1, "coil");
    case modbus::Function::kReadDiscreteInputs:
      return "read " + many(1, "discrete input");
    case modbus::Function::kReadHoldingRegisters:
      return "read " + many(1, "holding register");
    case modbus::Function::kReadInputRegisters:
      return "read " + many(1, "input register");
    case modbus::Function::kWriteCoil:
      return fmt::format("write coil {}", word(1));
    case modbus::Function::kWriteRegister:
      return fmt::format("write register {}", word(1));
    case modbus::Function::kWriteCoils:
      return "write " + many(1, "coil");
    case modbus::Function::kWriteRegisters:
      return "write " + many(1, "register");
    case modbus::Function::kReadWriteRegisters:
      return fmt::format("write {} and read {}", many(5, "register"), many(1, "register"));
    case modbus::Function::kEncapsulated:
      return "say who it is";
  }
  return fmt::format("do function {}", pdu[0]);
}

/// As much of a request as says what is asked for: equal ones are one poll.
std::size_t calc_key_size(Bytes pdu) {
  switch (static_cast<modbus::Function>(pdu[0])) {
    case modbus::Function::kWriteCoil:
    case modbus::Function::kWriteRegister:
      return std::min<std::size_t>(pdu.size(), 3);
    case modbus::Function::kReadWriteRegisters:
      return std::min<std::size_t>(pdu.size(), 9);
    default:
      return std::min<std::size_t>(pdu.size(), 5);
  }
}

}  // namespace

LineStory::Line& LineStory::find_line(std::string_view name) {
  const auto found = std::ranges::find(lines_, name, &Line::name);
  if (found != lines_.end()) return *found;
  lines_.emplace_back().name = name;
  return lines_.back();
}

/// A device with several units begins at that of the rig.
std::string LineStory::name_of(const Line& line, std::uint8_t unit) const {
  const config::RigBoard* owner = nullptr;
  for (const config::RigBoard& board : rig_.boards) {
    if (board.line != line.name || board.unit > unit) continue;
    if (owner == nullptr || board.unit > owner->unit) owner = &board;
  }
  if (unit == modbus::kBroadcast) return "everybody";
  if (owner == nullptr) return fmt::format("unit {}", unit);
  return owner->unit == unit ? owner->name : fmt::format("{} (unit {})", owner->name, unit);
}

void LineStory::take(Instant at, std::string_view name, Bytes bytes) {
  if (bytes.empty()) return;
  Line& line = find_line(name);
  if (line.last_piece) at = std::max(at, *line.last_piece);  // Time that goes back stands still.
  tell_silence(line, at, at);
  while (!bytes.empty()) bytes = bytes.subspan(take_frame(line, at, bytes));
  line.last_piece = at;
}

/// @returns how many bytes it took.
std::size_t LineStory::take_frame(Line& line, Instant at, Bytes bytes) {
  if (line.asked && bytes[0] == line.asked->unit) {
    const Bytes answer = cut_frame(modbus::Direction::kAnswers, bytes);
    if (!answer.empty() && modbus::fits(line.asked->pdu, pdu_of(answer))) {
      take_answer(line, at, pdu_of(answer));
      return answer.size();
    }
  }
  Bytes request = cut_frame(modbus::Direction::kRequests, bytes);
  // Of a function that we do not speak only silence tells the end, and nothing what its answer is.
  const bool is_foreign = !modbus::find_length(modbus::Direction::kRequests, bytes);
  if (is_foreign && has_good_checksum(bytes)) request = bytes;
  if (request.empty()) {
    take_garbled(line, at, bytes.size());
    return bytes.size();
  }
  take_request(line, at, bytes[0], pdu_of(request), is_foreign);
  return request.size();
}

void LineStory::take_request(Line& line, Instant at, std::uint8_t unit, Bytes pdu, bool is_foreign) {
  if (line.asked) miss_answer(line, at);
  if (unit != modbus::kBroadcast && !is_foreign) line.asked = Request{at, unit, {pdu.begin(), pdu.end()}};
  if (line.last_request) line.pauses[line.requests++ % line.pauses.size()] = at - *line.last_request;
  line.last_request = at;
  std::string key{static_cast<char>(unit)};
  for (const std::uint8_t byte : pdu.first(calc_key_size(pdu))) key += static_cast<char>(byte);
  const auto poll = line.polls.find(key);
  if (poll != line.polls.end()) return repeat(poll->second, at);
  if (line.polls.size() >= kMaxPolls) return;
  line.polls[key] = add({LineFindingKind::kPolls, at, at, 1, line.name,
                         fmt::format("{}: {} is asked to {}", line.name, name_of(line, unit), describe_request(pdu))});
}

void LineStory::take_answer(Line& line, Instant at, Bytes pdu) {
  Unit& unit = line.units[line.asked->unit];
  if (unit.no_answer != kNone && unit.is_missed) findings_[unit.no_answer].until = at;
  unit.is_missed = false;
  const modbus::ExceptionCode code = modbus::exception_of(pdu);
  const auto refusal = static_cast<unsigned>(code);
  if (code == modbus::ExceptionCode::kNone) {
    unit.refused = kNone;
  } else if (unit.refusal == refusal && goes_on(unit.refused, at)) {
    repeat(unit.refused, at);
  } else {
    unit.refusal = refusal;
    unit.refused = add({LineFindingKind::kRefused, at, at, 1, line.name,
                        fmt::format("{}: {} refuses to {}: {}", line.name, name_of(line, line.asked->unit),
                                    describe_request(line.asked->pdu), modbus::text(code))});
  }
  line.asked.reset();
}

void LineStory::take_garbled(Line& line, Instant at, std::size_t bytes) {
  line.asked.reset();  // It may have been the answer.
  if (goes_on(line.garbled, at)) return repeat(line.garbled, at);
  line.garbled = add({LineFindingKind::kGarbled, at, at, 1, line.name,
                      fmt::format("{}: {} byte{} that are no frame: cut short, or a wrong checksum", line.name, bytes,
                                  bytes == 1 ? "" : "s")});
}

/// @param at  of what came in place of the answer, or of the end.
void LineStory::miss_answer(Line& line, Instant at) {
  Unit& unit = line.units[line.asked->unit];
  if (!unit.is_missed && !goes_on(unit.no_answer, line.asked->at)) unit.no_answer = kNone;
  unit.is_missed = true;
  if (unit.no_answer != kNone) {
    repeat(unit.no_answer, at);
  } else {
    unit.no_answer = add({LineFindingKind::kNoAnswer, line.asked->at, at, 1, line.name,
                          fmt::format("{}: {} does not answer", line.name, name_of(line, line.asked->unit))});
  }
  line.asked.reset();
}

void LineStory::tell_silence(Line& line, std::optional<Instant> until, Instant now) {
  if (!line.last_piece || line.requests < line.pauses.size()) return;
  const Nanos usual = std::ranges::max(line.pauses);
  const Nanos pause = now - *line.last_piece;
  if (pause <= kLeastSilence || 2 * pause <= 5 * usual) return;
  add({LineFindingKind::kSilence, *line.last_piece, until, 1, line.name, fmt::format("{}: silence", line.name)});
  line.requests = 0;  // What comes then may have another pace.
  line.last_request.reset();
}

std::size_t LineStory::add(LineFinding finding) {
  if (findings_.size() >= kMaxFindings) {
    ++left_out_;
    return kNone;
  }
  findings_.push_back(std::move(finding));
  return findings_.size() - 1;
}

bool LineStory::goes_on(std::size_t row, Instant at) const {
  return row != kNone && at - *findings_[row].until <= kRow;
}

void LineStory::repeat(std::size_t row, Instant at) {
  if (row == kNone) return;
  ++findings_[row].count;
  findings_[row].until = at;
}

void LineStory::finish(Instant end) {
  for (const Line& line : lines_) {
    if (line.last_piece) end = std::max(end, *line.last_piece);
  }
  for (Line& line : lines_) {
    if (line.asked && end - line.asked->at > kRow) miss_answer(line, end);
    tell_silence(line, std::nullopt, end);
  }
  for (LineFinding& finding : findings_) word(finding, end);
  std::ranges::stable_sort(findings_, {}, &LineFinding::at);
}

void LineStory::word(LineFinding& finding, Instant end) {
  const Instant until = finding.until.value_or(end);
  const double lasted_s = to_s(until - finding.at);
  switch (finding.kind) {
    case LineFindingKind::kPolls:
      if (finding.count > 1) {
        finding.text += fmt::format(", {} times to {:.6f} s, every {:.4g} ms", finding.count, to_s(until),
                                    lasted_s * 1e3 / static_cast<double>(finding.count - 1));
      }
      return;
    case LineFindingKind::kNoAnswer:
      finding.text +=
          fmt::format(" {} request{}, to {:.6f} s", finding.count, finding.count == 1 ? "" : "s", to_s(until));
      return;
    case LineFindingKind::kSilence:
      finding.text += finding.until ? fmt::format(" from here to {:.6f} s, {:.6g} s", to_s(until), lasted_s)
                                    : fmt::format(" from here to the end of the log, {:.6g} s", lasted_s);
      return;
    case LineFindingKind::kRefused:
    case LineFindingKind::kGarbled:
      if (finding.count > 1) finding.text += fmt::format("; {} of them to {:.6f} s", finding.count, to_s(until));
      return;
  }
}

}  // namespace meltbench::decode
