#include "bench/decode/line_trouble.hpp"

#include <algorithm>
#include <cmath>
#include <span>

#include "protocols/modbus/types.hpp"

namespace meltbench::decode {
namespace {

constexpr std::uint64_t kSilentRow = 3;  // So many requests in a row without an answer: nobody is there.
constexpr Nanos kBefore = 2ms;           // A piece that has lost bytes began sooner than its length says.
constexpr Nanos kBehind = 500us;

bool is_frame(const std::vector<std::uint8_t>& bytes) {
  if (bytes.size() < modbus::kMinFrame || bytes.size() > modbus::kMaxFrame) return false;
  const std::size_t body = bytes.size() - 2;
  const unsigned crc = modbus::calc_crc(std::span{bytes}.first(body));
  return bytes[body] == (crc & 0xFFU) && bytes[body + 1] == crc >> 8U;
}

}  // namespace

LineListener::LineListener(const config::Rig& rig) {
  for (const config::RigLine& line : rig.lines) {
    Line& one = lines_.emplace_back();
    one.report.line = line.name;
    one.settings = line.settings;
  }
}

void LineListener::take(Instant at, std::string_view name, std::string_view sender,
                        const std::vector<std::uint8_t>& bytes) {
  const auto found = std::ranges::find_if(lines_, [&](const Line& line) { return line.report.line == name; });
  if (found == lines_.end() || bytes.empty()) return;
  Line& line = *found;
  const Instant sent{at - serial::transmission_time(line.settings, bytes.size())};
  const bool is_well = is_frame(bytes);
  const bool is_request = sender == "controller";
  if (!line.report.troubles.empty() || !is_well) {
    line.bytes_in_frames += bytes.size();
    ++line.frames;
  }
  if (!is_request) {
    end_silence(line, sent);
    line.asked_at.reset();
  } else if (line.asked_at) {
    if (line.unanswered++ == 0) line.unanswered_since = *line.asked_at;
  }
  if (!is_well) {
    ++line.report.garbled;
    add(line, LineTrouble::Kind::kGarbled, Instant{sent - kBefore}, Instant{sent + kBehind});
  }
  if (is_request) {
    line.asked_at.reset();
    if (is_well) line.asked_at = at;
  }
  line.was_well = is_well;
}

void LineListener::end_silence(Line& line, Instant until) {
  if (line.unanswered >= kSilentRow) {
    line.report.silent += line.unanswered;
    add(line, LineTrouble::Kind::kSilent, line.unanswered_since, Instant{until - kBefore});
  }
  line.unanswered = 0;
}

/// Garbled pieces with nothing well between them are one trouble.
void LineListener::add(Line& line, LineTrouble::Kind kind, Instant at, Instant until) {
  std::vector<LineTrouble>& troubles = line.report.troubles;
  line.bytes_at_last = line.bytes_in_frames;
  line.frames_at_last = line.frames;
  if (!line.was_well && !troubles.empty() && troubles.back().kind == kind) {
    troubles.back().until = until;
    return;
  }
  if (troubles.size() < kMostTroubles) {
    troubles.push_back({kind, line.report.line, std::max(at, Instant{}), std::max(until, Instant{})});
  }
}

std::vector<LineReport> LineListener::finish() {
  std::vector<LineReport> reports;
  for (Line& line : lines_) {
    if (line.unanswered >= kSilentRow) end_silence(line, Instant::never());
    LineReport& report = line.report;
    report.garbled_bytes = line.bytes_at_last;
    if (report.garbled > 0) {
      // A frame of n bytes is well with the probability (1 - share)^n.
      const double well = 1.0 - static_cast<double>(report.garbled) / static_cast<double>(line.frames_at_last + 1);
      const double mean_length = static_cast<double>(line.bytes_at_last) / static_cast<double>(line.frames_at_last);
      report.byte_share = std::clamp(1.0 - std::pow(well, 1.0 / mean_length), 1e-6, 1.0);
    }
    reports.push_back(std::move(report));
  }
  return reports;
}

}  // namespace meltbench::decode
