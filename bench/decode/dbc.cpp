#include "bench/decode/dbc.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <bit>
#include <bitset>
#include <charconv>
#include <cmath>

#include "protocols/config/value.hpp"

namespace meltbench::decode {
namespace {

constexpr std::uint32_t kExtendedBit = 0x8000'0000;
constexpr std::uint32_t kOrphans = 0xC000'0000;  // VECTOR__INDEPENDENT_SIG_MSG: signals of no message.
constexpr std::size_t kMaxBits = 8 * can::kMaxFdLength;

std::uint64_t to_key(std::uint32_t id, bool is_extended) {
  return id | (is_extended ? kExtendedBit : 0U);
}

/// Place of a signal's bit, counted from its first, in a frame whose bits are numbered by place: 8 * byte, from the
/// side where the byte order begins. Both orders go on from byte to byte then.
unsigned first_place(const DbcSignal& signal) {
  return signal.is_motorola ? signal.start / 8 * 8 + (7 - signal.start % 8) : signal.start;
}

/// 8 * byte + bit of the n-th bit, from the least significant (Intel) or the most significant (Motorola).
unsigned bit_at(const DbcSignal& signal, unsigned n) {
  const unsigned place = first_place(signal) + n;
  return signal.is_motorola ? place / 8 * 8 + (7 - place % 8) : place;
}

std::uint64_t extract(const DbcSignal& signal, std::span<const std::uint8_t> data) {
  std::uint64_t raw = 0;
  for (unsigned n = 0; n < signal.length; ++n) {
    const unsigned bit = bit_at(signal, signal.is_motorola ? n : signal.length - 1 - n);
    raw = raw << 1U | (static_cast<unsigned>(data[bit / 8]) >> bit % 8 & 1U);
  }
  const bool is_negative = signal.number == DbcNumber::kSigned && (raw >> (signal.length - 1) & 1U) != 0;
  return is_negative && signal.length < 64 ? raw | ~std::uint64_t{0} << signal.length : raw;
}

double to_number(const DbcSignal& signal, std::uint64_t raw) {
  switch (signal.number) {
    case DbcNumber::kUnsigned:
      return static_cast<double>(raw);
    case DbcNumber::kSigned:
      return static_cast<double>(static_cast<std::int64_t>(raw));
    case DbcNumber::kFloat:
      return static_cast<double>(std::bit_cast<float>(static_cast<std::uint32_t>(raw)));
    case DbcNumber::kDouble:
      return std::bit_cast<double>(raw);
  }
  return 0.0;
}

std::string describe_value(const DbcValue& value) {
  const DbcSignal& signal = *value.signal;
  const bool is_plain = signal.factor == 1.0 && signal.offset == 0.0;
  if (is_plain && signal.number == DbcNumber::kUnsigned) return fmt::format("{}", value.raw);
  if (is_plain && signal.number == DbcNumber::kSigned) return fmt::format("{}", static_cast<std::int64_t>(value.raw));
  return fmt::format("{:.15g}", value.value);
}

// --- the text

bool is_utf8(std::string_view text) {
  std::size_t follow = 0;
  for (const char c : text) {
    const auto byte = static_cast<std::uint8_t>(c);
    if (follow > 0) {
      if ((byte & 0xC0U) != 0x80) return false;
      --follow;
    } else if (byte >= 0x80) {
      if (byte < 0xC2 || byte > 0xF4) return false;
      follow = byte >= 0xF0 ? 3 : byte >= 0xE0 ? 2 : 1;
    }
  }
  return follow == 0;
}

std::string to_utf8(std::string_view text) {
  if (is_utf8(text)) return std::string{text};
  std::string utf8;
  for (const char c : text) {
    const auto byte = static_cast<std::uint8_t>(c);
    if (byte >= 0x80) utf8 += static_cast<char>(0xC0U | byte >> 6U);
    utf8 += static_cast<char>(byte >= 0x80 ? 0x80U | (byte & 0x3FU) : byte);
  }
  return utf8;
}

bool is_word_char(char c) {
  return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '_';
}

/// From word to word through the text. Line ends are spaces, but for skip_line().
class Cursor {
 public:
  Cursor(std::string_view text, std::string_view file)
      : text_{text}, file_{std::make_shared<const std::string>(file)} {}

  [[noreturn]] void fail(std::string_view what, std::string hint = {}) const {
    throw config::ConfigError{{file_, line_, 1}, what, std::move(hint)};
  }

  bool at_end() {
    skip_space();
    return rest().empty();
  }

  /// Takes this character if it is next.
  bool take(char wanted) {
    skip_space();
    if (rest().empty() || rest().front() != wanted) return false;
    ++at_;
    return true;
  }

