#include "bench/fault/wire_faults.hpp"

#include <algorithm>
#include <catch2/catch.hpp>
#include <cstdint>
#include <vector>

using namespace meltbench;

namespace {

std::vector<std::uint8_t> strike(fault::Kind kind, double value, std::size_t size, Nanos& later,
                                 std::uint64_t seed = 1) {
  fault::LineFaults faults;
  faults.active.push_back({1, kind, value, seed, 0});
  std::vector<std::uint8_t> bytes(size, 0x55);
  later = faults.strike({}, 0, bytes);
  return bytes;
}

}  // namespace

TEST_CASE("A line garbles, loses, halves, refuses and stalls bytes as it is asked, by chance from the seed",
          "[fault]") {
  Nanos later{};
  const auto noisy = strike(fault::Kind::kNoise, 0.1, 1000, later);
  const auto changed = std::count_if(noisy.begin(), noisy.end(), [](std::uint8_t byte) { return byte != 0x55; });
  CHECK(noisy.size() == 1000);
  CHECK(changed > 50);  // 100 +- 9.5.
  CHECK(changed < 150);
  CHECK(noisy == strike(fault::Kind::kNoise, 0.1, 1000, later));
  CHECK(noisy != strike(fault::Kind::kNoise, 0.1, 1000, later, 2));
  const auto thinned = strike(fault::Kind::kDrop, 0.1, 1000, later).size();
  CHECK(thinned > 850);
  CHECK(thinned < 950);
  CHECK(strike(fault::Kind::kHalfFrame, 1, 9, later).size() == 4);
  CHECK(strike(fault::Kind::kWrongParity, 0, 9, later).empty());
  CHECK(later == 0ns);
  CHECK(strike(fault::Kind::kStall, 20, 9, later).size() == 9);
  CHECK(later == 20ms);
}
