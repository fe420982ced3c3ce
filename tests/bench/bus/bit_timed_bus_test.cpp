#include "bench/bus/bit_timed_bus.hpp"

#include <catch2/catch.hpp>
#include <random>

#include "tests/bench/bus/bus_log.hpp"

using namespace meltbench;
using namespace meltbench::bus;
using can::ErrorState;
using test::BusLog;
using test::frame;

namespace {

constexpr Nanos kBit = 2us;  // 500 kbit/s.

/// A bus at 500 kbit/s with its log.
struct Bench {
  explicit Bench(std::size_t nodes, BitTimedSettings settings = {}) : bus{settings, nodes, log} {}
  void send(Nanos at, std::size_t node, const char* text) {
    bus.advance(Instant{at - 1ns});
    REQUIRE(bus.send(Instant{at}, node, frame(text)));
  }
  void run(Nanos to) { bus.advance(Instant{to}); }

  BusLog log;
  BitTimedBus bus;
};

}  // namespace

TEST_CASE("Bit-timed bus: a frame takes its exact bits, and the next one waits for the interframe space", "[bus]") {
  Bench bench{3};
  bench.send(100us, 0, "123#1122334455667788");  // 112 bits with interframe space.
  bench.send(100us, 1, "080#");                  // 51.
  bench.send(101us, 2, "000#0000000000000000");  // 127.
  bench.run(1ms);
  REQUIRE(bench.log.frames() == "080 000 123");
  CHECK(bench.log.deliveries[0].at == Instant{100us + 48 * kBit});
  CHECK(bench.log.deliveries[1].started_at == Instant{100us + 51 * kBit});
  CHECK(bench.log.deliveries[1].at == Instant{100us + (51 + 124) * kBit});
  CHECK(bench.log.deliveries[2].at == Instant{100us + (51 + 127 + 109) * kBit});
  CHECK(bench.log.deliveries[2].queued_at == Instant{100us});
  CHECK(bench.log.deliveries[2].receivers == 0b110);
  CHECK(bench.bus.busy() == (51 + 127 + 112) * kBit);
  CHECK(bench.bus.next_event() == Instant::never());
}

TEST_CASE("Bit-timed bus: arbitration follows the bits of the identifier", "[bus]") {
  Bench bench{6};
  bench.send(0us, 0, "048C0000#R");
  bench.send(0us, 1, "048C0000#00");
  bench.send(0us, 2, "123#R");
  bench.send(0us, 3, "123#00");
  bench.send(0us, 4, "124#00");
  bench.send(0us, 5, "122##000");
  bench.run(10ms);
  REQUIRE(bench.log.deliveries.size() == 6);
  std::string order;
  for (const Delivery& d : bench.log.deliveries) order += std::to_string(d.sender);
  CHECK(order == "532104");
  CHECK(bench.bus.node(4).counters().arbit_lost == 5);
  CHECK(bench.bus.node(5).counters().arbit_lost == 0);
  CHECK(bench.log.errors.empty());
}

TEST_CASE("Bit-timed bus: FD frames with bit rate switch take two bit times", "[bus]") {
  BitTimedSettings settings;
  settings.data_bit_time = 500ns;  // 2 Mbit/s.
  Bench bench{2, settings};
  const can::CanFrame fd = frame("123##1112233445566778899AABBCC");
  const can::FrameLength length = can::calc_frame_length(fd);
  bench.bus.send(Instant{}, 0, fd);
  bench.run(1ms);
  REQUIRE(bench.log.deliveries.size() == 1);
  CHECK(bench.log.deliveries[0].at == Instant{length.nominal_bits * kBit + length.data_bits * 500ns});
  CHECK(length.data_bits > 100);
}

TEST_CASE("Bit-timed bus: a full queue refuses, and the frame counts as dropped", "[bus]") {
  BitTimedSettings settings;
  settings.tx_queue = 3;
  Bench bench{2, settings};
  for (int i = 0; i < 3; ++i) bench.send(0us, 0, "100#00");
  CHECK_FALSE(bench.bus.send(Instant{}, 0, frame("001#00")));
  bench.run(50us);  // The first one is on the wire, and still needs its place.
  CHECK_FALSE(bench.bus.send(Instant{50us}, 0, frame("001#00")));
  bench.run(500us);
  CHECK(bench.bus.send(Instant{500us}, 0, frame("001#00")));
  CHECK(bench.bus.node(0).counters().tx_dropped == 2);
}