  void expect(char wanted) {
    if (!take(wanted)) fail(fmt::format("expected '{}' {}", wanted, found()), "write it as other DBC editors do");
  }

  /// The next word without taking it; empty if something else is next.
  std::string_view peek_word() {
    skip_space();
    const auto* const end = std::ranges::find_if_not(rest(), is_word_char);
    return rest().substr(0, static_cast<std::size_t>(end - rest().begin()));
  }

  std::string word(std::string_view what) {
    const std::string_view word = peek_word();
    if (word.empty()) fail(fmt::format("expected {} {}", what, found()));
    at_ += word.size();
    return std::string{word};
  }

  template <typename Number>
  Number number(std::string_view what) {
    take('+');
    skip_space();
    Number value{};
    const auto [end, error] = std::from_chars(rest().data(), rest().data() + rest().size(), value);
    if (error != std::errc{}) fail(fmt::format("expected {} {}", what, found()));
    at_ += static_cast<std::size_t>(end - rest().data());
    if constexpr (std::is_floating_point_v<Number>) {
      if (!std::isfinite(value)) fail(fmt::format("{} is not finite", what));
    }
    if (!rest().empty() && (is_word_char(rest().front()) || rest().front() == '.')) {
      fail(fmt::format("expected {} {}", what, found()));
    }
    return value;
  }

  std::string quoted(std::string_view what) {
    if (!take('"')) fail(fmt::format("expected {} in quotes {}", what, found()));
    std::string value;
    for (; !rest().empty() && rest().front() != '"'; step()) {
      if (rest().starts_with("\\\"")) step();
      value += rest().front();
    }
    if (rest().empty()) fail(fmt::format("the quotes of {} have no end", what));
    ++at_;
    return value;
  }

  /// To the line's end; text in quotes may have more lines.
  void skip_line() {
    while (!rest().empty() && rest().front() != '\n') {
      if (rest().front() == '"') {
        quoted("a text");
      } else {
        ++at_;
      }
    }
  }

  [[nodiscard]] std::uint32_t line() const { return line_; }

 private:
  [[nodiscard]] std::string_view rest() const { return text_.substr(at_); }

  void step() {
    if (rest().front() == '\n') ++line_;
    ++at_;
  }

  void skip_space() {
    while (!rest().empty() && std::string_view{" \t\r\n"}.find(rest().front()) != std::string_view::npos) step();
  }

  [[nodiscard]] std::string found() const {
    const std::string_view what = rest().substr(0, std::min<std::size_t>(rest().find_first_of("\r\n"), 20));
    return what.empty() ? "and the line ends" : fmt::format("before \"{}\"", what);
  }

  std::string_view text_;
  std::shared_ptr<const std::string> file_;
  std::size_t at_ = 0;
  std::uint32_t line_ = 1;
};

/// Builds the database keyword by keyword.
class Reader {
 public:
  Reader(std::string_view text, std::string_view file) : in_{text, file} {}

  Dbc read() {
    while (!in_.at_end()) {
      const std::string keyword = in_.word("a keyword");
      if (keyword != "SG_") finish_message();
      if (keyword == "NS_") {
        skip_new_symbols();
      } else if (keyword == "BO_") {
        read_message();
      } else if (keyword == "SG_") {
        read_signal();
      } else if (keyword == "VAL_") {
        read_texts();
      } else if (keyword == "SIG_VALTYPE_") {
        read_value_type();
      } else {
        in_.skip_line();
      }
    }
    finish_message();
    return std::move(dbc_);
  }

 private:
  /// A list of keywords, each on a line, which are not meant as such.
  void skip_new_symbols() {
    in_.expect(':');
    while (!in_.peek_word().empty() && in_.peek_word() != "BS_" && in_.peek_word() != "BU_" &&
           in_.peek_word() != "BO_") {
      in_.word("a symbol");
    }
  }

  std::pair<std::uint32_t, bool> read_id() {
    const auto number = in_.number<std::uint32_t>("an identifier");
    const bool is_extended = (number & kExtendedBit) != 0;
    const std::uint32_t id = number & ~kExtendedBit;
    if (number != kOrphans && id > (is_extended ? can::kMaxExtendedId : can::kMaxStandardId)) {
      in_.fail(fmt::format("identifier {} is too large", number), "29 bits have 2147483648 (bit 31) added to them");
    }
    return {id, is_extended};
  }

