#include <catch2/catch.hpp>

#include "tests/protocols/canopen/test_device.hpp"

using namespace meltbench;
using namespace meltbench::canopen;
using namespace meltbench::canopen::testing;

namespace {

/// Runs a queue against the test device; `alive` false is a node that does not answer.
ConfigurationQueue::Status run(ConfigurationQueue& queue, Device& device, std::vector<SdoStep> steps,
                               bool alive = true) {
  Frames requests;
  queue.start(device.now, std::move(steps), requests);
  while (queue.status() == ConfigurationQueue::Status::kBusy) {
    Frames answers;
    if (alive) {
      for (const can::CanFrame& frame : requests) device.node.on_frame(device.now, frame, answers);
    }
    requests.clear();
    for (const can::CanFrame& frame : answers) queue.on_frame(device.now, frame, requests);
    if (!requests.empty() || queue.status() != ConfigurationQueue::Status::kBusy) continue;
    device.now = queue.next_deadline();
    queue.on_time(device.now, requests);
  }
  return queue.status();
}

}  // namespace

TEST_CASE("Manager: NMT commands and SYNC are the frames of CiA 301", "[canopen][manager]") {
  CHECK(show(make_nmt_command(NmtCommand::kStart, 5)) == "000#0105");
  CHECK(show(make_nmt_command(NmtCommand::kResetNode, 0)) == "000#8100");
  CHECK(show(make_sync()) == "080#");
  CHECK(show(make_sync(std::uint8_t{7})) == "080#07");
}

TEST_CASE("Configuration: identity is compared, values are written and read in order", "[canopen][manager]") {
  Device device;
  device.start();
  ConfigurationQueue queue{kNode, "feeder"};
  std::vector<SdoStep> steps;
  steps.push_back(expect_step<std::uint32_t>(0x1000, 0, 0x00020194, "device type"));
  steps.push_back(write_step<std::uint16_t>(0x1017, 0, 100));
  steps.push_back({SdoStep::Kind::kRead, {0x1008, 0}, {}, {}});
  CHECK(run(queue, device, steps) == ConfigurationQueue::Status::kDone);
  CHECK(queue.steps_done() == 3);
  CHECK(device.read<std::uint16_t>(0x1017, 0) == 100);
  const auto name = queue.value_read(2);
  CHECK(std::string(name.begin(), name.end()) == "Test device");
  CHECK(run(queue, device, {}) == ConfigurationQueue::Status::kDone);
}

TEST_CASE("Configuration: the first failure stops it and is said in words", "[canopen][manager]") {
  Device device;
  device.start();
  ConfigurationQueue queue{kNode, "feeder", 100ms};

  CHECK(run(queue, device, {expect_step<std::uint32_t>(0x1018, 2, 8, "product code"), write_step(0x2000, 0, 1U)}) ==
        ConfigurationQueue::Status::kFailed);
  CHECK(queue.failure() == "feeder (node 5): product code: 0x1018:2 is 0x00000002, expected 0x00000008");
  CHECK(device.read<std::uint32_t>(0x2000, 0) == 7);

  CHECK(run(queue, device, {write_step(0x2005, 0, std::int16_t{101})}) == ConfigurationQueue::Status::kFailed);
  CHECK(queue.failure() ==
        "feeder (node 5): write 0x2005:0: aborted by the node with 06090031, value is too high (value 0x0065)");

  CHECK(run(queue, device, {expect_step(0x1000, 0, 0U)}, false) == ConfigurationQueue::Status::kFailed);
  CHECK(queue.failure() == "feeder (node 5): read 0x1000:0: no answer within 100 ms");
}

TEST_CASE("Periodic timer: keeps its grid, and counts the periods that a late caller missed", "[canopen][manager]") {
  PeriodicTimer timer;
  CHECK_FALSE(timer.take(Instant{1s}));
  timer.start(Instant{10ms}, 10ms);
  CHECK_FALSE(timer.take(Instant{9ms}));
  CHECK(timer.take(Instant{12ms}));
  CHECK(timer.next_deadline() == Instant{20ms});
  CHECK(timer.take(Instant{45ms}));
  CHECK(timer.next_deadline() == Instant{50ms});
  CHECK(timer.missed() == 2);
}

TEST_CASE("Heartbeat watch: a time-out of zero ends the watch of a node", "[canopen][heartbeat]") {
  HeartbeatConsumer consumer;
  consumer.watch(7, 100ms);
  CHECK(consumer.is_watched(7));
  consumer.watch(7, 0ms);
  CHECK_FALSE(consumer.is_watched(7));
  CHECK_FALSE(consumer.on_frame(Instant{1s}, make_heartbeat(7, NmtState::kOperational)));
  CHECK(consumer.next_deadline() == Instant::never());
}

TEST_CASE("Heartbeat watch: a node that is never heard can be given a time-out from now on", "[canopen][heartbeat]") {
  HeartbeatConsumer consumer;
  consumer.watch_from(Instant{1s}, 7, 100ms);
  CHECK(consumer.next_deadline() == Instant{1100ms});
  CHECK_FALSE(consumer.take_lost(Instant{1099ms}));
  const auto lost = consumer.take_lost(Instant{1100ms});
  REQUIRE(lost);
  CHECK(lost->node == 7);
  CHECK_FALSE(consumer.take_lost(Instant{1100ms}));
  CHECK_FALSE(consumer.is_alive(7));
  CHECK(consumer.on_frame(Instant{2s}, make_heartbeat(7, NmtState::kOperational))->change == HeartbeatChange::kBack);
  CHECK(consumer.is_alive(7));
  CHECK(consumer.state(7) == NmtState::kOperational);
  CHECK_FALSE(consumer.on_frame(Instant{2s}, make_heartbeat(8, NmtState::kOperational)));
}
