#include "bench/replay/raw_replay.hpp"

#include <catch2/catch.hpp>
#include <deque>
#include <memory>
#include <string>
#include <vector>

#include "protocols/can/candump.hpp"

using namespace meltbench;
using namespace meltbench::replay;
using Catch::Matchers::Contains;

namespace {

/// Microseconds apart, so that a test takes no time.
constexpr std::string_view kLog =
    "(1.000000) can0 185#01\n"
    "(1.000100) can1 185#02\n"
    "(1.000200) can0 20000088#0000000000000000\n"
    "(1.000300) can0 701#05\n"
    "(1.000250) can0 12345678#03\n";

/// A bus that does as it is told, and keeps what is sent on it.
class Bus final : public link::CanLink {
 public:
  std::vector<std::string> sent;
  std::deque<link::SendStatus> answers;  ///< To the next sends; then kSent.

  [[nodiscard]] link::SendStatus send(const can::CanFrame& frame) noexcept override {
    link::SendStatus answer = link::SendStatus::kSent;
    if (!answers.empty()) {
      answer = answers.front();
      answers.pop_front();
    }
    if (answer == link::SendStatus::kSent) sent.push_back(can::to_candump(frame));
    return answer;
  }
  [[nodiscard]] std::optional<link::ReceivedFrame> receive() noexcept override { return std::nullopt; }
  [[nodiscard]] bool is_up() noexcept override { return true; }
  [[nodiscard]] int fd() const noexcept override { return -1; }
  [[nodiscard]] const link::LinkCounters& counters() const noexcept override { return counters_; }

 private:
  link::LinkCounters counters_;
};

RawReplayResult play(Bus& bus, const RawReplayRequest& request, const std::function<bool()>& stop) {
  const auto open = [] { return log::open_log(std::make_unique<log::MemorySource>(std::span{kLog})); };
  return replay_raw(open, bus, request, stop);
}

RawReplayResult play(Bus& bus, const RawReplayRequest& request = {}) {
  return play(bus, request, [] { return false; });
}

using Sent = std::vector<std::string>;

}  // namespace

TEST_CASE("Raw replay: one channel's frames go out in their order, error frames stay where they were", "[replay]") {
  Bus bus;
  const RawReplayResult result = play(bus);
  CHECK(bus.sent == Sent{"185#01", "701#05", "12345678#03"});
  CHECK(result.sent == 3);
  CHECK(result.left_out == 2);
  CHECK(result.lateness.count() == 3);
  Bus other;
  CHECK(play(other, {.channel = "can1"}).sent == 1);
  CHECK(other.sent == Sent{"185#02"});
  CHECK_THROWS_WITH(play(other, {.channel = "can7"}), Contains("can7"));
}

TEST_CASE("Raw replay: identifiers are picked by mask and renamed, loops begin anew", "[replay]") {
  Bus bus;
  const RawReplayResult result = play(bus, {.loops = 2, .only = {{0x180, 0x780}}, .renames = {{0x185, 0x1FF00}}});
  CHECK(bus.sent == Sent{"0001FF00#01", "0001FF00#01"});
  CHECK(result.left_out == 8);
}

TEST_CASE("Raw replay: a full queue is waited for, what the bus cannot carry is passed over, a bus that goes is told",
          "[replay]") {
  Bus bus;
  bus.answers = {link::SendStatus::kFull, link::SendStatus::kFull, link::SendStatus::kSent,
                 link::SendStatus::kUnsupported};
  const RawReplayResult result = play(bus);
  CHECK(bus.sent == Sent{"185#01", "12345678#03"});
  CHECK(result.waits == 2);
  CHECK(result.unsupported == 1);
  Bus gone;
  gone.answers = {link::SendStatus::kSent, link::SendStatus::kDown};
  CHECK_THROWS_AS(play(gone), link::LinkError);
}

TEST_CASE("Raw replay: stopped while the queue is full, the frame that waits counts as not sent", "[replay]") {
  Bus bus;
  bus.answers.assign(1000, link::SendStatus::kFull);
  int asked = 0;
  const RawReplayResult result = play(bus, {.loops = 0}, [&asked] { return ++asked > 5; });
  CHECK(result.sent == 0);
  CHECK(bus.sent.empty());
}