  void read_message() {
    const std::uint32_t line = in_.line();
    const auto [id, is_extended] = read_id();
    is_orphans_ = to_key(id, is_extended) == kOrphans;
    DbcMessage message{in_.word("a message's name"), id, is_extended, 0};
    in_.expect(':');
    message.length = in_.number<std::uint32_t>("a length");
    in_.word("a sender");
    if (in_.line() != line) in_.fail(fmt::format("message {} goes over several lines", message.name));
    if (message.length > can::kMaxFdLength) in_.fail(fmt::format("{} has more than 64 bytes", message.name));
    if (!is_orphans_ && dbc_.find(id, is_extended) != nullptr) {
      in_.fail(fmt::format("{} has the identifier of {}", message.name, dbc_.find(id, is_extended)->name),
               "each message needs an identifier of its own");
    }
    message_ = std::move(message);
  }

  void read_signal() {
    if (!message_) in_.fail("SG_ stands outside of a message", "signals follow their BO_");
    const std::uint32_t line = in_.line();
    DbcSignal signal;
    signal.name = in_.word("a signal's name");
    if (in_.peek_word().size() > 0) read_multiplexing(signal, in_.word("a multiplexor"));
    in_.expect(':');
    read_layout(signal);
    in_.expect('[');
    in_.number<double>("a minimum");
    in_.expect('|');
    in_.number<double>("a maximum");
    in_.expect(']');
    signal.unit = in_.quoted("a unit");
    if (in_.line() != line) in_.fail(fmt::format("signal {} goes over several lines", signal.name));
    in_.skip_line();  // Receivers.
    if (!is_orphans_) add_signal(std::move(signal));
  }

  void read_multiplexing(DbcSignal& signal, const std::string& mark) {
    signal.is_selector = mark == "M";
    if (signal.is_selector) return;
    std::uint64_t value = 0;
    const auto [end, error] = std::from_chars(mark.data() + 1, mark.data() + mark.size(), value);
    if (mark.front() != 'm' || error != std::errc{} || end != mark.data() + mark.size()) {
      in_.fail(fmt::format("\"{}\" of signal {} is neither M nor m with a number", mark, signal.name),
               "a multiplexor that is multiplexed itself (m0M) is not understood");
    }
    signal.selected_by = value;
  }

  /// start|length@order sign (factor,offset)
  void read_layout(DbcSignal& signal) {
    signal.start = in_.number<unsigned>("a start bit");
    in_.expect('|');
    signal.length = in_.number<unsigned>("a length");
    in_.expect('@');
    signal.is_motorola = in_.take('0');
    if (!signal.is_motorola) in_.expect('1');
    signal.number = in_.take('-') ? DbcNumber::kSigned : DbcNumber::kUnsigned;
    if (signal.number == DbcNumber::kUnsigned) in_.expect('+');
    in_.expect('(');
    signal.factor = in_.number<double>("a factor");
    in_.expect(',');
    signal.offset = in_.number<double>("an offset");
    in_.expect(')');
  }

  void add_signal(DbcSignal signal) {
    const auto clash = [&](const DbcSignal& other) { return other.name == signal.name; };
    if (std::ranges::any_of(message_->signals, clash)) {
      in_.fail(fmt::format("{} has signal {} twice", message_->name, signal.name));
    }
    const std::size_t bits = 8 * message_->length;
    if (signal.length < 1 || signal.length > 64 || signal.start >= bits || first_place(signal) + signal.length > bits) {
      in_.fail(fmt::format("signal {} ({}|{}) is not within the {} bytes of {}", signal.name, signal.start,
                           signal.length, message_->length, message_->name),
               "a Motorola signal starts at its most significant bit");
    }
    const auto is_second = [](const DbcSignal& other) { return other.is_selector; };
    if (signal.is_selector && std::ranges::any_of(message_->signals, is_second)) {
      in_.fail(fmt::format("{} has two multiplexors", message_->name));
    }
    check_overlap(signal);
    message_->signals.push_back(std::move(signal));
  }

  /// Signals that different values of the multiplexor select are never there together.
  void check_overlap(const DbcSignal& signal) const {
    std::bitset<kMaxBits> own;
    for (unsigned n = 0; n < signal.length; ++n) own.set(bit_at(signal, n));
    for (const DbcSignal& other : message_->signals) {
      if (signal.selected_by && other.selected_by && signal.selected_by != other.selected_by) continue;
      for (unsigned n = 0; n < other.length; ++n) {
        if (own.test(bit_at(other, n))) {
          in_.fail(fmt::format("signals {} and {} of {} overlap", other.name, signal.name, message_->name),
                   "correct the start bit or the length of one of them");
        }
      }
    }
  }

