#include "bench/cli/minimise.hpp"

#include <algorithm>
#include <catch2/catch.hpp>

using namespace meltbench;
using namespace meltbench::cli;

namespace {

config::Table numbered(std::int64_t number, double for_s = 1.0) {
  config::Table fault;
  fault.set("number", config::Value{number, {}});
  fault.set("for_s", config::Value{for_s, {}});
  return fault;
}

std::vector<std::int64_t> numbers(const std::vector<config::Table>& faults) {
  std::vector<std::int64_t> list;
  for (const config::Table& fault : faults) list.push_back(std::get<std::int64_t>(fault.find("number")->value.data));
  return list;
}

bool has(const std::vector<config::Table>& faults, std::int64_t number) {
  return std::ranges::count(numbers(faults), number) > 0;
}

double lasts(const config::Table& fault) {
  return std::get<double>(fault.find("for_s")->value.data);
}

}  // namespace

TEST_CASE("of many faults those stay that fail together only", "[extract]") {
  std::vector<config::Table> faults;
  for (std::int64_t i = 0; i < 20; ++i) faults.push_back(numbered(i));
  const Minimised least = minimise(faults, [](const auto& tried) {
    const bool long_enough = std::ranges::all_of(tried, [](const auto& fault) { return lasts(fault) == 1.0; });
    return long_enough && has(tried, 3) && has(tried, 17);
  });
  CHECK(numbers(least.faults) == std::vector<std::int64_t>{3, 17});
  CHECK(least.dropped.size() == 18);
  CHECK(least.shortened.empty());
  CHECK(least.runs < 100);
}

TEST_CASE("a failure that needs no fault is left with none", "[extract]") {
  const Minimised least = minimise({numbered(1), numbered(2)}, [](const auto&) { return true; });
  CHECK(least.faults.empty());
  CHECK(least.dropped.size() == 2);
}

TEST_CASE("a fault lasts half as long, as often as it still fails", "[extract]") {
  const Minimised least =
      minimise({numbered(1, 8.0)}, [](const auto& tried) { return !tried.empty() && lasts(tried.front()) >= 2.0; });
  REQUIRE(least.faults.size() == 1);
  CHECK(lasts(least.faults.front()) == 2.0);
  REQUIRE(least.shortened.size() == 1);
  CHECK(lasts(least.shortened.front()) == 8.0);
}
