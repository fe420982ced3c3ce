#include "protocols/config/section.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <cmath>

#include "protocols/config/toml.hpp"

namespace meltbench::config {
namespace {

std::string or_hint(std::string_view hint, std::string otherwise) {
  return hint.empty() ? otherwise : std::string{hint};
}

/// "in s" for a key with a unit: the least that a hint can say.
std::string unit_hint(std::string_view key) {
  const std::string_view unit = unit_of(key);
  return unit.empty() ? std::string{} : fmt::format("{} is in {}", key, unit);
}

/// A value as messages show it: long ones are cut.
std::string shown(const Value& value) {
  constexpr std::size_t kMaxShown = 60;
  std::string text = write_toml(value);
  if (text.size() <= kMaxShown) return text;
  std::size_t end = kMaxShown;
  while (end > 0 && (static_cast<unsigned char>(text[end]) & 0xC0U) == 0x80U) --end;  // Not inside a UTF-8 letter.
  return text.substr(0, end) + "...";
}

}  // namespace

bool Range::contains(double value) const {
  if (!std::isfinite(value)) return false;
  return (min_open ? value > min : value >= min) && (max_open ? value < max : value <= max);
}

std::string Range::text() const {
  const bool has_min = std::isfinite(min);
  const bool has_max = std::isfinite(max);
  if (!has_min && !has_max) return "a finite number";
  const std::string lower = has_min ? fmt::format("{} {}", min_open ? ">" : ">=", min) : std::string{};
  const std::string upper = has_max ? fmt::format("{} {}", max_open ? "<" : "<=", max) : std::string{};
  return lower + (has_min && has_max ? " and " : "") + upper;
}

struct Section::State {
  std::shared_ptr<const Table> table;  ///< Points into the tree and owns all of it.
  std::string path;
  Origin origin;
  bool checked = true;  ///< finish() of the section above looks in here.
  std::vector<std::string> known;
  struct Child {
    std::string key;
    std::vector<std::shared_ptr<State>> items;  ///< One for a table, any number for [[key]].
  };
  std::vector<Child> children;

