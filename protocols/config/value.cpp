#include "protocols/config/value.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>

namespace meltbench::config {

std::string Origin::text() const {
  if (!file) return "(built in)";
  return line == 0 ? *file : fmt::format("{}:{}:{}", *file, line, column);
}

ConfigError::ConfigError(const Origin& origin, std::string_view message, std::string hint)
    : std::runtime_error{origin.file ? fmt::format("{}: {}", origin.text(), message) : std::string{message}},
      origin_{origin},
      hint_{std::move(hint)} {}

const Entry* Table::find(std::string_view key) const {
  const auto it = std::find_if(entries_.begin(), entries_.end(), [&](const Entry& entry) { return entry.key == key; });
  return it == entries_.end() ? nullptr : &*it;
}

Value* Table::find_value(std::string_view key) {
  const auto it = std::find_if(entries_.begin(), entries_.end(), [&](const Entry& entry) { return entry.key == key; });
  return it == entries_.end() ? nullptr : &it->value;
}

void Table::set(std::string_view key, Value value) {
  const Origin key_origin = value.origin;
  set(Entry{std::string{key}, key_origin, std::move(value)});
}

void Table::set(Entry entry) {
  const auto it =
      std::find_if(entries_.begin(), entries_.end(), [&](const Entry& old) { return old.key == entry.key; });
  if (it == entries_.end()) {
    entries_.push_back(std::move(entry));
  } else {
    *it = std::move(entry);
  }
}

void Table::append(Entry entry) {
  entries_.push_back(std::move(entry));
}

void Table::erase(std::string_view key) {
  entries_.erase(std::remove_if(entries_.begin(), entries_.end(), [&](const Entry& entry) { return entry.key == key; }),
                 entries_.end());
}

bool Table::operator==(const Table& other) const {
  return std::equal(
      entries_.begin(), entries_.end(), other.entries_.begin(), other.entries_.end(),
      [](const Entry& left, const Entry& right) { return left.key == right.key && left.value == right.value; });
}

std::string_view Value::kind() const {
  static constexpr std::array<std::string_view, std::variant_size_v<Data>> kKinds{
      "true or false", "a whole number", "a number", "a text", "an array", "a table"};
  return kKinds[data.index()];
}

bool Value::operator==(const Value& other) const {
  return data == other.data;
}

void merge(Table& base, const Table& over) {
  for (const Entry& entry : over.entries()) {
    Value* below = base.find_value(entry.key);
    auto* table_below = below != nullptr ? std::get_if<Table>(&below->data) : nullptr;
    const auto* table_over = std::get_if<Table>(&entry.value.data);
    if (table_below != nullptr && table_over != nullptr) {
      merge(*table_below, *table_over);
    } else {
      base.set(entry);
    }
  }
}

}  // namespace meltbench::config
