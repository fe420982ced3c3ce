#include "bench/bus/response_time.hpp"

#include <catch2/catch.hpp>
#include <numeric>
#include <random>

#include "bench/bus/bit_timed_bus.hpp"
#include "tests/bench/bus/bus_log.hpp"

using namespace meltbench;
using namespace meltbench::bus;

namespace {

constexpr Nanos kBit = 2us;  // 500 kbit/s.

struct Message {
  can::CanFrame frame;
  std::size_t node = 0;
  Nanos period{}, jitter{}, offset{};
};

std::vector<PeriodicFrame> describe(const std::vector<Message>& messages) {
  std::vector<PeriodicFrame> frames;
  for (const Message& m : messages) {
    frames.push_back(
        {can::arbitration_key(m.frame), can::calc_frame_length(m.frame).nominal_bits * kBit, m.period, m.jitter});
  }
  return frames;
}

/// Worst response of each message, simulated; each instance is queued up to its jitter after its period.
std::vector<Nanos> simulate(const std::vector<Message>& messages, std::size_t nodes, Nanos duration,
                            std::mt19937_64& random) {
  struct Queued {
    Instant at;
    std::size_t message;
  };
  std::vector<Queued> plan;
  for (std::size_t i = 0; i < messages.size(); ++i) {
    const Message& m = messages[i];
    for (Nanos at = m.offset; at < duration; at += m.period) {
      const Nanos late = m.jitter > 0ns ? Nanos{static_cast<std::int64_t>(random()) % (m.jitter.count() + 1)} : 0ns;
      plan.push_back({Instant{at + (late < 0ns ? -late : late)}, i});
    }
  }
  std::ranges::stable_sort(plan, {}, &Queued::at);
  class Worst final : public BusListener {
   public:
    explicit Worst(const std::vector<Message>& all) : messages{all}, worst(all.size()) {}
    void on_delivery(const Delivery& delivery) override {
      for (std::size_t i = 0; i < messages.size(); ++i) {
        if (messages[i].frame.id == delivery.frame.id) worst[i] = std::max(worst[i], delivery.at - delivery.queued_at);
      }
    }
    void on_error(Instant, std::size_t, const can::CanFrame&) override {}
    void on_state(Instant, std::size_t, can::ErrorState) override {}
    const std::vector<Message>& messages;
    std::vector<Nanos> worst;
  };
  Worst log{messages};
  BitTimedBus bus{{.bit_time = kBit, .data_bit_time = kBit, .tx_queue = 200, .restart_after = {}}, nodes, log};
  for (const Queued& queued : plan) {
    bus.advance(queued.at - 1ns);
    REQUIRE(bus.send(queued.at, messages[queued.message].node, messages[queued.message].frame));
  }
  bus.advance(Instant{duration + 10s});
  return log.worst;
}

/// 4 to 14 messages on 2 to 8 nodes that load the bus by 30 to 95 %.
std::vector<Message> draw_messages(std::mt19937_64& random, std::size_t nodes) {
  const std::size_t count = 4 + random() % 11;
  std::vector<Message> messages;
  double load = 0;
  for (std::size_t i = 0; i < count; ++i) {
    Message m;
    m.frame.id = static_cast<std::uint32_t>(random() % 100 * 16 + i);
    m.frame.length = static_cast<std::uint8_t>(random() % 9);
    for (auto& byte : m.frame.bytes) byte = random() % 3 == 0 ? 0 : static_cast<std::uint8_t>(random());
    m.node = random() % nodes;
    m.period = Nanos{static_cast<std::int64_t>(1'000'000 + random() % 19'000'000)};
    m.jitter = random() % 2 == 0 ? 0ns : Nanos{static_cast<std::int64_t>(random() % 2'000'000)};
    m.offset = Nanos{static_cast<std::int64_t>(random() % 20'000'000)};
    load += static_cast<double>(can::calc_frame_length(m.frame).nominal_bits + 3) * 2e3 /
            static_cast<double>(m.period.count());
    messages.push_back(m);
  }
  const double wanted = 0.3 + 0.65 * static_cast<double>(random() % 1000) / 1000.0;
  for (Message& m : messages) {
    m.period = Nanos{static_cast<std::int64_t>(static_cast<double>(m.period.count()) * load / wanted)};
  }
  return messages;
}

}  // namespace

