// Which word was meant: distance between keys, and keys that differ only in their unit.

#include <algorithm>
#include <array>
#include <numeric>

#include "protocols/config/section.hpp"

namespace meltbench::config {
namespace {

constexpr std::size_t kMaxWord = 64;  // Longer words are compared with nothing: the cost is the product of the lengths.

constexpr std::array<std::string_view, 39> kUnits{
    "s",  "ms",  "us",  "ns",  "min", "h",    "Hz",   "kHz", "m",       "mm",  "um",  "m2",   "m3",
    "Pa", "kPa", "MPa", "bar", "K",   "degC", "kg",   "g",   "rad",     "rev", "rpm", "deg",  "W",
    "kW", "J",   "kJ",  "N",   "V",   "A",    "kbit", "bit", "percent", "ppm", "mK",  "mbar", "per",
};

bool is_unit(std::string_view word) {
  return std::find(kUnits.begin(), kUnits.end(), word) != kUnits.end();
}

std::string_view stem_of(std::string_view key) {
  const std::string_view unit = unit_of(key);
  return unit.empty() ? key : key.substr(0, key.size() - unit.size() - 1);
}

/// Letters added, dropped, replaced, or swapped with their neighbour (optimal string alignment).
std::size_t edit_distance(std::string_view a, std::string_view b) {
  using Row = std::array<std::size_t, kMaxWord + 1>;
  Row before{};
  Row above{};
  Row row{};
  std::iota(row.begin(), row.end(), std::size_t{0});
  for (std::size_t i = 1; i <= a.size(); ++i) {
    before = above;
    above = row;
    row[0] = i;
    for (std::size_t j = 1; j <= b.size(); ++j) {
      row[j] = std::min({above[j - 1] + (a[i - 1] == b[j - 1] ? 0U : 1U), above[j] + 1, row[j - 1] + 1});
      const bool swapped = i > 1 && j > 1 && a[i - 1] == b[j - 2] && a[i - 2] == b[j - 1];
      if (swapped) row[j] = std::min(row[j], before[j - 2] + 1);
    }
  }
  return row[b.size()];
}

}  // namespace

std::string_view unit_of(std::string_view key) {
  std::size_t start = key.size();
  while (start > 0) {
    const std::size_t underscore = key.rfind('_', start - 1);
    if (underscore == std::string_view::npos || underscore == 0) break;
    if (!is_unit(key.substr(underscore + 1, start - underscore - 1))) break;
    start = underscore;
  }
  std::string_view unit = start == key.size() ? std::string_view{} : key.substr(start + 1);
  if (unit.starts_with("per_")) return {};
  return unit;
}

std::string_view nearest(std::string_view word, const std::vector<std::string>& candidates) {
  if (word.empty() || word.size() > kMaxWord) return {};
  for (const std::string& candidate : candidates) {
    if (candidate != word && stem_of(candidate) == stem_of(word)) return candidate;
  }
  std::string_view best;
  std::size_t best_distance = 1 + std::max<std::size_t>(1, word.size() / 3);
  for (const std::string& candidate : candidates) {
    if (candidate.size() > kMaxWord || candidate == word) continue;
    const std::size_t distance = edit_distance(word, candidate);
    if (distance < best_distance) {
      best = candidate;
      best_distance = distance;
    }
  }
  return best;
}

}  // namespace meltbench::config
