#pragma once
/// Words of a line of text, for readers of logs.

#include <string_view>

namespace meltbench::log {

[[nodiscard]] constexpr char to_lower(char letter) {
  return letter >= 'A' && letter <= 'Z' ? static_cast<char>(letter - 'A' + 'a') : letter;
}

/// Whether two words are equal but for upper and lower case.
[[nodiscard]] constexpr bool is_same_word(std::string_view first, std::string_view second) {
  if (first.size() != second.size()) return false;
  for (std::size_t i = 0; i < first.size(); ++i) {
    if (to_lower(first[i]) != to_lower(second[i])) return false;
  }
  return true;
}

/// Takes the next word, between blanks, off the front of `rest`; empty if there is none.
[[nodiscard]] constexpr std::string_view take_word(std::string_view& rest) {
  std::size_t first = 0;
  while (first < rest.size() && (rest[first] == ' ' || rest[first] == '\t')) ++first;
  std::size_t end = first;
  while (end < rest.size() && rest[end] != ' ' && rest[end] != '\t') ++end;
  const std::string_view word = rest.substr(first, end - first);
  rest.remove_prefix(end);
  return word;
}

}  // namespace meltbench::log
