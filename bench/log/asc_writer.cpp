#include "bench/log/asc_writer.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <iterator>

#include "protocols/can/frame_bits.hpp"

namespace meltbench::log {
namespace {

constexpr std::size_t kBlock = 64 * 1024;

/// "Thu Jan 01 12:00:00.000 am 1970": the form that all readers know.
std::string to_date(Instant at) {
  constexpr std::array<const char*, 7> kDays{"Sun", "Mon", "Tue", "Wed", "Thu", "Fri", "Sat"};
  constexpr std::array<const char*, 12> kMonths{"Jan", "Feb", "Mar", "Apr", "May", "Jun",
                                                "Jul", "Aug", "Sep", "Oct", "Nov", "Dec"};
  const auto days = std::chrono::floor<std::chrono::days>(at.since_start);
  const std::chrono::sys_days day{days};
  const std::chrono::year_month_day date{day};
  const auto ms = std::chrono::floor<std::chrono::milliseconds>(at.since_start - days).count();
  const auto hour = ms / 3'600'000;
  return fmt::format("{} {} {:02} {:02}:{:02}:{:02}.{:03} {} {}", kDays[std::chrono::weekday{day}.c_encoding()],
                     kMonths[static_cast<unsigned>(date.month()) - 1], static_cast<unsigned>(date.day()),
                     hour % 12 == 0 ? 12 : hour % 12, ms / 60'000 % 60, ms / 1000 % 60, ms % 1000,
                     hour < 12 ? "am" : "pm", static_cast<int>(date.year()));
}

std::string to_id(const can::CanFrame& frame) {
  return fmt::format("{:X}{}", frame.id, frame.extended ? "x" : "");
}

const char* to_word(Direction direction) {
  return direction == Direction::kSent ? "Tx" : "Rx";
}

}  // namespace

void AscWriter::begin(Instant start) {
  begun_ = true;
  // Whole milliseconds: more the date cannot say.
  start_ = Instant{std::chrono::floor<std::chrono::milliseconds>(start.since_start)};
  const std::string date = to_date(start_);
  fmt::format_to(std::back_inserter(text_),
                 "date {}\nbase hex  timestamps absolute\nno internal events logged\nBegin Triggerblock {}\n"
                 "   0.000000 Start of measurement\n",
                 date, date);
}

void AscWriter::write(const LogEntry& entry, std::string_view channel) {
  if (!begun_) begin(entry.at);
  const unsigned number = channels_.of(channel);
  const Nanos since = std::max(entry.at - start_, Nanos{});
  fmt::format_to(std::back_inserter(text_), "{:4}.{:06} ", since / 1s, since % 1s / 1us);
  if (entry.frame.kind == can::FrameKind::kError) {
    fmt::format_to(std::back_inserter(text_), "{}  ErrorFrame", number);
  } else if (entry.frame.fd) {
    append_fd(entry, number);
  } else {
    append_classic(entry, number);
  }
  text_.push_back('\n');
  if (text_.size() < kBlock) return;
  sink_->write(text_);
  text_.clear();
}

void AscWriter::append_classic(const LogEntry& entry, unsigned channel) {
  const can::CanFrame& frame = entry.frame;
  fmt::format_to(std::back_inserter(text_), "{}  {:<15} {:<4} {} {:x}", channel, to_id(frame), to_word(entry.direction),
                 frame.kind == can::FrameKind::kRemote ? 'r' : 'd', can::data_length_code(frame));
  for (const std::uint8_t byte : frame.data()) fmt::format_to(std::back_inserter(text_), " {:02X}", byte);
}

void AscWriter::append_fd(const LogEntry& entry, unsigned channel) {
  const can::CanFrame& frame = entry.frame;
  fmt::format_to(std::back_inserter(text_), "CANFD {:>3} {:<4} {:>8}  {:>32} {} {} {:x} {:>2}", channel,
                 to_word(entry.direction), to_id(frame), "", frame.brs ? 1 : 0, frame.esi ? 1 : 0,
                 can::to_fd_dlc(frame.length), frame.length);
  for (const std::uint8_t byte : frame.data()) fmt::format_to(std::back_inserter(text_), " {:02X}", byte);
  const unsigned flags = 0x1000U | (frame.brs ? 0x2000U : 0U) | (frame.esi ? 0x4000U : 0U);
  fmt::format_to(std::back_inserter(text_), " {:>8} {:>4} {:>8X} {:>8} {:>8} {:>8} {:>8} {:>8}", 0, 0, flags, 0, 0, 0,
                 0, 0);
}

void AscWriter::finish() {
  if (!begun_) begin(Instant{});
  text_ += "End TriggerBlock\n";
  sink_->write(text_);
  sink_->close();
}

}  // namespace meltbench::log
