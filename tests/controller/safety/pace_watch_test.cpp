#include "controller/safety/pace_watch.hpp"

#include <catch2/catch.hpp>
#include <optional>

using namespace meltbench;
using safety::PaceWatch;

namespace {

constexpr Nanos kPeriod = 100ms;

/// When it is told, for one device or two of which the second is later by so much; nothing: not in 1000 periods.
std::optional<Instant> find_alarm(Nanos period, std::optional<Nanos> second = {}) {
  PaceWatch watch{kPeriod};
  for (int i = 0; i < 1000; ++i) {
    const Instant at{i * period};
    if (watch.add(at)) return at;
    if (second && watch.add(at + *second)) return at + *second;
  }
  return {};
}

}  // namespace

TEST_CASE("One device's heartbeats are never too many, however wrong its clock is", "[safety]") {
  CHECK_FALSE(find_alarm(kPeriod));
  CHECK_FALSE(find_alarm(70ms));
  CHECK_FALSE(find_alarm(150ms));
}

TEST_CASE("Two devices with one node id are heard within seven periods, in whatever phase they are", "[safety]") {
  for (const Nanos phase : {0ms, 1ms, 25ms, 50ms, 99ms}) {
    const auto alarm = find_alarm(kPeriod, phase);
    INFO(phase / 1ms << " ms");
    REQUIRE(alarm);
    CHECK(*alarm <= Instant{7 * kPeriod});
    CHECK(find_alarm(105ms, phase));  // Both slow by 5 %.
  }
}

TEST_CASE("A jam that lets four heartbeats come at once is no second device", "[safety]") {
  PaceWatch watch{kPeriod};
  CHECK_FALSE(watch.add(Instant{}));
  for (int i = 0; i < 3; ++i) CHECK_FALSE(watch.add(Instant{350ms}));
  for (int i = 4; i < 100; ++i) CHECK_FALSE(watch.add(Instant{i * kPeriod}));
}
