#include "bench/record/line_recorder.hpp"

#include <fmt/compile.h>
#include <fmt/format.h>

#include <algorithm>
#include <iterator>

#include "protocols/link/clock.hpp"
#include "protocols/modbus/types.hpp"

namespace meltbench::record {
namespace {

constexpr Nanos kLookPeriod = 100ms;

}  // namespace

void append_serial_line(std::string& text, Instant at, std::string_view line, std::string_view sender,
                        std::span<const std::uint8_t> bytes) {
  const auto us = at.since_start / 1us;
  fmt::format_to(std::back_inserter(text), FMT_COMPILE("({:010}.{:06}) {} {} "), us / 1'000'000, us % 1'000'000, line,
                 sender);
  for (const std::uint8_t byte : bytes) fmt::format_to(std::back_inserter(text), FMT_COMPILE("{:02X}"), byte);
  text += '\n';
}

LineRecorder::LineRecorder(std::vector<HeardLine> lines, LogFiles& files, Nanos epoch_offset)
    : files_{files}, epoch_offset_{epoch_offset} {
  for (HeardLine& heard : lines) {
    const Nanos silence =
        modbus::make_line_timing(heard.settings.baud_rate, serial::bits_per_character(heard.settings)).t3_5;
    lines_.push_back({.heard = std::move(heard), .silence = silence});
    longest_silence_ = std::max(longest_silence_, lines_.back().silence);
  }
}

void LineRecorder::watch(std::vector<pollfd>& watched) const {
  for (const Line& line : lines_) watched.push_back({line.heard.link->fd(), POLLIN, 0});
}

void LineRecorder::take() {
  const Nanos now = link::read_monotonic();
  for (std::size_t number = 0; number < lines_.size(); ++number) take_bytes(number, now);
  write_before(now - longest_silence_);
}

void LineRecorder::take_bytes(std::size_t number, Nanos now) {
  Line& line = lines_[number];
  link::SerialLink& link = *line.heard.link;
  if (!line.is_up) {
    if (now < line.next_look) return;
    line.next_look = now + kLookPeriod;
    if (!link.reopen()) return;
    note_link(line, true, now);
  }
  while (const auto received = link.receive()) add(number, *received);
  if (!line.piece.empty() && now - line.last_byte_at > longest_silence_) end_piece(number);
  if (link.is_up()) return;
  end_piece(number);
  line.next_look = now + kLookPeriod;
  ++result_.downs;
  note_link(line, false, now);
}

/// Bytes that are read at once have come one after the other; the first of them began so much earlier.
void LineRecorder::add(std::size_t number, const link::ReceivedBytes& received) {
  Line& line = lines_[number];
  const Nanos began = received.at_monotonic - serial::transmission_time(line.heard.settings, received.bytes.size());
  if (began - line.last_byte_at > line.silence) end_piece(number);
  for (std::size_t first = 0; first < received.bytes.size();) {
    if (line.piece.size() == kMaxPiece) end_piece(number);
    const std::size_t size = std::min(kMaxPiece - line.piece.size(), received.bytes.size() - first);
    const auto bytes = received.bytes.subspan(first, size);
    line.piece.insert(line.piece.end(), bytes.begin(), bytes.end());
    line.last_byte_at = received.at_monotonic;
    first += size;
  }
}

void LineRecorder::end_piece(std::size_t number) {
  Line& line = lines_[number];
  if (line.piece.empty()) return;
  ++result_.pieces;
  result_.bytes += line.piece.size();
  ended_.push_back({line.last_byte_at, number, std::move(line.piece)});
  line.piece.clear();
}

void LineRecorder::note_link(Line& line, bool is_up, Nanos now) {
  line.is_up = is_up;
  write_before(now);
  at_ = std::max(at_, Instant{now + epoch_offset_});
  files_.append(at_, fmt::format("# {:.6f} s: line {} is {}\n", to_s(at_), line.heard.name, is_up ? "back" : "down"));
}

/// Writes the ended pieces of before in the order of time.
void LineRecorder::write_before(Nanos horizon) {
  std::ranges::stable_sort(ended_, {}, &Ended::at);
  auto piece = ended_.begin();
  for (; piece != ended_.end() && piece->at <= horizon; ++piece) {
    at_ = std::max(at_, Instant{piece->at + epoch_offset_});
    text_.clear();
    append_serial_line(text_, at_, lines_[piece->line].heard.name, kUnknownSpeaker, piece->bytes);
    files_.append(at_, text_);
  }
  ended_.erase(ended_.begin(), piece);
}

void LineRecorder::finish(Nanos stopped_at) {
  for (std::size_t number = 0; number < lines_.size(); ++number) {
    take_bytes(number, stopped_at);
    end_piece(number);
  }
  write_before(Nanos::max());
  files_.flush();
}

}  // namespace meltbench::record
