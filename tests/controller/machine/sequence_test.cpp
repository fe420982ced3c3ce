#include "controller/machine/sequence.hpp"

#include <catch2/catch.hpp>

using namespace meltbench;
using namespace meltbench::machine;
using Phase = SequencePhase;

namespace {

constexpr double kRun_rev_per_s = 1.5;
constexpr SequenceSettings kSettings{.soak = 60s,
                                     .fill = 5s,
                                     .fill_timeout = 120s,
                                     .heat_timeout = 600s,
                                     .hold_rev_per_s = 0.3,
                                     .purge_rev_per_s = 1.0,
                                     .purge = 30s};

/// A sequence that has been brought to running at 100 s.
Sequence make_running() {
  Sequence sequence{kSettings};
  REQUIRE(sequence.obey(Instant{0s}, SequenceOrder::kStart));
  sequence.update(Instant{30s}, true, false);
  sequence.update(Instant{90s}, true, false);
  sequence.update(Instant{95s}, true, true);
  sequence.update(Instant{100s}, true, true);
  REQUIRE(sequence.phase() == Phase::kRunning);
  return sequence;
}

}  // namespace

TEST_CASE("Sequence: cold means no heat, no screw and no feed", "[machine]") {
  const Sequence sequence{kSettings};
  const SequenceDemand demand = sequence.demand(kRun_rev_per_s);
  CHECK_FALSE(demand.heat);
  CHECK(demand.screw_rev_per_s == 0.0);
  CHECK(demand.feed == FeedMode::kNone);
}

TEST_CASE("Sequence: the screw turns only after all zones have been warm for the soaking time", "[machine]") {
  Sequence sequence{kSettings};
  CHECK(sequence.obey(Instant{0s}, SequenceOrder::kStart));
  CHECK(sequence.demand(kRun_rev_per_s).heat);
  CHECK_FALSE(sequence.update(Instant{29s}, false, false));
  CHECK(sequence.update(Instant{30s}, true, false));
  CHECK(sequence.phase() == Phase::kSoaking);
  sequence.update(Instant{89s}, true, false);
  CHECK(sequence.demand(kRun_rev_per_s).screw_rev_per_s == 0.0);
  sequence.update(Instant{90s}, true, false);
  CHECK(sequence.phase() == Phase::kFilling);
  CHECK(sequence.demand(kRun_rev_per_s).screw_rev_per_s == kRun_rev_per_s);
  CHECK(sequence.demand(kRun_rev_per_s).feed == FeedMode::kOpenLoop);
}

TEST_CASE("Sequence: a zone that leaves its band starts the soaking anew", "[machine]") {
  Sequence sequence{kSettings};
  sequence.obey(Instant{0s}, SequenceOrder::kStart);
  sequence.update(Instant{30s}, true, false);
  sequence.update(Instant{80s}, false, false);
  CHECK(sequence.phase() == Phase::kHeating);
  sequence.update(Instant{85s}, true, false);
  sequence.update(Instant{144s}, true, false);
  CHECK(sequence.phase() == Phase::kSoaking);
  sequence.update(Instant{145s}, true, false);
  CHECK(sequence.phase() == Phase::kFilling);
}

TEST_CASE("Sequence: a run counts as running when the loops have been good without a break", "[machine]") {
  Sequence sequence{kSettings};
  sequence.obey(Instant{0s}, SequenceOrder::kStart);
  sequence.update(Instant{30s}, true, false);
  sequence.update(Instant{90s}, true, false);
  sequence.update(Instant{91s}, true, true);
  sequence.update(Instant{95s}, true, false);
  sequence.update(Instant{97s}, true, true);
  sequence.update(Instant{101s}, true, true);
  CHECK(sequence.phase() == Phase::kFilling);
  sequence.update(Instant{102s}, true, true);
  CHECK(sequence.phase() == Phase::kRunning);
  CHECK(sequence.demand(kRun_rev_per_s).feed == FeedMode::kLaw);
}

TEST_CASE("Sequence: hold goes slower with both loops, and start brings it back", "[machine]") {
  Sequence sequence = make_running();
  CHECK(sequence.obey(Instant{200s}, SequenceOrder::kHold));
  CHECK(sequence.demand(kRun_rev_per_s).screw_rev_per_s == 0.3);
  CHECK(sequence.demand(kRun_rev_per_s).feed == FeedMode::kLaw);
  CHECK(sequence.obey(Instant{300s}, SequenceOrder::kStart));
  CHECK(sequence.phase() == Phase::kFilling);
}

TEST_CASE("Sequence: purge empties with the feed off, then stands by hot", "[machine]") {
  Sequence sequence = make_running();
  CHECK(sequence.obey(Instant{200s}, SequenceOrder::kPurge));
  CHECK(sequence.demand(kRun_rev_per_s).feed == FeedMode::kNone);
  CHECK(sequence.demand(kRun_rev_per_s).screw_rev_per_s == 1.0);
  sequence.update(Instant{230s}, true, true);
  CHECK(sequence.phase() == Phase::kStandby);
  CHECK(sequence.demand(kRun_rev_per_s).heat);
  CHECK(sequence.demand(kRun_rev_per_s).screw_rev_per_s == 0.0);
}

TEST_CASE("Sequence: shut down purges a turning screw first, and ends cold", "[machine]") {
  Sequence sequence = make_running();
  CHECK(sequence.obey(Instant{200s}, SequenceOrder::kShutDown));
  CHECK(sequence.phase() == Phase::kPurging);
  sequence.update(Instant{230s}, true, true);
  CHECK(sequence.phase() == Phase::kCold);
}

TEST_CASE("Sequence: shut down of a standing screw, and of one that purges already", "[machine]") {
  Sequence heating{kSettings};
  heating.obey(Instant{0s}, SequenceOrder::kStart);
  CHECK(heating.obey(Instant{10s}, SequenceOrder::kShutDown));
  CHECK(heating.phase() == Phase::kCold);

  Sequence purging = make_running();
  purging.obey(Instant{200s}, SequenceOrder::kPurge);
  CHECK(purging.obey(Instant{210s}, SequenceOrder::kShutDown));
  purging.update(Instant{230s}, true, true);
  CHECK(purging.phase() == Phase::kCold);
}

TEST_CASE("Sequence: an order that means nothing in a phase is refused", "[machine]") {
  Sequence sequence{kSettings};
  CHECK_FALSE(sequence.obey(Instant{0s}, SequenceOrder::kHold));
  CHECK_FALSE(sequence.obey(Instant{0s}, SequenceOrder::kPurge));
  CHECK_FALSE(sequence.obey(Instant{0s}, SequenceOrder::kShutDown));
  CHECK(sequence.obey(Instant{0s}, SequenceOrder::kStart));
  CHECK_FALSE(sequence.obey(Instant{1s}, SequenceOrder::kStart));
}

TEST_CASE("Sequence: heating and filling may not take for ever", "[machine]") {
  Sequence sequence{kSettings};
  CHECK_FALSE(sequence.is_overdue(Instant{10000s}));  // Cold is where it may stay.
  sequence.obey(Instant{0s}, SequenceOrder::kStart);
  CHECK_FALSE(sequence.is_overdue(Instant{660s}));
  CHECK(sequence.is_overdue(Instant{661s}));
  sequence.update(Instant{30s}, true, false);
  sequence.update(Instant{90s}, true, false);
  CHECK_FALSE(sequence.is_overdue(Instant{210s}));
  CHECK(sequence.is_overdue(Instant{211s}));
}