  void finish_message() {
    if (!message_) return;
    const auto& signals = message_->signals;
    const auto selected =
        std::ranges::find_if(signals, [](const DbcSignal& one) { return one.selected_by.has_value(); });
    if (selected != signals.end() && std::ranges::none_of(signals, &DbcSignal::is_selector)) {
      in_.fail(
          fmt::format("signal {} of {} is multiplexed, but there is no multiplexor", selected->name, message_->name),
          "mark one signal with M");
    }
    if (!is_orphans_) dbc_.add(std::move(*message_));
    message_.reset();
  }

  /// The signal that "ID NAME" means; nothing of signals of no message.
  DbcSignal* read_reference() {
    const auto [id, is_extended] = read_id();
    const std::string name = in_.word("a signal's name");
    if (to_key(id, is_extended) == kOrphans) return nullptr;
    DbcMessage* const message = dbc_.find(id, is_extended);
    if (message == nullptr) in_.fail(fmt::format("there is no message {} before this", to_key(id, is_extended)));
    const auto found = std::ranges::find(message->signals, name, &DbcSignal::name);
    if (found == message->signals.end()) in_.fail(fmt::format("{} has no signal {}", message->name, name));
    return &*found;
  }

  void read_texts() {
    const std::string_view first = in_.peek_word();
    if (first.empty() || first.front() < '0' || first.front() > '9') return in_.skip_line();  // Environment variable.
    DbcSignal* const signal = read_reference();
    while (!in_.take(';')) {
      const auto value = in_.number<std::int64_t>("a value or ';'");
      std::string text = in_.quoted("the value's text");
      if (signal != nullptr && !signal->texts.emplace(value, std::move(text)).second) {
        in_.fail(fmt::format("value {} of signal {} has two texts", value, signal->name));
      }
    }
  }

  void read_value_type() {
    DbcSignal* const signal = read_reference();
    in_.take(':');
    const auto type = in_.number<unsigned>("a value type");
    in_.expect(';');
    if (type > 2) in_.fail(fmt::format("value type {} is unknown", type), "0 is integer, 1 float, 2 double");
    if (signal == nullptr || type == 0) return;
    const unsigned length = type == 1 ? 32 : 64;
    if (signal->length != length) in_.fail(fmt::format("signal {} needs {} bits for this type", signal->name, length));
    signal->number = type == 1 ? DbcNumber::kFloat : DbcNumber::kDouble;
  }

  Cursor in_;
  Dbc dbc_;
  std::optional<DbcMessage> message_;
  bool is_orphans_ = false;
};

}  // namespace

bool Dbc::add(DbcMessage message) {
  const std::uint64_t key = to_key(message.id, message.is_extended);
  return messages_.emplace(key, std::move(message)).second;
}

const DbcMessage* Dbc::find(const can::CanFrame& frame) const {
  if (frame.kind != can::FrameKind::kData) return nullptr;
  const auto found = messages_.find(to_key(frame.id, frame.extended));
  return found == messages_.end() ? nullptr : &found->second;
}

DbcMessage* Dbc::find(std::uint32_t id, bool is_extended) {
  const auto found = messages_.find(to_key(id, is_extended));
  return found == messages_.end() ? nullptr : &found->second;
}

Dbc read_dbc(std::string_view text, std::string_view file_name) {
  const std::string utf8 = to_utf8(text);
  return Reader{utf8, file_name}.read();
}

std::vector<DbcValue> decode_message(const DbcMessage& message, std::span<const std::uint8_t> data) {
  const auto is_there = [&](const DbcSignal& signal) { return first_place(signal) + signal.length <= 8 * data.size(); };
  const auto selector = std::ranges::find_if(message.signals, &DbcSignal::is_selector);
  std::optional<std::uint64_t> selected;
  if (selector != message.signals.end() && is_there(*selector)) selected = extract(*selector, data);
  std::vector<DbcValue> values;
  for (const DbcSignal& signal : message.signals) {
    if (!is_there(signal) || (signal.selected_by && signal.selected_by != selected)) continue;
    const std::uint64_t raw = extract(signal, data);
    values.push_back({&signal, raw, to_number(signal, raw) * signal.factor + signal.offset});
  }
  return values;
}

std::string describe_message(const DbcMessage& message, std::span<const std::uint8_t> data) {
  std::string line = message.name + ":";
  const char* between = " ";
  for (const DbcValue& value : decode_message(message, data)) {
    const DbcSignal& signal = *value.signal;
    line += fmt::format("{}{}={}", between, signal.name, describe_value(value));
    if (!signal.unit.empty()) line += " " + signal.unit;
    const auto text = signal.texts.find(static_cast<std::int64_t>(value.raw));
    if (text != signal.texts.end()) line += fmt::format(" ({})", text->second);
    between = ", ";
  }
  return line;
}

}  // namespace meltbench::decode
