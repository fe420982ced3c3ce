#include "bench/cli/pace.hpp"

#include <fmt/format.h>

#include <charconv>
#include <stdexcept>

namespace meltbench::cli {

std::string Pace::text() const {
  if (kind == Kind::kInProcess) return "in-process";
  if (kind == Kind::kLockstep) return "lockstep";
  return speed == 1.0 ? "realtime" : fmt::format("realtime:{}", speed);
}

Pace parse_pace(std::string_view text) {
  if (text == "lockstep") return {Pace::Kind::kLockstep, 1.0};
  if (text == "realtime") return {Pace::Kind::kRealTime, 1.0};
  if (text.starts_with("realtime:")) {
    const std::string_view factor = text.substr(9);
    Pace pace{Pace::Kind::kRealTime, 0.0};
    const auto [end, error] = std::from_chars(factor.data(), factor.data() + factor.size(), pace.speed);
    if (error == std::errc{} && end == factor.data() + factor.size() && pace.speed >= 1e-3 && pace.speed <= 1e3) {
      return pace;
    }
  }
  throw std::invalid_argument{
      fmt::format("pace is lockstep, realtime or realtime:FACTOR with a factor of 0.001..1000, not \"{}\"", text)};
}

}  // namespace meltbench::cli
