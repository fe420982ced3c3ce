#pragma once

#include <algorithm>
#include <charconv>
#include <string>
#include <string_view>
#include <vector>

namespace meltbench::log {

/// Channel numbers from 1, as Vector's formats have them: a number keeps itself, and a name that ends in one, such as
/// "can0", gets that plus one, unless another has it.
class ChannelNumbers {
 public:
  [[nodiscard]] unsigned of(std::string_view name) {
    for (const auto& [known, number] : numbers_) {
      if (known == name) return number;
    }
    unsigned number = wanted_by(name);
    while (std::ranges::any_of(numbers_, [number](const auto& known) { return known.second == number; })) ++number;
    numbers_.emplace_back(name, number);
    return number;
  }

 private:
  static unsigned wanted_by(std::string_view name) {
    const std::size_t last_letter = name.find_last_not_of("0123456789");
    const std::string_view digits = last_letter == std::string_view::npos ? name : name.substr(last_letter + 1);
    unsigned number = 0;
    if (digits.size() > 3 || digits.empty()) return 1;
    std::from_chars(digits.data(), digits.data() + digits.size(), number);
    return last_letter == std::string_view::npos ? std::max(number, 1U) : number + 1;
  }
  std::vector<std::pair<std::string, unsigned>> numbers_;
};

}  // namespace meltbench::log
