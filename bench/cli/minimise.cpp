#include "bench/cli/minimise.hpp"

#include <algorithm>
#include <cmath>
#include <variant>

namespace meltbench::cli {
namespace {

using config::Table;

constexpr int kShorter = 4;

class Minimiser {
 public:
  Minimiser(std::vector<Table> faults, const std::function<bool(const std::vector<Table>&)>& still_fails)
      : still_fails_{still_fails} {
    result_.faults = std::move(faults);
  }

  Minimised run() {
    if (!result_.faults.empty() && fails({})) {
      result_.dropped = std::move(result_.faults);
      result_.faults.clear();
      return std::move(result_);
    }
    drop_parts();
    for (std::size_t i = 0; i < result_.faults.size(); ++i) shorten(i);
    return std::move(result_);
  }

 private:
  bool fails(const std::vector<Table>& faults) {
    ++result_.runs;
    return still_fails_(faults);
  }

  void drop_parts() {
    std::size_t parts = 2;
    while (result_.faults.size() >= 2) {
      const std::size_t size = result_.faults.size();
      parts = std::min(parts, size);
      bool dropped = false;
      for (std::size_t part = 0; part < parts && !dropped; ++part) {
        dropped = drop(part * size / parts, (part + 1) * size / parts);
      }
      if (dropped) {
        parts = std::max<std::size_t>(parts - 1, 2);
      } else if (parts == size) {
        return;
      } else {
        parts = std::min(2 * parts, size);
      }
    }
  }

  /// Leaves [from, to) out, if it then still fails.
  bool drop(std::size_t from, std::size_t to) {
    const auto at = [](std::size_t index) { return static_cast<std::ptrdiff_t>(index); };
    std::vector<Table> rest = result_.faults;
    rest.erase(rest.begin() + at(from), rest.begin() + at(to));
    if (!fails(rest)) return false;
    result_.dropped.insert(result_.dropped.end(), result_.faults.begin() + at(from), result_.faults.begin() + at(to));
    result_.faults = std::move(rest);
    return true;
  }

  void shorten(std::size_t index) {
    const Table before = result_.faults[index];
    bool is_shorter = false;
    for (int i = 0; i < kShorter; ++i) {
      std::vector<Table> tried = result_.faults;
      config::Value* lasts = tried[index].find_value("for_s");
      auto* seconds = lasts == nullptr ? nullptr : std::get_if<double>(&lasts->data);
      if (seconds == nullptr) return;
      *seconds = std::round(*seconds * 0.5e6) / 1e6;
      if (*seconds <= 0.0 || !fails(tried)) break;
      result_.faults = std::move(tried);
      is_shorter = true;
    }
    if (is_shorter) result_.shortened.push_back(before);
  }

  const std::function<bool(const std::vector<Table>&)>& still_fails_;
  Minimised result_;
};

}  // namespace

Minimised minimise(std::vector<Table> faults, const std::function<bool(const std::vector<Table>&)>& still_fails) {
  return Minimiser{std::move(faults), still_fails}.run();
}

}  // namespace meltbench::cli
