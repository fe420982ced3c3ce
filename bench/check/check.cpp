#include "bench/check/check.hpp"

#include <algorithm>

namespace meltbench::check {

bool CheckResults::held() const {
  return failed_count() == 0;
}

std::size_t CheckResults::failed_count() const {
  return static_cast<std::size_t>(
      std::count_if(checks.begin(), checks.end(), [](const CheckResult& check) { return !check.held; }));
}

}  // namespace meltbench::check
