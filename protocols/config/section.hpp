#pragma once
/// Strict, typed reading of a table: every key is asked for by name, type and range, and a key that nobody asked for is
/// an error that names the nearest key that exists.

#include <algorithm>
#include <cstdint>
#include <filesystem>
#include <initializer_list>
#include <limits>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "protocols/config/value.hpp"
#include "protocols/time/instant.hpp"

namespace meltbench::config {

/// Which numbers are allowed, and what to tell who wrote another one. Make it with the functions below.
struct Range {
  double min = -std::numeric_limits<double>::infinity();
  double max = std::numeric_limits<double>::infinity();
  bool min_open = false;  ///< min itself is not allowed.
  bool max_open = false;
  std::string_view hint = {};  ///< E.g. "the heater band's rated power, e.g. max_power_W = 450".

  [[nodiscard]] bool contains(double value) const;  ///< False for NaN and infinities.
  [[nodiscard]] std::string text() const;           ///< "> 0", ">= 0 and < 0.2", "any number".
};

[[nodiscard]] constexpr Range any_number(std::string_view hint = {}) {
  return Range{.hint = hint};
}
[[nodiscard]] constexpr Range above(double min, std::string_view hint = {}) {
  return Range{.min = min, .min_open = true, .hint = hint};
}
[[nodiscard]] constexpr Range at_least(double min, std::string_view hint = {}) {
  return Range{.min = min, .hint = hint};
}
/// min <= value <= max
[[nodiscard]] constexpr Range between(double min, double max, std::string_view hint = {}) {
  return Range{.min = min, .max = max, .hint = hint};
}
/// min < value < max
[[nodiscard]] constexpr Range inside(double min, double max, std::string_view hint = {}) {
  return Range{.min = min, .max = max, .min_open = true, .max_open = true, .hint = hint};
}
/// min < value <= max
[[nodiscard]] constexpr Range above_up_to(double min, double max, std::string_view hint = {}) {
  return Range{.min = min, .max = max, .min_open = true, .hint = hint};
}
/// min <= value < max
[[nodiscard]] constexpr Range from_below(double min, double max, std::string_view hint = {}) {
  return Range{.min = min, .max = max, .max_open = true, .hint = hint};
}

/// One table of a tree, read strictly. A Section is a cheap handle: copies, and sections opened twice under the same
/// name, share the record of what was asked for. It keeps the tree alive.
///
///   Section root{read_toml_file("rig.toml")};
///   const Section plant = root.section("plant");
///   const double x0_m = plant.number_or("x0_m", 0.1, inside(0, L_m));
///   root.finish();                                  // checks root and every section opened below it
///
/// Every reading function throws ConfigError, with the place of the value, on a wrong type or a value out of range;
/// those without "_or" also when the key is missing. Defaults are not checked.
class Section {
 public:
  /// A table without keys: every default, and an error for what must be there.
  Section();

  /// @param path  how messages call it: "" for the root of a file, then "board.feeder".
  explicit Section(std::shared_ptr<const Table> root, std::string path = {});

  // --- numbers: an integer of TOML is accepted; NaN and infinity never are
  [[nodiscard]] double number(std::string_view key, const Range& range = {}) const;
  [[nodiscard]] double number_or(std::string_view key, double fallback, const Range& range = {}) const;
  [[nodiscard]] std::int64_t integer(std::string_view key, const Range& range = {}) const;
  [[nodiscard]] std::int64_t integer_or(std::string_view key, std::int64_t fallback, const Range& range = {}) const;
  [[nodiscard]] std::vector<double> numbers(std::string_view key, const Range& range = {}) const;

  /// A span of time whose unit is the key's suffix: _s, _ms, _us, _ns, _min or _h. Range and fallback are in that unit.
  /// Rounded to the nearest nanosecond; more than 292 years is refused. @pre the key has such a suffix.
  [[nodiscard]] Nanos duration(std::string_view key, const Range& range = at_least(0)) const;
  [[nodiscard]] Nanos duration_or(std::string_view key, double fallback, const Range& range = at_least(0)) const;

  [[nodiscard]] bool boolean(std::string_view key) const;
  [[nodiscard]] bool boolean_or(std::string_view key, bool fallback) const;

  [[nodiscard]] std::string text(std::string_view key) const;
  [[nodiscard]] std::string text_or(std::string_view key, std::string_view fallback) const;
  [[nodiscard]] std::vector<std::string> texts(std::string_view key) const;          ///< Array of texts.
  [[nodiscard]] std::vector<std::string> texts_or_none(std::string_view key) const;  ///< Missing = empty.