  [[nodiscard]] bool knows(std::string_view key) const {
    return std::find(known.begin(), known.end(), key) != known.end();
  }
  [[nodiscard]] Child* child(std::string_view key) {
    const auto it = std::find_if(children.begin(), children.end(), [&](const Child& each) { return each.key == key; });
    return it == children.end() ? nullptr : &*it;
  }
  [[nodiscard]] std::string full_name(std::string_view key) const {
    return path.empty() ? std::string{key} : fmt::format("{}.{}", path, key);
  }
  [[noreturn]] void refuse_unknown(const Entry& entry) const;
  void finish();
};

void Section::State::refuse_unknown(const Entry& entry) const {
  const std::string_view near = nearest(entry.key, known);
  const std::string name = full_name(entry.key);
  if (near.empty()) {
    throw ConfigError{
        entry.key_origin, fmt::format("{}: unknown key", name),
        known.empty() ? "nothing is read from this table" : fmt::format("keys here: {}", fmt::join(known, ", "))};
  }
  const std::string_view unit = unit_of(entry.key);
  const std::string_view near_unit = unit_of(near);
  const bool same_stem = entry.key.substr(0, entry.key.size() - (unit.empty() ? 0 : unit.size() + 1)) ==
                         near.substr(0, near.size() - (near_unit.empty() ? 0 : near_unit.size() + 1));
  if (same_stem && !near_unit.empty()) {
    throw ConfigError{entry.key_origin,
                      fmt::format("{}: {}, this key is {}", name, unit.empty() ? "unit missing" : "wrong unit", near),
                      unit.empty() ? fmt::format("rename it to {}: the value is in {}", near, near_unit)
                                   : fmt::format("rename it to {} and convert the value to {}", near, near_unit)};
  }
  throw ConfigError{entry.key_origin, fmt::format("{}: unknown key", name), fmt::format("did you mean {}?", near)};
}

void Section::State::finish() {
  for (const Entry& entry : table->entries()) {
    if (!knows(entry.key)) refuse_unknown(entry);
    const Child* opened = child(entry.key);
    if (opened == nullptr) continue;
    for (const auto& item : opened->items) {
      if (item->checked) item->finish();
    }
  }
}

Section::Section(std::shared_ptr<const Table> root, std::string path) : state_{std::make_shared<State>()} {
  state_->origin = root->origin;
  state_->table = std::move(root);
  state_->path = std::move(path);
}

Section::Section() : Section{std::make_shared<const Table>()} {}

Section::Section(std::shared_ptr<State> state) : state_{std::move(state)} {}

// --- looking up

void Section::mark_known(std::string_view key) const {
  if (!state_->knows(key)) state_->known.emplace_back(key);
}

const Value* Section::find(std::string_view key) const {
  mark_known(key);
  const Entry* entry = state_->table->find(key);
  return entry == nullptr ? nullptr : &entry->value;
}

const Value& Section::require(std::string_view key) const {
  if (const Value* value = find(key)) return *value;
  // A misspelt key is what is most often behind a missing one: point at it, not at the table.
  for (const Entry& entry : state_->table->entries()) {
    if (!state_->knows(entry.key) && nearest(entry.key, state_->known) == key) state_->refuse_unknown(entry);
  }
  throw ConfigError{state_->origin, fmt::format("{} is missing", full_name(key)),
                    state_->path.empty() ? fmt::format("write a table [{}] or a key {} = ...", key, key)
                                         : fmt::format("write {} = ... under [{}]", key, state_->path)};
}

std::string Section::full_name(std::string_view key) const {
  return state_->full_name(key);
}

void Section::wrong_type(std::string_view key, const Value& value, std::string_view wanted,
                         std::string_view hint) const {
  throw ConfigError{value.origin,
                    fmt::format("{} = {}, must be {}, not {}", full_name(key), shown(value), wanted, value.kind()),
                    or_hint(hint, unit_hint(key))};
}

// --- numbers

double Section::checked_number(std::string_view key, const Value& value, const Range& range) const {
  double number = 0;
  if (const auto* whole = std::get_if<std::int64_t>(&value.data)) {
    number = static_cast<double>(*whole);
  } else if (const auto* real = std::get_if<double>(&value.data)) {
    number = *real;
  } else {
    wrong_type(key, value, "a number",
               std::holds_alternative<std::string>(value.data) ? "write it without quotes" : range.hint);
  }
  if (!range.contains(number)) {
    throw ConfigError{value.origin, fmt::format("{} = {}, must be {}", full_name(key), shown(value), range.text()),
                      or_hint(range.hint, unit_hint(key))};
  }
  return number;
}

std::int64_t Section::checked_integer(std::string_view key, const Value& value, const Range& range) const {
  const auto* whole = std::get_if<std::int64_t>(&value.data);
  if (whole == nullptr) wrong_type(key, value, "a whole number", range.hint);
  (void)checked_number(key, value, range);
  return *whole;
}

double Section::number(std::string_view key, const Range& range) const {
  return checked_number(key, require(key), range);
}

double Section::number_or(std::string_view key, double fallback, const Range& range) const {
  const Value* value = find(key);
  return value == nullptr ? fallback : checked_number(key, *value, range);
}

std::int64_t Section::integer(std::string_view key, const Range& range) const {
  return checked_integer(key, require(key), range);
}

std::int64_t Section::integer_or(std::string_view key, std::int64_t fallback, const Range& range) const {
  const Value* value = find(key);
  return value == nullptr ? fallback : checked_integer(key, *value, range);
}

std::vector<double> Section::numbers(std::string_view key, const Range& range) const {
  const Value& value = require(key);
  const auto* items = std::get_if<Array>(&value.data);
  if (items == nullptr) wrong_type(key, value, "an array of numbers", "write it as [1.0, 2.0]");
  std::vector<double> result;
  result.reserve(items->size());
  for (const Value& item : *items) result.push_back(checked_number(key, item, range));
  return result;
}

namespace {

/// Nanoseconds in one unit of the key's suffix; 0 if the suffix is not a time.
double nanos_per_unit(std::string_view key) {
  const std::string_view unit = unit_of(key);
  if (unit == "ns") return 1;
  if (unit == "us") return 1e3;
  if (unit == "ms") return 1e6;
  if (unit == "s") return 1e9;
  if (unit == "min") return 60e9;
  if (unit == "h") return 3600e9;
  return 0;
}

}  // namespace

Nanos Section::duration(std::string_view key, const Range& range) const {
  const double nanos = number(key, range) * nanos_per_unit(key);
  constexpr double kMaxNanos = 9.2e18;  // 292 years, the end of Nanos.
  if (!(std::abs(nanos) < kMaxNanos)) fail(key, "must be less than 292 years");
  return Nanos{std::llround(nanos)};
}

Nanos Section::duration_or(std::string_view key, double fallback, const Range& range) const {
  if (has(key)) return duration(key, range);
  mark_known(key);
  return Nanos{std::llround(fallback * nanos_per_unit(key))};
}

// --- texts and truth

bool Section::boolean(std::string_view key) const {
  const Value& value = require(key);
  const auto* flag = std::get_if<bool>(&value.data);
  if (flag == nullptr) wrong_type(key, value, "true or false", "write it without quotes");
  return *flag;
}

bool Section::boolean_or(std::string_view key, bool fallback) const {
  return find(key) == nullptr ? fallback : boolean(key);
}

std::string Section::text(std::string_view key) const {
  const Value& value = require(key);
  const auto* text = std::get_if<std::string>(&value.data);
  if (text == nullptr) wrong_type(key, value, "a text", "write it in quotes");
  return *text;
}

std::string Section::text_or(std::string_view key, std::string_view fallback) const {
  return find(key) == nullptr ? std::string{fallback} : text(key);
}

std::vector<std::string> Section::checked_texts(std::string_view key, const Value& value) const {
  const auto* items = std::get_if<Array>(&value.data);
  if (items == nullptr) wrong_type(key, value, "an array of texts", "write it as [\"a\", \"b\"]");
  std::vector<std::string> result;
  result.reserve(items->size());
  for (const Value& item : *items) {
    const auto* text = std::get_if<std::string>(&item.data);
    if (text == nullptr) wrong_type(key, item, "an array of texts", "write it as [\"a\", \"b\"]");
    result.push_back(*text);
  }
  return result;
}

std::vector<std::string> Section::texts(std::string_view key) const {
  return checked_texts(key, require(key));
}

std::vector<std::string> Section::texts_or_none(std::string_view key) const {
  const Value* value = find(key);
  return value == nullptr ? std::vector<std::string>{} : checked_texts(key, *value);
}

std::size_t Section::choose(std::string_view key, const std::vector<std::string_view>& allowed) const {
  const std::string value = text(key);
  const auto it = std::find(allowed.begin(), allowed.end(), value);
  if (it != allowed.end()) return static_cast<std::size_t>(it - allowed.begin());
  const std::vector<std::string> candidates(allowed.begin(), allowed.end());
  const std::string_view near = nearest(value, candidates);
  fail(key, fmt::format("must be one of {}", fmt::join(allowed, ", ")),
       near.empty() ? fmt::format("for example {} = \"{}\"", key, allowed.front())
                    : fmt::format("did you mean \"{}\"?", near));
}

std::string Section::choice(std::string_view key, std::initializer_list<std::string_view> allowed) const {
  return std::string{std::data(allowed)[choose(key, allowed)]};
}

std::string Section::choice_or(std::string_view key, std::string_view fallback,
                               std::initializer_list<std::string_view> allowed) const {
  return find(key) == nullptr ? std::string{fallback} : choice(key, allowed);
}

std::filesystem::path Section::path(std::string_view key) const {
  const Value& value = require(key);
  const std::string said = text(key);
  if (said.empty()) fail(key, "must name a file");
  const std::filesystem::path folder =
      value.origin.file ? std::filesystem::path{*value.origin.file}.parent_path() : std::filesystem::path{};
  return (folder / said).lexically_normal();
}

// --- tables

Section Section::open(std::string_view key, bool required, bool checked) const {
  const Value* value = required ? &require(key) : find(key);
  const Table* table = value == nullptr ? nullptr : std::get_if<Table>(&value->data);
  if (value != nullptr && table == nullptr) {
    wrong_type(key, *value, "a table", fmt::format("write it as [{}]", full_name(key)));
  }
  if (State::Child* opened = state_->child(key)) {
    opened->items.front()->checked |= checked;
    return Section{opened->items.front()};
  }
  auto state = std::make_shared<State>();
  state->table =
      table != nullptr ? std::shared_ptr<const Table>{state_->table, table} : std::make_shared<const Table>();
  state->path = full_name(key);
  state->origin = table != nullptr ? value->origin : state_->origin;
  state->checked = checked;
  state_->children.push_back({std::string{key}, {state}});
  return Section{state};
}

std::vector<Section> Section::open_all(std::string_view key, bool checked) const {
  const Value* value = find(key);
  if (value == nullptr) return {};
  const std::string hint = fmt::format("write each as [[{}]]", full_name(key));
  const auto* items = std::get_if<Array>(&value->data);
  if (items == nullptr) wrong_type(key, *value, "a list of tables", hint);
  State::Child* opened = state_->child(key);
  if (opened == nullptr) {
    State::Child child{std::string{key}, {}};
    for (const Value& item : *items) {
      const auto* table = std::get_if<Table>(&item.data);
      if (table == nullptr) wrong_type(key, item, "a list of tables", hint);
      auto state = std::make_shared<State>();
      state->table = std::shared_ptr<const Table>{state_->table, table};
      state->path = fmt::format("{}[{}]", full_name(key), child.items.size() + 1);
      state->origin = item.origin;
      state->checked = false;
      child.items.push_back(std::move(state));
    }
    opened = &state_->children.emplace_back(std::move(child));
  }
  std::vector<Section> result;
  for (const auto& item : opened->items) {
    item->checked |= checked;
    result.push_back(Section{item});
  }
  return result;
}

Section Section::section(std::string_view key) const {
  return open(key, true, true);
}
Section Section::section_or_empty(std::string_view key) const {
  return open(key, false, true);
}
Section Section::peek(std::string_view key) const {
  return open(key, false, false);
}
std::vector<Section> Section::sections(std::string_view key) const {
  return open_all(key, true);
}
std::vector<Section> Section::peek_all(std::string_view key) const {
  return open_all(key, false);
}

// --- the section itself

bool Section::has(std::string_view key) const {
  return state_->table->find(key) != nullptr;
}

std::vector<std::string> Section::keys() const {
  std::vector<std::string> result;
  for (const Entry& entry : state_->table->entries()) result.push_back(entry.key);
  return result;
}

const std::string& Section::name() const {
  return state_->path;
}
const Table& Section::table() const {
  return *state_->table;
}
Origin Section::origin() const {
  return state_->origin;
}

void Section::ignore(std::initializer_list<std::string_view> keys) const {
  for (const std::string_view key : keys) mark_known(key);
}

void Section::finish() const {
  state_->finish();
}

void Section::fail(std::string_view key, std::string_view must, std::string_view hint) const {
  const Entry* entry = state_->table->find(key);
  if (entry == nullptr) fail_here(fmt::format("{}: {}", full_name(key), must), hint);
  throw ConfigError{entry->value.origin, fmt::format("{} = {}, {}", full_name(key), shown(entry->value), must),
                    or_hint(hint, unit_hint(key))};
}

void Section::fail_here(std::string_view message, std::string_view hint) const {
  throw ConfigError{state_->origin, message, std::string{hint}};
}

}  // namespace meltbench::config