TEST_CASE("Response time: no simulated response of 1,000 random message sets exceeds its bound", "[bus]") {
  std::mt19937_64 random{2007};
  std::size_t bounded = 0;
  double closest = 0;
  for (int set = 0; set < 1000; ++set) {
    const std::size_t nodes = 2 + random() % 7;
    const std::vector<Message> messages = draw_messages(random, nodes);
    const auto bounds = calc_response_bounds(describe(messages), kBit);
    const std::vector<Nanos> worst = simulate(messages, nodes, 60ms, random);
    for (std::size_t i = 0; i < messages.size(); ++i) {
      if (!bounds[i]) continue;
      ++bounded;
      INFO("set " << set << ", message " << messages[i].frame.id);
      REQUIRE(worst[i] <= *bounds[i]);
      closest = std::max(closest, to_s(worst[i]) / to_s(*bounds[i]));
    }
  }
  CHECK(bounded > 8000);
  CHECK(closest > 0.95);  // Else the bound would be no bound but a guess.
}

TEST_CASE("Response time: the critical instant takes the bound, to within one bit", "[bus]") {
  // All queued at once, one nanosecond after the longest frame of lower priority has begun.
  const auto message = [](const char* text, std::size_t node, Nanos period) {
    return Message{test::frame(text), node, period, 0ns, 1000ns};
  };
  std::vector<Message> messages{message("010#0102030405060708", 0, 1ms), message("020#1122", 1, 2ms),
                                message("030#AABBCCDDEE", 2, 3ms),       message("040#5555555555555555", 3, 5ms),
                                message("050#00FF00FF00FF", 0, 7ms),     message("7F0#8181818181818181", 4, 1s)};
  messages.back().offset = 999ns;
  const auto bounds = calc_response_bounds(describe(messages), kBit);
  std::mt19937_64 random{1};
  const std::vector<Nanos> worst = simulate(messages, 5, 10ms, random);
  for (std::size_t i = 0; i + 1 < messages.size(); ++i) {
    INFO(messages[i].frame.id);
    REQUIRE(bounds[i]);
    CHECK(worst[i] <= *bounds[i]);
    CHECK(*bounds[i] - worst[i] < kBit);
  }
}

TEST_CASE("Response time: a later instance can be the worst one, which Tindell's analysis overlooked", "[bus]") {
  // Davis et al. 2007, Table 2: three messages of 1 ms each, periods 2.5, 3.5, 3.5 ms: R_C = 3.5 ms by the second
  // instance of C (3 ms by the first). Here C' = 125 bits of 8 us at 125 kbit/s.
  constexpr Nanos kSlowBit = 8us;
  const Nanos on_wire = 122 * kSlowBit;
  const std::vector<PeriodicFrame> frames{
      {1, on_wire, 2'500us, 0ns}, {2, on_wire, 3'500us, 0ns}, {3, on_wire, 3'500us, 0ns}};
  const auto bounds = calc_response_bounds(frames, kSlowBit);
  REQUIRE(bounds[2]);
  CHECK(*bounds[0] == 2ms - 3 * kSlowBit);
  CHECK(*bounds[1] == 3ms - 3 * kSlowBit);
  CHECK(*bounds[2] == 3'500us - 3 * kSlowBit);
}

TEST_CASE("Response time: a bus with more to carry than it can has no bound for what is left over", "[bus]") {
  const std::vector<PeriodicFrame> frames{{1, 200us, 300us, 0ns}, {2, 200us, 300us, 0ns}};
  const auto bounds = calc_response_bounds(frames, kBit);
  CHECK(bounds[0].has_value());
  CHECK_FALSE(bounds[1].has_value());
}
