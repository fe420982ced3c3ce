#include "controller/machine/feed_tracker.hpp"

#include <catch2/catch.hpp>

using namespace meltbench;
using namespace meltbench::machine;

namespace {

constexpr Nanos kLatency = 2ms, kCycle = 1ms;

Instant at_ms(double ms) {
  return Instant{nanos_from_s(ms * 1e-3)};
}

using Intervals = std::vector<std::pair<double, double>>;  // Until [ms], flow.

Intervals to_list(std::span<const law::FeedInterval> intervals) {
  Intervals list;
  for (const law::FeedInterval& interval : intervals) {
    list.emplace_back(to_s(interval.until) * 1e3, interval.feed_kg_per_s);
  }
  return list;
}

}  // namespace

TEST_CASE("Feed history: the first report only says where it begins", "[machine]") {
  FeedTracker feed{kLatency, kCycle, 16};
  CHECK_FALSE(feed.known_until().has_value());
  CHECK(feed.report({at_ms(10), 1.0, 5ms, 7}).empty());
  CHECK(feed.known_until() == at_ms(10));
  CHECK(feed.flow_kg_per_s() == 1.0);
}

TEST_CASE("Feed history: one change between two reports is dated by the reported age", "[machine]") {
  FeedTracker feed{kLatency, kCycle, 16};
  (void)feed.report({at_ms(10), 1.0, {}, 7});
  feed.command(at_ms(10), 2.5);  // Due at 12.5 ms; the feeder says 12.7 ms, and that it cut it.
  CHECK(to_list(feed.report({at_ms(20), 2.0, 7300us, 8})) == Intervals{{12.7, 1.0}, {20, 2.0}});
}

TEST_CASE("Feed history: without a change the flow went on", "[machine]") {
  FeedTracker feed{kLatency, kCycle, 16};
  (void)feed.report({at_ms(10), 1.0, {}, 7});
  CHECK(to_list(feed.report({at_ms(20), 1.0, {}, 7})) == Intervals{{20, 1.0}});
  CHECK(feed.report({at_ms(20), 1.0, {}, 7}).empty());  // The same again.
}

TEST_CASE("Feed history: changes between lost reports are those of the commands", "[machine]") {
  FeedTracker feed{kLatency, kCycle, 16};
  (void)feed.report({at_ms(10), 1.0, {}, 255});
  feed.command(at_ms(10), 2.0);
  feed.command(at_ms(20), 3.0);
  feed.command(at_ms(30), 4.0);
  // Reports at 20 and 30 ms are lost; the count of changes has wrapped.
  CHECK(to_list(feed.report({at_ms(40), 4.0, 7600us, 2})) ==
        Intervals{{12.5, 1.0}, {22.5, 2.0}, {32.4, 3.0}, {40, 4.0}});
}

TEST_CASE("Feed history: the feeder's own watchdog is in it, whatever was commanded", "[machine]") {
  FeedTracker feed{kLatency, kCycle, 16};
  (void)feed.report({at_ms(10), 3.0, {}, 0});
  CHECK(to_list(feed.report({at_ms(60), 1.0, 4ms, 1})) == Intervals{{56, 3.0}, {60, 1.0}});
}

TEST_CASE("Feed history: commands on their way continue it up to the time of effect", "[machine]") {
  FeedTracker feed{25ms, 0ms, 16};
  (void)feed.report({at_ms(10), 1.0, {}, 0});
  feed.command(at_ms(10), 2.0);
  feed.command(at_ms(20), 3.0);
  CHECK(feed.calc_effect(at_ms(30)) == at_ms(55));
  CHECK(to_list(feed.calc_in_flight(at_ms(55))) == Intervals{{35, 1.0}, {45, 2.0}, {55, 3.0}});
  // The first has taken effect by the next report that comes; the other is still on its way.
  CHECK(to_list(feed.report({at_ms(40), 2.0, 5ms, 1})) == Intervals{{35, 1.0}, {40, 2.0}});
  CHECK(to_list(feed.calc_in_flight(at_ms(55))) == Intervals{{45, 2.0}, {55, 3.0}});
}

TEST_CASE("Feed history: more commands than it can keep push out the oldest", "[machine]") {
  FeedTracker feed{kLatency, 0ms, 2};
  (void)feed.report({at_ms(0), 0.0, {}, 0});
  for (int k = 1; k <= 5; ++k) feed.command(at_ms(10.0 * k), k);
  CHECK(to_list(feed.calc_in_flight(at_ms(60))) == Intervals{{42, 0.0}, {52, 4.0}, {60, 5.0}});
}
