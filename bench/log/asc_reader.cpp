#include "bench/log/asc_reader.hpp"

#include <fmt/format.h>

#include <array>
#include <charconv>
#include <chrono>
#include <cmath>
#include <optional>

#include "bench/log/log_error.hpp"
#include "bench/log/words.hpp"

namespace meltbench::log {
namespace {

constexpr std::uint32_t kBusError = 0x80;  // linux/can/error.h: CAN_ERR_BUSERROR.
constexpr double kMaxStamp_s = 1e9;        // Thirty years of measuring.

can::CanFrame make_bus_error() {
  can::CanFrame frame;
  frame.kind = can::FrameKind::kError;
  frame.id = kBusError;
  frame.length = can::kMaxClassicLength;
  return frame;
}

std::optional<std::uint32_t> parse_number(std::string_view word, int base) {
  std::uint32_t value = 0;
  const auto end = word.data() + word.size();
  const auto [stop, error] = std::from_chars(word.data(), end, value, base);
  if (word.empty() || stop != end || error != std::errc{}) return std::nullopt;
  return value;
}

std::optional<Nanos> parse_stamp(std::string_view word) {
  double seconds = 0;
  const auto end = word.data() + word.size();
  const auto [stop, error] = std::from_chars(word.data(), end, seconds, std::chars_format::fixed);
  if (word.empty() || stop != end || error != std::errc{} || !(seconds >= 0 && seconds <= kMaxStamp_s)) {
    return std::nullopt;
  }
  return Nanos{std::llround(seconds * 1e9)};
}

std::optional<unsigned> parse_month(std::string_view word) {
  constexpr std::array<std::string_view, 12> kMonths{"jan", "feb", "mar", "apr", "may", "jun",
                                                     "jul", "aug", "sep", "oct", "nov", "dec"};
  for (unsigned month = 0; month < kMonths.size(); ++month) {
    if (is_same_word(word, kMonths[month])) return month + 1;
  }
  return std::nullopt;
}

/// "06:17:32.249" as a time of the day.
std::optional<Nanos> parse_clock(std::string_view word) {
  if (word.size() < 8 || word[2] != ':' || word[5] != ':') return std::nullopt;
  const auto hours = parse_number(word.substr(0, 2), 10);
  const auto minutes = parse_number(word.substr(3, 2), 10);
  const auto seconds = parse_stamp(word.substr(6));
  if (!hours || !minutes || !seconds || *hours > 23 || *minutes > 59 || *seconds >= 61s) return std::nullopt;
  return std::chrono::hours{*hours} + std::chrono::minutes{*minutes} + *seconds;
}

}  // namespace

std::optional<Instant> parse_asc_date(std::string_view text) {
  static_cast<void>(take_word(text));  // The day of the week.
  const auto month = parse_month(take_word(text));
  const auto day = parse_number(take_word(text), 10);
  auto clock = parse_clock(take_word(text));
  std::string_view word = take_word(text);
  if (clock && (is_same_word(word, "am") || is_same_word(word, "pm"))) {
    constexpr std::chrono::hours kHalfDay{12};
    *clock %= kHalfDay;
    if (is_same_word(word, "pm")) *clock += kHalfDay;
    word = take_word(text);
  }
  const auto year = parse_number(word, 10);
  if (!month || !day || !clock || !year || *year < 1970 || *year > 2200) return std::nullopt;
  const std::chrono::year_month_day date{std::chrono::year{static_cast<int>(*year)}, std::chrono::month{*month},
                                         std::chrono::day{*day}};
  if (!date.ok()) return std::nullopt;
  return Instant{std::chrono::sys_days{date}.time_since_epoch() + *clock};
}

bool AscReader::read(LogEntry& entry) {
  std::string_view line;
  while (lines_.next(line)) {
    if (read_header(line)) continue;
    bool is_frame = false;
    try {
      is_frame = read_event(line, entry);
    } catch (const LogError&) {
      if (!lines_.is_torn()) throw;
    }
    if (lines_.is_torn()) warn(std::string{is_frame ? kNoEnd : kCutOff});
    if (is_frame) return true;
  }
  return false;
}

/// @returns true if the line is of the head, a comment, or empty.
bool AscReader::read_header(std::string_view line) {
  std::string_view rest = line;
  const std::string_view word = take_word(rest);
  if (word.empty() || word.starts_with("//") || is_same_word(word, "end")) return true;
  if (is_same_word(word, "base")) {
    base_ = is_same_word(take_word(rest), "dec") ? 10 : 16;
    static_cast<void>(take_word(rest));
    relative_ = is_same_word(take_word(rest), "relative");
    return true;
  }
  const bool is_trigger = is_same_word(word, "begin");  // "Begin Triggerblock <date>": from here on the stamps count.
  if (is_trigger) static_cast<void>(take_word(rest));
  if (is_trigger || is_same_word(word, "date")) {
    const auto start = parse_asc_date(rest);
    if (start) {
      start_ = *start;
    } else {
      warn("the date cannot be read; times count from the start of the measurement");
    }
    return true;
  }
  return false;
}

/// @returns false if the event is no frame.
bool AscReader::read_event(std::string_view line, LogEntry& entry) {
  std::string_view rest = line;
  const auto stamp = parse_stamp(take_word(rest));
  if (!stamp) return false;
  previous_ = relative_ ? previous_ + *stamp : Instant{*stamp};
  entry = LogEntry{};
  entry.at = start_ + previous_.since_start;
  const std::string_view channel = take_word(rest);
  if (is_same_word(channel, "CANFD")) {
    read_fd(rest, entry);
    return true;
  }
  if (!parse_number(channel, 10)) return false;  // "Start of measurement".
  return read_classic(channel, rest, entry);
}

/// @returns false for statistics, chip states and the like.
bool AscReader::read_classic(std::string_view channel, std::string_view rest, LogEntry& entry) {
  const std::string_view id = take_word(rest);
  const std::string_view direction = take_word(rest);
  const bool is_error = is_same_word(id, "ErrorFrame");
  if (!is_error && !is_same_word(direction, "Rx") && !is_same_word(direction, "Tx")) return false;
  set_channel(channel, entry);
  can::CanFrame& frame = entry.frame;
  if (is_error) {
    frame = make_bus_error();
    return true;
  }
  read_id(id, frame);
  entry.direction = is_same_word(direction, "Tx") ? Direction::kSent : Direction::kReceived;
  const std::string_view kind = take_word(rest);
  const bool is_remote = is_same_word(kind, "r");
  if (!is_remote && !is_same_word(kind, "d")) refuse("expected d or r after the direction");
  const std::string_view dlc_word = take_word(rest);
  const auto dlc = parse_number(dlc_word, base_);
  if (is_remote) frame.kind = can::FrameKind::kRemote;
  if (!dlc && is_remote) return true;  // Its length is not always written.
  if (!dlc || *dlc > 15) refuse("the data length code is not 0 to 15");
  frame.length = static_cast<std::uint8_t>(std::min<std::uint32_t>(*dlc, can::kMaxClassicLength));
  if (*dlc > can::kMaxClassicLength) frame.raw_dlc = static_cast<std::uint8_t>(*dlc);
  if (!is_remote) read_data(rest, frame.length, frame);
  return true;
}

void AscReader::read_fd(std::string_view rest, LogEntry& entry) {
  set_channel(take_word(rest), entry);
  entry.direction = is_same_word(take_word(rest), "Tx") ? Direction::kSent : Direction::kReceived;
  can::CanFrame& frame = entry.frame;
  const std::string_view id = take_word(rest);
  if (is_same_word(id, "ErrorFrame")) {
    frame = make_bus_error();
    return;
  }
  read_id(id, frame);
  std::string_view brs = take_word(rest);
  if (brs != "0" && brs != "1") brs = take_word(rest);  // A symbolic name comes first.
  const std::string_view esi = take_word(rest);
  if ((brs != "0" && brs != "1") || (esi != "0" && esi != "1")) refuse("expected 0 or 1 for BRS and ESI");
  const auto dlc = parse_number(take_word(rest), 16);
  const auto length = parse_number(take_word(rest), 10);
  if (!dlc || *dlc > 15 || !length || *length > can::kMaxFdLength) refuse("no data length of an FD frame");
  frame.fd = true;
  frame.brs = brs == "1";
  frame.esi = esi == "1";
  frame.length = static_cast<std::uint8_t>(*length);
  read_data(rest, frame.length, frame);
  if (!can::is_valid(frame)) refuse(fmt::format("an FD frame cannot have {} bytes", *length));
}

void AscReader::read_id(std::string_view word, can::CanFrame& frame) const {
  frame.extended = !word.empty() && to_lower(word.back()) == 'x';
  if (frame.extended) word.remove_suffix(1);
  const auto id = parse_number(word, base_);
  if (!id || *id > (frame.extended ? can::kMaxExtendedId : can::kMaxStandardId)) {
    refuse(fmt::format("\"{}\" is no identifier", word.substr(0, 20)));
  }
  frame.id = *id;
}

void AscReader::read_data(std::string_view rest, std::size_t count, can::CanFrame& frame) const {
  for (std::size_t i = 0; i < count; ++i) {
    const auto byte = parse_number(take_word(rest), base_);
    if (!byte || *byte > 0xFF) refuse(fmt::format("data byte {} of {} is none", i + 1, count));
    frame.bytes[i] = static_cast<std::uint8_t>(*byte);
  }
}

void AscReader::set_channel(std::string_view word, LogEntry& entry) {
  if (!parse_number(word, 10) || word.size() > 4) refuse("the channel is not a number");
  entry.channel = channel_number(word);
}

void AscReader::refuse(std::string_view why) const {
  throw LogError{fmt::format("{}: {}", lines_.place(), why),
                 "a frame is \"0.123456 1 123 Rx d 2 11 22\", as Vector's tools write it"};
}

}  // namespace meltbench::log
