#include "bench/record/reaction_times.hpp"

#include <catch2/catch.hpp>

using namespace meltbench;
using namespace meltbench::record;

TEST_CASE("Reaction times: from a SYNC to the first command after it, once per SYNC", "[record]") {
  FrameLog frames;
  const auto frame = [&frames](Nanos at, std::uint32_t id) {
    frames.push_back(Instant{at}, can::make_frame(id, {}), kUnknownSender);
  };
  frame(0ms, 0x205);  // Before any SYNC: reacts to nothing.
  frame(10ms, 0x080);
  frame(11ms, 0x185);  // A board's answer is no command,
  frame(12ms, 0x605);  // nor is an SDO.
  frame(13ms, 0x206);
  frame(14ms, 0x305);  // The second command of this SYNC.
  frame(20ms, 0x080);  // Nobody reacts to it.
  frame(30ms, 0x080);
  frame(31ms, 0x505);
  const LogHistogram times = calc_reaction_times(frames);
  CHECK(times.count() == 2);
  CHECK(times.max() == 3ms);
  CHECK(times.max_at() == Instant{13ms});
  CHECK(to_s(times.quantile(0.5)) == Approx(1e-3).epsilon(1.0 / LogHistogram::kPerOctave));
}