  /// A text out of a list.
  [[nodiscard]] std::string choice(std::string_view key, std::initializer_list<std::string_view> allowed) const;
  [[nodiscard]] std::string choice_or(std::string_view key, std::string_view fallback,
                                      std::initializer_list<std::string_view> allowed) const;

  template <typename Enum>
  using Names = std::initializer_list<std::pair<std::string_view, Enum>>;

  /// A text out of a list, as an enum value: choice<Law>("law", {{"open_loop", Law::kOpenLoop}, ...}).
  template <typename Enum>
  [[nodiscard]] Enum choice(std::string_view key, Names<Enum> names) const {
    return std::data(names)[choose(key, names_of(names))].second;
  }
  template <typename Enum>
  [[nodiscard]] Enum choice_or(std::string_view key, Enum fallback, Names<Enum> names) const {
    return has(key) ? choice<Enum>(key, names) : (mark_known(key), fallback);
  }

  /// A file or folder; a relative one is relative to the folder of the file that says it. Need not exist.
  [[nodiscard]] std::filesystem::path path(std::string_view key) const;

  // --- tables
  [[nodiscard]] Section section(std::string_view key) const;                ///< Must be there.
  [[nodiscard]] Section section_or_empty(std::string_view key) const;       ///< Missing = a table without keys.
  [[nodiscard]] std::vector<Section> sections(std::string_view key) const;  ///< [[key]] tables; missing = none.

  /// Like section_or_empty() and sections(), but finish() of this section does not look into them: for the one who
  /// reads a part of what belongs to somebody else. Whoever opens them with section() has them checked.
  [[nodiscard]] Section peek(std::string_view key) const;
  [[nodiscard]] std::vector<Section> peek_all(std::string_view key) const;

  // --- the section itself
  [[nodiscard]] bool has(std::string_view key) const;   ///< Does not count as asking for it.
  [[nodiscard]] std::vector<std::string> keys() const;  ///< In the order of the file.
  [[nodiscard]] const std::string& name() const;        ///< "board.feeder"; "check[2]" for the second [[check]].
  [[nodiscard]] const Table& table() const;
  [[nodiscard]] Origin origin() const;

  /// Says that these keys exist but are somebody else's: they are not unknown, and their inside is not looked at.
  void ignore(std::initializer_list<std::string_view> keys) const;

  /// @throws ConfigError for the first key, in the order of the file, that nobody asked for, here or in a section
  /// opened below. Call it when everything has been read.
  void finish() const;

  /// For a rule that spans keys: "x_m = 0.3, must lie inside the screw". Points at the value of the key (at the section
  /// if there is none), and puts "section.key = value, " in front.
  [[noreturn]] void fail(std::string_view key, std::string_view must, std::string_view hint = {}) const;
  /// The same about the section as a whole: "message" is all it says.
  [[noreturn]] void fail_here(std::string_view message, std::string_view hint = {}) const;

 private:
  struct State;
  explicit Section(std::shared_ptr<State> state);

  template <typename Enum>
  static std::vector<std::string_view> names_of(Names<Enum> names) {
    std::vector<std::string_view> result;
    for (const auto& [name, value] : names) result.push_back(name);
    return result;
  }
  [[nodiscard]] std::size_t choose(std::string_view key, const std::vector<std::string_view>& allowed) const;
  void mark_known(std::string_view key) const;
  [[nodiscard]] const Value* find(std::string_view key) const;
  [[nodiscard]] const Value& require(std::string_view key) const;
  [[nodiscard]] double checked_number(std::string_view key, const Value& value, const Range& range) const;
  [[nodiscard]] std::int64_t checked_integer(std::string_view key, const Value& value, const Range& range) const;
  [[nodiscard]] std::vector<std::string> checked_texts(std::string_view key, const Value& value) const;
  [[noreturn]] void wrong_type(std::string_view key, const Value& value, std::string_view wanted,
                               std::string_view hint = {}) const;
  [[nodiscard]] Section open(std::string_view key, bool required, bool checked) const;
  [[nodiscard]] std::vector<Section> open_all(std::string_view key, bool checked) const;
  [[nodiscard]] std::string full_name(std::string_view key) const;

  std::shared_ptr<State> state_;
};

/// The nearest of `candidates` to `word`, or empty if none is near: a few wrong letters, or the same word with another
/// unit.
[[nodiscard]] std::string_view nearest(std::string_view word, const std::vector<std::string>& candidates);

/// The unit at the end of a key: "s" of "duration_s", "kg_per_h" of "flow_kg_per_h", empty if there is none.
[[nodiscard]] std::string_view unit_of(std::string_view key);

}  // namespace meltbench::config