TEST_CASE("Bit-timed bus: mailboxes send by priority, a FIFO as queued", "[bus]") {
  BitTimedSettings settings;
  settings.tx_order = GENERATE(TxOrder::kPriority, TxOrder::kFifo);
  Bench bench{2, settings};
  for (const char* text : {"300#01", "100#02", "300#03", "200#04", "100#05"}) bench.send(0us, 0, text);
  bench.send(10us, 0, "001#06");  // While the first is on the wire.
  bench.run(10ms);
  std::string order;
  for (const Delivery& d : bench.log.deliveries) order += std::to_string(d.frame.bytes[0]);
  CHECK(order == (settings.tx_order == TxOrder::kFifo ? "123456" : "265413"));
}

TEST_CASE("Bit-timed bus: what goes frame by frame and what goes bit by bit end alike", "[bus]") {
  // A bit flip that never meets its frame makes the second bus go bit by bit.
  const bool fd = GENERATE(false, true);
  BitTimedSettings settings;
  settings.data_bit_time = fd ? 250ns : kBit;
  settings.tx_queue = 40;  // Full now and then.
  settings.tx_order = GENERATE(TxOrder::kPriority, TxOrder::kFifo);
  Bench fast{5, settings};
  Bench slow{5, settings};
  slow.bus.flip(Instant{}, {.id = 0, .mask = 0, .bit = 9999, .frames = 1});
  for (Bench* bench : {&fast, &slow}) {
    bench->bus.set_clock_drift(Instant{}, 1, 137.5);
    bench->bus.set_clock_drift(Instant{}, 2, -4000);
    std::mt19937_64 random{11};
    Instant at;
    for (int i = 0; i < 3000; ++i) {
      at += Nanos{static_cast<std::int64_t>(random() % 600'000)};
      can::CanFrame sent;
      sent.extended = random() % 2 == 0;
      sent.id = static_cast<std::uint32_t>(random() % 0x7F0) * 8 + static_cast<std::uint32_t>(i % 5);
      sent.id = sent.extended ? sent.id : sent.id & 0x7FF;
      sent.fd = fd && random() % 2 == 0;
      sent.brs = sent.fd && random() % 2 == 0;
      sent.length = can::round_up_to_fd_length(random() % (sent.fd ? 65 : 9));
      for (auto& byte : sent.bytes) byte = random() % 3 == 0 ? 0 : static_cast<std::uint8_t>(random());
      if (!sent.extended) sent.id = (sent.id & ~7U) | static_cast<std::uint32_t>(i % 5);  // Nobody shares one.
      bench->bus.advance(at);
      bench->bus.send(at, static_cast<std::size_t>(i % 5), sent);
    }
    bench->bus.advance(at + 1s);
  }
  REQUIRE(fast.log.deliveries.size() == slow.log.deliveries.size());
  REQUIRE(fast.log.deliveries.size() > 1800);
  for (std::size_t i = 0; i < fast.log.deliveries.size(); ++i) {
    const Delivery& a = fast.log.deliveries[i];
    const Delivery& b = slow.log.deliveries[i];
    INFO(i << " " << can::to_candump(a.frame) << " " << can::to_candump(b.frame));
    REQUIRE(a.frame == b.frame);
    REQUIRE(a.sender == b.sender);
    REQUIRE(a.receivers == b.receivers);
    REQUIRE(a.queued_at == b.queued_at);
    // The slow one joins the grid of bits when it becomes busy; a frame queued in its last idle bit may wait for it.
    REQUIRE(a.at == b.at);
    REQUIRE(a.started_at == b.started_at);
  }
  CHECK(slow.log.errors.empty());
  for (std::size_t n = 0; n < 5; ++n) {
    CHECK(fast.bus.node(n).counters().tx_packets == slow.bus.node(n).counters().tx_packets);
    CHECK(fast.bus.node(n).counters().rx_packets == slow.bus.node(n).counters().rx_packets);
    CHECK(fast.bus.node(n).counters().rx_bytes == slow.bus.node(n).counters().rx_bytes);
    CHECK(fast.bus.node(n).counters().arbit_lost == slow.bus.node(n).counters().arbit_lost);
    CHECK(fast.bus.node(n).counters().tx_dropped == slow.bus.node(n).counters().tx_dropped);
  }
}

TEST_CASE("Bit-timed bus: a node that is connected in the middle of its frame does not turn time back", "[bus]") {
  Bench bench{2};
  bench.bus.advance(Instant{1s});
  bench.bus.set_cut_off(Instant{1s}, 0, true);
  REQUIRE(bench.bus.send(Instant{1s}, 0, frame("123#1122334455667788")));
  bench.bus.advance(Instant{1s + 50us});  // Nobody else hears it: no bit of it is on the wire.
  bench.bus.set_cut_off(Instant{1s + 50us}, 0, false);
  Instant before{1s + 50us};
  for (int bit = 0; bit < 100; ++bit) {
    const Instant next = bench.bus.next_event();
    REQUIRE(next >= before);
    bench.bus.advance(before = next);
  }
}
