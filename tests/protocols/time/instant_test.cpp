#include "protocols/time/instant.hpp"

#include <catch2/catch.hpp>

using namespace meltbench;

TEST_CASE("Instant: a millisecond count survives the way through seconds for 48 days", "[time]") {
  for (std::int64_t milliseconds = 0; milliseconds < 4'194'304'000; milliseconds += 86'399'999) {
    const Nanos span{milliseconds * 1'000'000};
    REQUIRE(nanos_from_s(to_s(span)) == span);
  }
}

TEST_CASE("Instant: seconds are rounded to the nearest nanosecond on both sides of zero", "[time]") {
  CHECK(nanos_from_s(1.5e-9) == 2ns);
  CHECK(nanos_from_s(-1.5e-9) == -2ns);
  CHECK(nanos_from_s(0.01) == 10ms);
}

TEST_CASE("Instant: never is later than any instant of a run", "[time]") {
  CHECK(Instant{Nanos{std::chrono::hours{24 * 365 * 100}}} < Instant::never());
}
