#include <catch2/catch.hpp>

#include "protocols/runtime/real_time_driver.hpp"

using namespace meltbench;
using namespace meltbench::runtime;

TEST_CASE("Frame queue: frames come out in the order in which they went in, over many rounds", "[runtime]") {
  FrameQueue queue;
  std::uint32_t next_in = 0;
  std::uint32_t next_out = 0;
  for (int round = 0; round < 5; ++round) {
    while (!queue.full()) queue.push(can::make_frame(next_in++ % 0x7FF, {}));
    CHECK(queue.size() == FrameQueue::kCapacity);
    for (int i = 0; i < 700; ++i, queue.pop()) REQUIRE(queue.front().id == next_out++ % 0x7FF);
  }
  queue.clear();
  CHECK(queue.empty());
}
