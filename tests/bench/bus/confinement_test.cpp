#include <algorithm>
#include <catch2/catch.hpp>

#include "bench/bus/bit_timed_bus.hpp"
#include "tests/bench/bus/bus_log.hpp"

/// Fault confinement of ISO 11898-1, rule by rule.

using namespace meltbench;
using namespace meltbench::bus;
using can::ErrorState;
using can::Field;
using test::BusLog;
using test::frame;

namespace {

constexpr Nanos kBit = 2us;  // 500 kbit/s.
// 080# on the wire: 48 bits, of which 4 are stuff bits (000010000000 -> 00001000001001...).
constexpr std::size_t kBitsOf080 = 48;

struct Bench {
  explicit Bench(std::size_t nodes, std::optional<Nanos> restart_after = {})
      : bus{{.bit_time = kBit, .data_bit_time = kBit, .tx_queue = 64, .restart_after = restart_after}, nodes, log} {}
  void send(std::size_t node, const char* text) { REQUIRE(bus.send(now, node, frame(text))); }
  void run_bits(std::int64_t bits) {
    now += bits * kBit;
    bus.advance(now);
  }
  /// Makes `times` tries of node's frame fail by a bit inverted in its data.
  void fail_sending(std::size_t node, std::uint64_t times) {
    bus.flip(now, {.id = 0x555, .mask = 0x7FF, .bit = 25, .frames = times});
    send(node, "555#5555555555555555");
    run_bits(static_cast<std::int64_t>(times) * 80 + 150);  // A try takes 26 bits, error frame and rest 33 at most.
  }
  unsigned tec(std::size_t node) { return bus.node(node).tec(); }
  unsigned rec(std::size_t node) { return bus.node(node).rec(); }
  ErrorState state(std::size_t node) { return bus.node(node).state(); }

  Instant now;
  BusLog log;
  BitTimedBus bus;
};

std::size_t end_of_frame_bit(const char* text, std::size_t number) {
  can::FrameBits bits;
  can::encode_frame(frame(text), bits);
  return bits.bits().size() - 8 + number;  // 1..7.
}

std::size_t first_bit_of(const char* text, Field field) {
  can::FrameBits bits;
  can::encode_frame(frame(text), bits);
  for (std::size_t i = 0; i < bits.bits().size(); ++i) {
    if (bits.bits()[i].field == field && !bits.bits()[i].stuff) return i;
  }
  return 0;
}

}  // namespace

TEST_CASE("Confinement: a lone node is error-passive after 16 tries and never goes bus-off", "[bus]") {
  Bench bench{1};
  bench.send(0, "080#");
  // A try: 46 bits to the acknowledge slot, flag 6, delimiter 8, interframe space 3.
  const std::size_t to_ack = first_bit_of("080#", Field::kAck) + 1;
  const auto one_try = static_cast<std::int64_t>(to_ack + 6 + 8 + 3);
  bench.run_bits(15 * one_try);
  CHECK(bench.tec(0) == 120);
  CHECK(bench.state(0) == ErrorState::kActive);
  bench.run_bits(one_try);
  CHECK(bench.tec(0) == 128);
  CHECK(bench.state(0) == ErrorState::kPassive);
  CHECK(bench.log.bus_errors(0).size() == 16);
  bench.run_bits(100 * (one_try + 8));  // From now on with 8 bits of suspended transmission.
  CHECK(bench.log.bus_errors(0).size() == 116);
  CHECK(bench.tec(0) == 128);
  CHECK(bench.state(0) == ErrorState::kPassive);
  const can::CanFrame error = bench.log.bus_errors(0)[0].frame;
  CHECK(error.id == (CAN_ERR_BUSERROR | CAN_ERR_PROT | CAN_ERR_ACK | CAN_ERR_CNT));
  CHECK(error.bytes[2] == CAN_ERR_PROT_TX);
  CHECK(error.bytes[3] == CAN_ERR_PROT_LOC_ACK);
  CHECK(error.bytes[6] == 8);
}

