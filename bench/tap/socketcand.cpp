#include "bench/tap/socketcand.hpp"

#include <fmt/format.h>

#include <charconv>
#include <iterator>

namespace meltbench::tap {
namespace {

constexpr std::size_t kMaxMessage = 256;  // The longest that makes sense, "< send 1FFFFFFF 8 FF .. >", has 43.
constexpr std::string_view kBlank = " \t\r\n";

/// Takes the first word off `text`; empty if there is none.
std::string_view take_word(std::string_view& text) {
  text.remove_prefix(std::min(text.find_first_not_of(kBlank), text.size()));
  const std::string_view word = text.substr(0, text.find_first_of(kBlank));
  text.remove_prefix(word.size());
  return word;
}

/// Reads a hexadecimal number of 1 to `max_digits` digits, and nothing else.
std::optional<std::uint32_t> parse_hex(std::string_view word, std::size_t max_digits) {
  std::uint32_t value = 0;
  const char* const end = word.data() + word.size();
  if (word.empty() || word.size() > max_digits || std::from_chars(word.data(), end, value, 16).ptr != end) return {};
  return value;
}

bool is_send(std::string_view message) {
  return take_word(message) == "send";
}

}  // namespace

std::optional<can::CanFrame> parse_send(std::string_view words) {
  constexpr std::size_t kIdDigits = 8;
  const std::string_view id_word = take_word(words);
  const auto id = parse_hex(id_word, kIdDigits);
  const auto length = parse_hex(take_word(words), 1);
  if (!id || !length || *length > can::kMaxClassicLength) return {};
  can::CanFrame frame;
  frame.id = *id & can::kMaxExtendedId;
  frame.extended = id_word.size() == kIdDigits || frame.id > can::kMaxStandardId;
  frame.length = static_cast<std::uint8_t>(*length);
  for (std::size_t i = 0; i < frame.length; ++i) {
    const auto byte = parse_hex(take_word(words), 2);
    if (!byte) return {};
    frame.bytes[i] = static_cast<std::uint8_t>(*byte);
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
