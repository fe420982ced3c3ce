#pragma once
/// A small tree of values in which every value knows where it was written: rig, scenario and variant are merged into
/// one tree, and a complaint about any of it still names the right file, line and column.

#include <cstdint>
#include <memory>
#include <stdexcept>
#include <string>
#include <string_view>
#include <utility>
#include <variant>
#include <vector>

namespace meltbench::config {

/// Where something was written. Cheap to copy: the file name is shared by all values of a file.
struct Origin {
  std::shared_ptr<const std::string> file;  ///< As the user gave it; empty = made by the program.
  std::uint32_t line = 0;                   ///< From 1; 0 = the file as a whole.
  std::uint32_t column = 0;                 ///< From 1, in code points.

  /// "rig.toml:14:15", "rig.toml" without a line, "(built in)" without a file.
  [[nodiscard]] std::string text() const;
};

/// Something in a configuration file is wrong. what() is "file:line:column: message"; hint() says what to change, and
/// may be empty. A program prints "error: " + what(), "hint: " + hint() and exits with status 2.
class ConfigError : public std::runtime_error {
 public:
  ConfigError(const Origin& origin, std::string_view message, std::string hint = {});

  [[nodiscard]] const Origin& origin() const { return origin_; }
  [[nodiscard]] const std::string& hint() const { return hint_; }

 private:
  Origin origin_;
  std::string hint_;
};

struct Value;
struct Entry;
using Array = std::vector<Value>;

/// Keys and values in the order of the file, each key once.
class Table {
 public:
  Origin origin;  ///< Of the header "[name]", or of the first key that implies the table.

  [[nodiscard]] const std::vector<Entry>& entries() const { return entries_; }
  [[nodiscard]] bool empty() const { return entries_.empty(); }

  /// nullptr if there is no such key. Linear: tables are small.
  [[nodiscard]] const Entry* find(std::string_view key) const;
  [[nodiscard]] Value* find_value(std::string_view key);

  /// Replaces the value of the key in place, or adds the key at the end.
  void set(std::string_view key, Value value);
  void set(Entry entry);
  /// Adds without looking for the key. @pre it is not there yet.
  void append(Entry entry);
  void erase(std::string_view key);

  bool operator==(const Table& other) const;  ///< Same keys and values in the same order; origins do not count.

 private:
  std::vector<Entry> entries_;
};

/// One value of TOML, without dates (nothing in a rig or scenario is one).
struct Value {
  using Data = std::variant<bool, std::int64_t, double, std::string, Array, Table>;
  Data data;
  Origin origin;

  /// "a number", "a text", "a table" ...: for messages.
  [[nodiscard]] std::string_view kind() const;

  bool operator==(const Value& other) const;  ///< Origins do not count.
};

/// A key with its value.
struct Entry {
  std::string key;
  Origin key_origin;
  Value value;
};

/// Lays `over` on `base`: tables are merged key by key, anything else is replaced, new keys are added at the end.
/// Arrays are replaced as a whole, arrays of tables too. Every value keeps its origin.
void merge(Table& base, const Table& over);

}  // namespace meltbench::config
