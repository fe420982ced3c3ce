#include "protocols/link/slcan_link.hpp"

#include <fmt/format.h>

#include "protocols/can/hex.hpp"
#include "protocols/link/clock.hpp"

namespace meltbench::link {
namespace {

constexpr Nanos kFlagsPeriod = 1s;
// Lawicel CANUSB manual, command F: bits of the status flags.
constexpr std::uint32_t kReceiveFull = 1U << 0U;
constexpr std::uint32_t kOverrun = 1U << 3U;
constexpr std::uint32_t kBusError = 1U << 7U;

std::string make_opening(std::uint32_t bit_rate_bit_per_s) {
  const auto digit = can::slcan_bit_rate_digit(bit_rate_bit_per_s);
  if (!digit) {
    throw LinkError{fmt::format("slcan has no bit rate of {} bit/s", bit_rate_bit_per_s),
                    "it has 10000, 20000, 50000, 100000, 125000, 250000, 500000, 800000 and 1000000"};
  }
  // The first ends what another program may have left half said.
  return fmt::format("\rC\rS{}\rO\r", *digit);
}

}  // namespace

SlcanLink::SlcanLink(std::string port, std::uint32_t bit_rate_bit_per_s)
    : port_{std::move(port), {kBaudRate, serial::Parity::kNone, 1}}, opening_{make_opening(bit_rate_bit_per_s)} {
  open_channel();
}

SlcanLink::~SlcanLink() {
  if (finish_line()) write("C\r");
}

void SlcanLink::open_channel() noexcept {
  lines_.clear();
  text_.clear();
  taken_ = 0;
  flags_asked_ = false;
  next_flags_ = read_monotonic() + kFlagsPeriod;
  write(opening_);
}

void SlcanLink::write(std::string_view text) noexcept {
  text_ = text;
  taken_ = 0;
  static_cast<void>(finish_line());
}

bool SlcanLink::finish_line() noexcept {
  if (taken_ < text_.size()) {
    const std::string_view rest = std::string_view{text_}.substr(taken_);
    taken_ += port_.write({reinterpret_cast<const std::uint8_t*>(rest.data()), rest.size()});
    if (!port_.is_up()) note_down();
  }
  return taken_ == text_.size();
}

SendStatus SlcanLink::send(const can::CanFrame& frame) noexcept {
  if (!up_) return SendStatus::kDown;
  const bool room = finish_line();
  if (!up_) return SendStatus::kDown;
  if (!room) {
    ++counters_.full;
    return SendStatus::kFull;
  }
  text_.clear();
  taken_ = 0;
  if (!can::append_slcan(text_, frame)) return SendStatus::kUnsupported;
  static_cast<void>(finish_line());
  if (!up_) return SendStatus::kDown;
  if (taken_ > 0) return SendStatus::kSent;  // What is left of the line goes first of all later.
  text_.clear();
  ++counters_.full;
  return SendStatus::kFull;
}

std::optional<ReceivedFrame> SlcanLink::receive() noexcept {
  while (up_) {
    while (const auto line = lines_.next()) {
      if (const auto read = can::parse_slcan(*line)) return ReceivedFrame{received_at_, read->frame};
      take_answer(*line);
    }
    const auto received = port_.receive();
    if (!port_.is_up()) note_down();
    if (!received) break;
    received_at_ = received->at_monotonic;
    lines_.feed(received->bytes);
  }
  if (up_) ask_for_flags();
  return std::nullopt;
}

void SlcanLink::ask_for_flags() noexcept {
  if (!finish_line() || flags_refused_ || read_monotonic() < next_flags_) return;
  next_flags_ = read_monotonic() + kFlagsPeriod;
  flags_asked_ = true;
  write("F\r");
}

void SlcanLink::take_answer(std::string_view line) noexcept {
  if (line.size() == 1 && line.front() == can::kSlcanRefused) {
    if (flags_asked_ && !flags_known_)
      flags_refused_ = true;
    else
      ++counters_.refused;
    return;
  }
  if (line.size() != 3 || line.front() != 'F') return;
  const auto flags = can::parse_hex(line.substr(1));
  if (!flags) return;
  flags_known_ = true;
  if ((*flags & (kReceiveFull | kOverrun)) != 0) ++counters_.dropped;
  if ((*flags & kBusError) != 0) ++counters_.errors;
}

void SlcanLink::note_down() noexcept {
  if (!up_) return;
  up_ = false;
  told_down_ = false;
  ++counters_.downs;
}

bool SlcanLink::is_up() noexcept {
  if (up_) return true;
  // However short it was: whoever asks has lost frames, and is to know.
  if (!told_down_) {
    told_down_ = true;
    return false;
  }
  if (!port_.reopen()) return false;
  up_ = true;
  open_channel();
  return up_;
}

}  // namespace meltbench::link
