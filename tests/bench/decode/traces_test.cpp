#include "bench/decode/traces.hpp"

#include <catch2/catch.hpp>
#include <cmath>
#include <filesystem>

#include "bench/scenario/scenario.hpp"

using namespace meltbench;
using namespace meltbench::decode;

namespace {

constexpr Instant kStart{};

const config::Rig& rig() {
  static const scenario::ResolvedRun run = [] {
    const auto folder = std::filesystem::path{MELTBENCH_SOURCE_DIR} / "fixtures/scenarios";
    return std::move(scenario::load(folder / "set_point_step.toml").front());
  }();
  return run.rig;
}

/// Melt pressure of a bizone machine, reported every 10 ms for ten seconds.
template <typename Pressure>
Traces listen(const Pressure& pressure_Pa) {
  Traces traces{rig()};
  for (Nanos at{}; at <= 10s; at += 10ms) {
    can::CanFrame frame;
    frame.id = 0x187;
    frame.length = 7;
    const auto value = static_cast<std::uint32_t>(pressure_Pa(to_s(at)));
    for (unsigned i = 0; i < 4; ++i) frame.bytes[i] = static_cast<std::uint8_t>(value >> (8 * i));
    traces.take(kStart + at, frame);
  }
  return traces;
}

}  // namespace

TEST_CASE("measurements are sampled ten times a second, between the cycles", "[decode]") {
  const Traces traces = listen([](double t) { return 1000.0 * t; });
  REQUIRE(traces.quantities().size() == 1);
  CHECK(traces.quantities()[0].sensor == "melt_pressure");
  CHECK(traces.size() == 100);
  CHECK(traces.of(0)[10] == 1000.0F);
  CHECK(Traces::time_of(10) == kStart + 1005ms);
  CHECK(Traces::sample_at(kStart + 1005ms) == 10);
  CHECK(Traces::sample_at(kStart + 1006ms) == 11);
}

TEST_CASE("two runs part where they are further apart for half a second, not for a moment", "[decode]") {
  const Traces healthy = listen([](double) { return 20'000.0; });
  const Traces drifts = listen([](double t) { return 20'000.0 + 500.0 * std::max(0.0, t - 5.0); });
  const Traces spike = listen([](double t) { return t > 3.0 && t < 3.2 ? 50'000.0 : 20'000.0; });
  const auto departure = find_departure(drifts, healthy, 1000);
  REQUIRE(departure.has_value());
  CHECK(to_s(Traces::time_of(departure->sample)) == Approx(5.3).margin(0.11));  // 100 Pa, that is 0.2 s, and a sample.
  CHECK_FALSE(find_departure(drifts, healthy, 50).has_value());
  CHECK_FALSE(find_departure(spike, healthy, 1000).has_value());
  CHECK(calc_distance(healthy, healthy, 0, 1000) == 0.0);
  CHECK(calc_distance(drifts, healthy, 60, 100) > 1.0);
}