TEST_CASE("Confinement: a passive sender that nobody acknowledges counts only if its flag meets a dominant bit",
          "[bus]") {
  Bench bench{1};
  bench.send(0, "080#");
  const auto to_ack = static_cast<std::int64_t>(first_bit_of("080#", Field::kAck) + 1);
  bench.run_bits(16 * (to_ack + 6 + 8 + 3) + 8 + to_ack + 2);  // Two bits into its first passive flag.
  REQUIRE(bench.tec(0) == 128);
  REQUIRE(bench.log.bus_errors(0).size() == 17);
  bench.bus.set_wire(bench.now, WireState::kStuckDominant);
  bench.run_bits(2);
  bench.bus.set_wire(bench.now, WireState::kGood);
  CHECK(bench.tec(0) == 136);
  bench.run_bits(10'000);
  CHECK(bench.tec(0) == 136);
}

TEST_CASE("Confinement: a counter of 96 is reported as a warning, and its end as active again", "[bus]") {
  Bench bench{3};
  const auto reports = [&](std::uint8_t status) {
    return std::ranges::count_if(bench.log.errors, [&](const BusLog::Error& error) {
      return error.node == 0 && (error.frame.id & CAN_ERR_CRTL) != 0 && error.frame.bytes[1] == status;
    });
  };
  SECTION("eleven failed sendings: 88") {
    bench.fail_sending(0, 11);
    CHECK(reports(CAN_ERR_CRTL_TX_WARNING) == 0);
    CHECK(bench.bus.node(0).counters().error_warn == 0);
  }
  SECTION("twelve: 96, and 95 after the frame has come through") {
    bench.fail_sending(0, 12);
    CHECK(reports(CAN_ERR_CRTL_TX_WARNING) == 1);
    CHECK(reports(CAN_ERR_CRTL_ACTIVE) == 1);
    CHECK(bench.bus.node(0).counters().error_warn == 1);
    CHECK(bench.bus.node(0).counters().error_pass == 0);
    CHECK(bench.tec(0) == 95);
    CHECK(bench.log.states.empty());  // Still error-active all the time.
  }
}

TEST_CASE("Confinement: 32 failed sendings in a row take a node off the bus", "[bus]") {
  Bench bench{3};
  bench.fail_sending(0, 32);
  CHECK(bench.state(0) == ErrorState::kBusOff);
  CHECK(bench.bus.node(0).counters().bus_errors == 32);
  CHECK(bench.bus.node(0).counters().bus_off == 1);
  CHECK(bench.bus.node(0).counters().error_warn == 1);
  CHECK(bench.bus.node(0).counters().error_pass == 1);
  CHECK(bench.bus.node(0).counters().tx_packets == 0);
  CHECK_FALSE(bench.bus.send(bench.now, 0, frame("001#")));
  bool told = false;
  for (const BusLog::Error& error : bench.log.errors) told = told || (error.frame.id & CAN_ERR_BUSOFF) != 0;
  CHECK(told);
}

TEST_CASE("Confinement: 31 failed sendings do not, and each success takes one off the transmit counter", "[bus]") {
  Bench bench{3};
  bench.fail_sending(0, 31);
  bench.run_bits(500);
  CHECK(bench.log.frames() == "555");
  CHECK(bench.tec(0) == 31 * 8 - 1);
  CHECK(bench.state(0) == ErrorState::kPassive);
  for (int i = 0; i < 120; ++i) {
    bench.send(0, "080#");
    bench.run_bits(80);
  }
  CHECK(bench.tec(0) == 31 * 8 - 1 - 120);
  CHECK(bench.state(0) == ErrorState::kActive);
  for (int i = 0; i < 130; ++i) {
    bench.send(0, "080#");
    bench.run_bits(80);
  }
  CHECK(bench.tec(0) == 0);
}

TEST_CASE("Confinement: receivers count one for an error, and one less for a frame received", "[bus]") {
  Bench bench{3};
  // A flip that is never met makes the bus go bit by bit; otherwise undisturbed frames are counted in one step.
  const bool by_bits = GENERATE(false, true);
  if (by_bits) bench.bus.flip(bench.now, {.id = 0, .mask = 0, .bit = 9999, .frames = 1});
  bench.fail_sending(0, 3);
  CHECK(bench.rec(1) == 3 - 1);  // Three errors, then the frame came through.
  CHECK(bench.rec(2) == 3 - 1);
  CHECK(bench.rec(0) == 0);
  bench.send(1, "080#");
  bench.run_bits(80);
  CHECK(bench.rec(1) == 2);  // What it sends does not count.
  CHECK(bench.rec(2) == 1);
  for (int i = 0; i < 4; ++i) {
    bench.send(0, "080#");
    bench.run_bits(80);
  }
  CHECK(bench.rec(1) == 0);
  CHECK(bench.rec(2) == 0);
}

TEST_CASE("Confinement: an error flag is six dominant bits, its frame is repeated after delimiter and space", "[bus]") {
  Bench bench{2};
  const std::size_t bit = first_bit_of("555#5555555555555555", Field::kData) + 3;
  bench.bus.flip(bench.now, {.id = 0, .mask = 0, .bit = bit, .frames = 1});
  bench.send(0, "555#5555555555555555");
  bench.run_bits(400);
  // The sender sees a bit error and signals at once; the receiver sees its sixth dominant bit in a row and answers:
  // here three flag bits later, as 0x55 alternates and the inverted bit makes a run of three. So flags of 6 and 6
  // overlap to 9 bits at most; the last of them ends what the delimiter counts from.
  REQUIRE(bench.log.deliveries.size() == 1);
  const std::vector<BusLog::Error> sender = bench.log.bus_errors(0);
  const std::vector<BusLog::Error> receiver = bench.log.bus_errors(1);
  REQUIRE(sender.size() == 1);
  REQUIRE(receiver.size() == 1);
  CHECK(sender[0].at == Instant{static_cast<std::int64_t>(bit + 1) * kBit});
  CHECK((sender[0].frame.bytes[2] & (CAN_ERR_PROT_BIT0 | CAN_ERR_PROT_BIT1)) != 0);
  CHECK(sender[0].frame.bytes[3] == CAN_ERR_PROT_LOC_DATA);
  CHECK(receiver[0].frame.bytes[2] == CAN_ERR_PROT_STUFF);
  CHECK(receiver[0].at > sender[0].at);
  CHECK(receiver[0].at <= sender[0].at + 6 * kBit);
  CHECK(bench.log.deliveries[0].started_at == receiver[0].at + (6 + 8 + 3) * kBit);
  CHECK(bench.rec(1) == 0);
  CHECK(bench.tec(0) == 7);
}

TEST_CASE("Confinement: a stuff error in the arbitration field does not count for the sender", "[bus]") {
  Bench bench{2};
  // 000#: SOF and four identifier bits are dominant, the fifth wire bit after them is a recessive stuff bit.
  bench.bus.flip(bench.now, {.id = 0, .mask = 0, .bit = 5, .frames = 1});
  bench.send(0, "000#");
  bench.run_bits(300);
  CHECK(bench.log.frames() == "000");
  REQUIRE(bench.log.bus_errors(0).size() == 1);
  CHECK((bench.log.bus_errors(0)[0].frame.bytes[2] & CAN_ERR_PROT_STUFF) != 0);
  CHECK(bench.log.bus_errors(0)[0].frame.bytes[6] == 0);
  CHECK(bench.tec(0) == 0);
}

TEST_CASE("Confinement: a recessive identifier bit seen dominant is lost arbitration, not an error", "[bus]") {
  Bench bench{2};
  bench.bus.flip(bench.now, {.id = 0, .mask = 0, .bit = 1, .frames = 1});
  bench.send(0, "555#");
  bench.run_bits(400);
  CHECK(bench.bus.node(0).counters().arbit_lost == 1);
  // Nobody goes on sending, so that six recessive bits follow: a stuff error of all, who are receivers now.
  CHECK(bench.tec(0) == 0);
  CHECK(bench.log.frames() == "555");
}

TEST_CASE("Confinement: dominant in the last bit of end of frame doubles the frame for its receivers", "[bus]") {
  Bench bench{2};
  bench.bus.flip(bench.now, {.id = 0, .mask = 0, .bit = end_of_frame_bit("123#AA", 7), .frames = 1});
  bench.send(0, "123#AA");
  bench.run_bits(400);
  REQUIRE(bench.log.deliveries.size() == 2);  // Valid for receivers at the sixth bit, an error for the sender.
  CHECK(bench.log.deliveries[0].sender == kNoNode);
  CHECK(bench.log.deliveries[1].sender == 0);
  CHECK(bench.tec(0) == 7);
  CHECK(bench.log.bus_errors(1).empty());  // An overload frame is no error.
  CHECK(bench.rec(1) == 0);
}

TEST_CASE("Confinement: an overload frame that others answer counts for nobody", "[bus]") {
  Bench bench{3};
  // Only node 1 hears the last bit dominant: its flag falls into the others' interframe space, they answer one bit
  // later.
  bench.bus.flip(bench.now, {.id = 0, .mask = 0, .bit = end_of_frame_bit("123#AA", 7), .frames = 1, .listener = 1});
  bench.send(0, "123#AA");
  bench.send(0, "124#AA");
  bench.run_bits(400);
  CHECK(bench.log.frames() == "123 124");
  // Flag 6 + 1 of the answers, delimiter 8, interframe space 3, instead of the 3 alone.
  CHECK(bench.log.deliveries[1].started_at == bench.log.deliveries[0].at + (7 + 8 + 3) * kBit);
  CHECK(bench.log.errors.empty());
  CHECK(bench.rec(1) == 0);
  CHECK(bench.rec(2) == 0);
  CHECK(bench.tec(0) == 0);
}

TEST_CASE("Confinement: dominant in the last but one bit of end of frame is a form error of all", "[bus]") {
  Bench bench{2};
  bench.bus.flip(bench.now, {.id = 0, .mask = 0, .bit = end_of_frame_bit("123#AA", 6), .frames = 1});
  bench.send(0, "123#AA");
  bench.run_bits(400);
  CHECK(bench.log.deliveries.size() == 1);
  REQUIRE(bench.log.bus_errors(1).size() == 1);
  CHECK(bench.log.bus_errors(1)[0].frame.bytes[2] == CAN_ERR_PROT_FORM);
  CHECK(bench.log.bus_errors(1)[0].frame.bytes[3] == CAN_ERR_PROT_LOC_EOF);
}

TEST_CASE("Confinement: recovery takes exactly 128 x 11 recessive bits", "[bus]") {
  Bench bench{2, Nanos{0}};
  bench.run_bits(10);
  bench.bus.force_bus_off(bench.now, 0);
  CHECK(bench.state(0) == ErrorState::kBusOff);
  bench.run_bits(1407);
  CHECK(bench.state(0) == ErrorState::kBusOff);
  bench.run_bits(1);
  CHECK(bench.state(0) == ErrorState::kActive);
  CHECK(bench.tec(0) == 0);
  CHECK(bench.log.states.back() == BusLog::State{Instant{(10 + 1408) * kBit}, 0, ErrorState::kActive});
  bench.send(0, "080#");
  bench.run_bits(60);
  CHECK(bench.log.frames() == "080");
}

TEST_CASE("Confinement: bits of a frame do not count for the recovery, the eleven recessive at its end do", "[bus]") {
  Bench bench{3, Nanos{0}};
  bench.bus.force_bus_off(bench.now, 0);
  // One frame: 44 bits to the acknowledge slot (with stuff bits), then 1 + 7 + 3 recessive: one of the 128.
  bench.send(1, "080#");
  bench.run_bits(51 + 127 * 11 - 1);
  CHECK(bench.state(0) == ErrorState::kBusOff);
  bench.run_bits(1);
  CHECK(bench.state(0) == ErrorState::kActive);
}

TEST_CASE("Confinement: bus-off lasts for restart-ms before the recovery, or until it is restarted by hand", "[bus]") {
  SECTION("restart-ms") {
    Bench bench{2, 100ms};
    bench.bus.force_bus_off(bench.now, 0);
    bench.run_bits(100ms / kBit + 1407);
    CHECK(bench.state(0) == ErrorState::kBusOff);
    bench.run_bits(1);
    CHECK(bench.state(0) == ErrorState::kActive);
    CHECK(bench.bus.node(0).counters().re_started == 1);
  }
  SECTION("by hand") {
    Bench bench{2};
    bench.bus.force_bus_off(bench.now, 0);
    bench.run_bits(100'000);
    CHECK(bench.state(0) == ErrorState::kBusOff);
    CHECK(bench.bus.next_event() == Instant::never());
    bench.bus.restart(bench.now, 0);
    bench.run_bits(1408);
    CHECK(bench.state(0) == ErrorState::kActive);
  }
}

TEST_CASE("Confinement: an error-passive sender lets others go first for eight bits", "[bus]") {
  Bench bench{3};
  bench.fail_sending(0, 20);
  REQUIRE(bench.state(0) == ErrorState::kPassive);
  bench.run_bits(500);
  bench.log.deliveries.clear();
  const Instant start = bench.now;
  bench.send(0, "001#");
  bench.send(0, "002#");
  bench.run_bits(10);
  bench.send(1, "700#");
  bench.run_bits(300);
  CHECK(bench.log.frames() == "001 700 002");
  // Alone it waits for the eight bits.
  bench.log.deliveries.clear();
  bench.send(0, "001#");
  bench.send(0, "002#");
  bench.run_bits(300);
  REQUIRE(bench.log.deliveries.size() == 2);
  CHECK(bench.log.deliveries[1].started_at == bench.log.deliveries[0].at + (3 + 8) * kBit);
  CHECK(start < bench.now);
}

TEST_CASE("Confinement: a receiver that alone sees an error counts one for it, and eight when the others answer",
          "[bus]") {
  Bench bench{3};
  // 2AA# alternates: one inverted bit makes a run of three, so that its flag is the first thing the others object to.
  bench.bus.flip(bench.now, {.id = 0, .mask = 0, .bit = 26, .frames = 1, .listener = 2});
  bench.send(0, "2AA#0000000000000000");
  bench.run_bits(400);
  CHECK(bench.log.frames() == "2AA");
  CHECK(bench.log.bus_errors(2).size() == 1);
  CHECK(bench.rec(2) == 1 + 8 - 1);
  CHECK(bench.rec(1) == 1 - 1);
  CHECK(bench.tec(0) == 8 - 1);
}

TEST_CASE("Confinement: a passive receiver's flag of six recessive bits does not disturb the frame", "[bus]") {
  Bench bench{3};
  // Every try of the frame makes node 2 count nine until it is passive; then it cannot stop the frame any more.
  bench.bus.flip(bench.now, {.id = 0, .mask = 0, .bit = 26, .frames = 1000, .listener = 2});
  bench.send(0, "2AA#0000000000000000");
  bench.run_bits(3000);
  CHECK(bench.log.bus_errors(2).size() == 15 + 1);  // 15 x 9 = 135 is passive.
  CHECK(bench.bus.node(0).counters().bus_errors == 15);
  CHECK(bench.state(2) == ErrorState::kPassive);
  REQUIRE(bench.log.frames() == "2AA");
  CHECK(bench.log.deliveries[0].receivers == 0b010);
  CHECK(bench.tec(0) == 15 * 8 - 1);
}

TEST_CASE("Confinement: a check sum error of one receiver is signalled behind the acknowledge delimiter", "[bus]") {
  Bench bench{3};
  const std::size_t bit = first_bit_of("123#55", Field::kCrc) + 4;
  bench.bus.flip(bench.now, {.id = 0, .mask = 0, .bit = bit, .frames = 1, .listener = 2});
  bench.send(0, "123#55");
  bench.run_bits(300);
  const auto errors = bench.log.bus_errors(2);
  REQUIRE(errors.size() == 1);
  CHECK(errors[0].frame.bytes[2] == CAN_ERR_PROT_UNSPEC);
  CHECK(errors[0].frame.bytes[3] == CAN_ERR_PROT_LOC_CRC_SEQ);
  const std::size_t delimiter = first_bit_of("123#55", Field::kAckDelimiter);
  CHECK(errors[0].at == Instant{static_cast<std::int64_t>(delimiter + 1) * kBit});
  // The others see its flag in their end of frame.
  REQUIRE(bench.log.bus_errors(1).size() == 1);
  CHECK(bench.log.bus_errors(1)[0].frame.bytes[2] == CAN_ERR_PROT_FORM);
  CHECK(bench.log.bus_errors(1)[0].frame.bytes[3] == CAN_ERR_PROT_LOC_EOF);
  CHECK(bench.log.frames() == "123");
}

TEST_CASE("Confinement: a sender that does not hear its acknowledgement repeats the frame", "[bus]") {
  Bench bench{2};
  const std::size_t bit = first_bit_of("123#55", Field::kAck);
  bench.bus.flip(bench.now, {.id = 0, .mask = 0, .bit = bit, .frames = 1, .listener = 0});
  bench.send(0, "123#55");
  bench.run_bits(300);
  REQUIRE(bench.log.bus_errors(0).size() == 1);
  CHECK((bench.log.bus_errors(0)[0].frame.id & CAN_ERR_ACK) != 0);
  CHECK(bench.tec(0) == 7);
  CHECK(bench.log.frames() == "123");
}

TEST_CASE("Confinement: a receiver at half the bit rate destroys frames until it is passive, then not any more",
          "[bus]") {
  Bench bench{4};
  bench.bus.set_bit_rate_divider(bench.now, 3, 2);
  for (int i = 0; i < 40; ++i) {
    bench.send(0, "2AA#AAAAAAAAAAAAAAAA");  // Every other bit of it makes six dominant ones in a row.
    bench.run_bits(1000);
  }
  CHECK(bench.bus.node(0).counters().bus_errors > 10);
  CHECK(bench.state(3) == ErrorState::kPassive);
  CHECK(bench.state(1) == ErrorState::kActive);
  CHECK(bench.log.deliveries.size() == 40);
  CHECK(bench.log.deliveries.back().receivers == 0b0110);
}

TEST_CASE("Confinement: a wire held dominant counts eight for every eight bits, and nobody goes bus-off by receiving",
          "[bus]") {
  Bench bench{2};
  bench.run_bits(20);
  bench.bus.set_wire(bench.now, WireState::kStuckDominant);
  // Start of frame and five more: stuff error (1), flag of six, then dominant: 8 at the first, 8 at the 8th, 16th ...
  bench.run_bits(6);
  CHECK(bench.rec(0) == 1);
  bench.run_bits(6);
  CHECK(bench.rec(0) == 1);
  bench.run_bits(1);
  CHECK(bench.rec(0) == 9);
  bench.run_bits(6);
  CHECK(bench.rec(0) == 9);
  bench.run_bits(1);
  CHECK(bench.rec(0) == 17);
  bench.run_bits(8);
  CHECK(bench.rec(0) == 25);
  bench.run_bits(100'000);
  CHECK(bench.state(0) == ErrorState::kPassive);
  bench.bus.set_wire(bench.now, WireState::kGood);
  bench.run_bits(100);
  bench.send(1, "123#");
  bench.run_bits(100);
  CHECK(bench.log.frames() == "123");
  CHECK(bench.rec(0) == 119);
  CHECK(bench.state(0) == ErrorState::kActive);
}

TEST_CASE("Confinement: a sender on a wire held dominant goes bus-off", "[bus]") {
  Bench bench{2};
  bench.send(0, "123#FFFFFFFFFFFFFFFF");
  bench.run_bits(30);
  bench.bus.set_wire(bench.now, WireState::kStuckDominant);
  for (int i = 0; i < 20 && bench.tec(0) == 0; ++i)
    bench.run_bits(1);  // To the first recessive bit of the data, which comes out dominant.
  CHECK(bench.tec(0) == 8);
  bench.run_bits(6 + 8 - 1);
  CHECK(bench.tec(0) == 8);
  bench.run_bits(1);  // The eighth dominant bit after its flag.
  CHECK(bench.tec(0) == 16);
  bench.run_bits(30 * 8 - 1);
  CHECK(bench.state(0) == ErrorState::kPassive);
  bench.run_bits(1);
  CHECK(bench.state(0) == ErrorState::kBusOff);
  CHECK(bench.state(1) == ErrorState::kPassive);
}

TEST_CASE("Confinement: on shorted wires every sender goes bus-off within 150 bits", "[bus]") {
  Bench bench{2};
  bench.bus.set_wire(bench.now, WireState::kShorted);
  bench.send(0, "123#");
  // Start bit (8) and each bit of the active flag after it (8 each) count to 128 in 16 bits; then 16 tries of one bit,
  // passive flag 6, delimiter 8, space 3 and suspension 8.
  bench.run_bits(16 + 6 + 8 + 3 + 8 + 15 * (1 + 6 + 8 + 3 + 8) + 1);
  CHECK(bench.state(0) == ErrorState::kBusOff);
  CHECK(bench.state(1) == ErrorState::kActive);
  CHECK(bench.rec(1) == 0);
}

TEST_CASE("Confinement: two senders of one identifier collide in their first different bit", "[bus]") {
  Bench bench{3};
  bench.send(0, "185#11");
  bench.send(1, "185#12");
  bench.run_bits(20'000);
  CHECK(bench.bus.node(0).counters().bus_errors + bench.bus.node(1).counters().bus_errors > 10);
  // 11 is less than 12 in the bit where they differ: the sender of 12 sends recessive and sees dominant.
  CHECK(bench.bus.node(1).counters().bus_errors >= 1);
}

TEST_CASE("Bit-timed bus: two equal frames of two senders cross as one", "[bus]") {
  Bench bench{3};
  bench.send(0, "185#11");
  bench.send(1, "185#11");
  bench.run_bits(200);
  CHECK(bench.log.frames() == "185");
  CHECK(bench.log.errors.empty());
  CHECK(bench.log.deliveries[0].receivers == 0b100);
  CHECK(bench.bus.node(0).counters().tx_packets == 1);
  CHECK(bench.bus.node(1).counters().tx_packets == 1);
}

TEST_CASE("Bit-timed bus: a babbling node takes all that its priority leaves", "[bus]") {
  Bench bench{3};
  bench.bus.set_babble(bench.now, 2, frame("001#"));
  bench.send(0, "123#");
  bench.run_bits(10'000);
  CHECK(bench.bus.node(2).counters().tx_packets > 150);
  CHECK(bench.bus.node(0).counters().tx_packets == 0);
  bench.send(0, "000#");
  bench.bus.set_babble(bench.now, 2, {});
  bench.run_bits(500);
  CHECK(bench.bus.node(0).counters().tx_packets == 2);
}

TEST_CASE("Bit-timed bus: a node cut off is alone, the others go on", "[bus]") {
  Bench bench{3};
  bench.bus.set_cut_off(bench.now, 0, true);
  bench.send(0, "080#");
  bench.send(1, "123#");
  bench.run_bits(10'000);
  CHECK(bench.log.frames() == "123");
  CHECK(bench.log.deliveries[0].receivers == 0b100);
  CHECK(bench.state(0) == ErrorState::kPassive);
  CHECK(bench.tec(1) == 0);
  bench.bus.set_cut_off(bench.now, 0, false);
  bench.run_bits(500);
  CHECK(bench.log.frames() == "123 080");
}

TEST_CASE("Bit-timed bus: a node without power neither sends nor acknowledges", "[bus]") {
  Bench bench{2};
  bench.bus.set_powered(bench.now, 1, false);
  bench.send(0, "080#");
  bench.run_bits(500);
  CHECK(bench.log.deliveries.empty());
  CHECK(bench.tec(0) > 0);
  CHECK_FALSE(bench.bus.send(bench.now, 1, frame("123#")));
  bench.bus.set_powered(bench.now, 1, true);
  bench.run_bits(500);
  CHECK(bench.log.frames() == "080");
}

TEST_CASE("Bit-timed bus: noise hits as often as its rate says, and the same seed hits the same frames", "[bus]") {
  const auto run = [](std::uint64_t seed) {
    Bench bench{2};
    bench.bus.set_noise(bench.now, 1e-3, seed);
    for (int i = 0; i < 2000; ++i) {
      bench.send(0, "555#5555555555555555");
      bench.run_bits(300);
    }
    return std::pair{bench.bus.node(0).counters().bus_errors, bench.log.deliveries.back().at};
  };
  const auto first = run(1);
  CHECK(first == run(1));
  CHECK(first != run(2));
  // 2000 frames of 108 bits at 10^-3 and some repetitions: 0.12 errors a frame, sigma of their number about 16.
  CHECK(first.first > 150);
  CHECK(first.first < 330);
}
