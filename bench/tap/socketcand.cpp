#include "bench/tap/socketcand.hpp"

#include <fmt/format.h>

#include <charconv>
#include <iterator>
#include <type_traits>

namespace meltbench::tap {
namespace {

constexpr std::size_t kMaxMessage = 256;  // The longest that makes sense has 163: 9 negative numbers.
constexpr std::string_view kBlank = " \t\r\n";

/// Takes the first word off `text`; empty if there is none.
std::string_view take_word(std::string_view& text) {
  text.remove_prefix(std::min(text.find_first_not_of(kBlank), text.size()));
  const std::string_view word = text.substr(0, text.find_first_of(kBlank));
  text.remove_prefix(word.size());
  return word;
}

/// Reads a hexadecimal number that fits T, or is a negative one of 32 or 64 bits whose low bits are meant.
template <typename T>
std::optional<T> parse_hex(std::string_view word) {
  std::uint64_t value = 0;
  const char* const end = word.data() + word.size();
  const auto parsed = std::from_chars(word.data(), end, value, 16);
  if (word.empty() || word.front() == '-' || parsed.ptr != end || parsed.ec != std::errc{}) return {};
  const auto low = static_cast<T>(value);
  const auto negative = static_cast<std::int64_t>(static_cast<std::make_signed_t<T>>(low));
  const bool is_sign_extended =
      negative < 0 && (value == static_cast<std::uint64_t>(negative) || value == static_cast<std::uint32_t>(negative));
  if (value != low && !is_sign_extended) return {};
  return low;
}

bool is_send(std::string_view message) {
  return take_word(message) == "send";
}

}  // namespace

std::optional<can::CanFrame> parse_send(std::string_view words) {
  constexpr std::size_t kIdDigits = 8;
  const std::string_view id_word = take_word(words);
  const auto id = parse_hex<std::uint32_t>(id_word);
  const auto length = parse_hex<std::uint8_t>(take_word(words));
  if (!id || !length || *length > can::kMaxClassicLength) return {};
  can::CanFrame frame;
  frame.id = *id & can::kMaxExtendedId;
  frame.extended = id_word.size() >= kIdDigits || frame.id > can::kMaxStandardId;
  frame.length = *length;
  for (std::size_t i = 0; i < frame.length; ++i) {
    const auto byte = parse_hex<std::uint8_t>(take_word(words));
    if (!byte) return {};
    frame.bytes[i] = *byte;
  }
  if (!take_word(words).empty()) return {};
  return frame;
}

std::size_t Socketcand::hear(std::string_view said, std::size_t room, std::string& answers,
                             std::vector<can::CanFrame>& sent) {
  const std::size_t full = sent.size() + room;
  std::size_t used = 0;
  while (true) {
    const std::string_view rest = said.substr(used);
    const std::size_t open = rest.find('<');
    if (open == std::string_view::npos) return said.size();  // Blanks and line ends between messages.
    const std::size_t close = rest.find('>', open);
    if (close == std::string_view::npos) {
      if (rest.size() - open <= kMaxMessage) return used + open;
      answers += "< error message too long >";
      return said.size();
    }
    const std::string_view message = rest.substr(open + 1, close - open - 1);
    if (sent.size() == full && is_send(message)) return used;
    obey(message, answers, sent);
    used += close + 1;
  }
}

void Socketcand::obey(std::string_view message, std::string& answers, std::vector<can::CanFrame>& sent) {
  const std::string_view command = take_word(message);
  const std::string_view line_end = state_ == State::kRaw ? "\n" : "";
  const auto answer = [&](std::string_view text) { answers.append("< ").append(text).append(" >").append(line_end); };
  if (command == "echo") return answer("echo");
  if (command == "open" && !take_word(message).empty()) {
    state_ = State::kOpen;
    return answer("ok");
  }
  if (state_ == State::kNoBus) return answer("error no open bus");
  if (command == "rawmode") {
    state_ = State::kRaw;
    return answer("ok");
  }
  if (command != "send") return answer("error unknown command");
  if (read_only_) return answer("error this tap is read only");
  const auto frame = parse_send(message);
  if (!frame) return answer("error could not parse send command");
  sent.push_back(*frame);
}

void Socketcand::tell(const can::StampedFrame& stamped, std::string& out) {
  const can::CanFrame& frame = stamped.frame;
  if (frame.fd || frame.kind == can::FrameKind::kRemote) return;
  const auto us = stamped.at.since_start.count() / 1'000;
  const auto to = std::back_inserter(out);
  if (frame.kind == can::FrameKind::kError) {
    fmt::format_to(to, "< error {:03X} {}.{:06} >\n", frame.id, us / 1'000'000, us % 1'000'000);
    return;
  }
  fmt::format_to(to, "< frame {:0{}X} {}.{:06} ", frame.id, frame.extended ? 8 : 3, us / 1'000'000, us % 1'000'000);
  for (const std::uint8_t byte : frame.data()) fmt::format_to(to, "{:02X}", byte);
  out += " >\n";
}

}  // namespace meltbench::tap
