#include "protocols/time/log_histogram.hpp"

#include <catch2/catch.hpp>
#include <random>
#include <vector>

using namespace meltbench;

TEST_CASE("Log histogram: bucket edges rise without a gap, and a span lies between those of its bucket", "[time]") {
  for (std::size_t bucket = 0; bucket < LogHistogram::kBuckets; ++bucket) {
    REQUIRE(LogHistogram::lower_edge(bucket) < LogHistogram::lower_edge(bucket + 1));
    LogHistogram first;
    first.add(LogHistogram::lower_edge(bucket), Instant{});
    REQUIRE(first.in_bucket(bucket) == 1);
    LogHistogram last;
    last.add(LogHistogram::lower_edge(bucket + 1) - 1ns, Instant{});
    REQUIRE(last.in_bucket(bucket) == 1);
  }
}

TEST_CASE("Log histogram: quantiles are those of the sorted spans, at most one bucket of 1/32 too large", "[time]") {
  std::mt19937_64 random{7};
  std::lognormal_distribution<double> spread{10.0, 1.5};  // Some 22 us, with a long tail.
  std::vector<Nanos> spans;
  LogHistogram histogram;
  for (int i = 0; i < 100'000; ++i) {
    spans.emplace_back(static_cast<Nanos::rep>(spread(random)));
    histogram.add(spans.back(), Instant{});
  }
  std::sort(spans.begin(), spans.end());
  for (const double share : {0.001, 0.5, 0.99, 0.999, 1.0}) {
    const Nanos exact = spans[static_cast<std::size_t>(std::ceil(share * 1e5)) - 1];
    CHECK(histogram.quantile(share) >= exact);
    CHECK(to_s(histogram.quantile(share)) <= to_s(exact) * (1 + 1.0 / LogHistogram::kPerOctave));
  }
}

TEST_CASE("Log histogram: the largest span and its time are exact; nothing counted is all zero", "[time]") {
  LogHistogram histogram;
  CHECK(histogram.quantile(0.999) == 0ns);
  histogram.add(123'456'789ns, Instant{3s});
  histogram.add(100ns, Instant{4s});
  histogram.add(-5ns, Instant{5s});
  CHECK(histogram.count() == 3);
  CHECK(histogram.max() == 123'456'789ns);
  CHECK(histogram.max_at() == Instant{3s});
  CHECK(histogram.quantile(1.0) == 123'456'789ns);
  histogram.add(100s, Instant{6s});  // Beyond the last bucket.
  CHECK(histogram.quantile(1.0) == 100s);
}
