#include "protocols/can/frame_length.hpp"

#include <catch2/catch.hpp>
#include <fstream>
#include <random>
#include <sstream>

#include "protocols/can/candump.hpp"
#include "protocols/can/frame_bits.hpp"
#include "tests/protocols/can/bit_encoder.hpp"

using namespace meltbench;
using namespace meltbench::can;

namespace {

/// Any frame that can be on a bus. Every fourth one has bytes and identifier of few changes, so that stuffing is hit.
CanFrame draw_frame(std::mt19937_64& random) {
  const std::uint64_t draw = random();
  CanFrame frame;
  frame.extended = (draw & 1U) != 0;
  frame.fd = (draw & 2U) != 0;
  frame.brs = frame.fd && (draw & 4U) != 0;
  frame.esi = frame.fd && (draw & 8U) != 0;
  frame.id = static_cast<std::uint32_t>(random()) & (frame.extended ? kMaxExtendedId : kMaxStandardId);
  if (!frame.fd && (draw & 0xF0U) == 0) frame.kind = FrameKind::kRemote;
  const unsigned code = static_cast<unsigned>(draw >> 8U) & 0xFU;
  frame.length = length_of_code(code, frame.fd);
  if (!frame.fd && code > 8) frame.raw_dlc = static_cast<std::uint8_t>(code);
  const bool flat = (draw & 0x300000U) == 0;
  const std::uint8_t fill = (draw & 0x400000U) != 0 ? 0xFF : 0x00;
  if (flat) frame.id = fill == 0 ? frame.id & 7U : frame.id | 0x7F8U;
  for (std::size_t i = 0; i < frame.data().size(); ++i) {
    frame.bytes[i] = flat ? fill : static_cast<std::uint8_t>(random());
  }
  return frame;
}

std::string to_text(const FrameBits& bits) {
  std::string text;
  for (const WireBit& bit : bits.bits()) text += bit.recessive ? '1' : '0';
  return text;
}

}  // namespace

TEST_CASE("Frame length: a million random frames are as long as an independent encoder makes them", "[can]") {
  std::mt19937_64 random{5};
  std::size_t different = 0;
  for (int i = 0; i < 1'000'000; ++i) {
    const CanFrame frame = draw_frame(random);
    const test::EncodedFrame expected = test::encode_bit_by_bit(frame);
    const FrameLength length = calc_frame_length(frame);
    if (length.data_bits != expected.data_rate_bits ||
        static_cast<std::size_t>(length.nominal_bits + length.data_bits) != expected.bits.size()) {
      UNSCOPED_INFO(to_candump(frame) << ": " << length.nominal_bits << " + " << length.data_bits << " bits, not "
                                      << expected.bits.size());
      if (++different > 5) break;
    }
  }
  CHECK(different == 0);
}

TEST_CASE("Frame bits: what crosses the wire is what an independent encoder says, bit for bit", "[can]") {
  std::mt19937_64 random{6};
  FrameBits bits;
  for (int i = 0; i < 20'000; ++i) {
    const CanFrame frame = draw_frame(random);
    encode_frame(frame, bits);
    INFO(to_candump(frame));
    REQUIRE(to_text(bits) == test::encode_bit_by_bit(frame).bits);
  }
}

TEST_CASE("Frame length: no frame is longer than the bound of its format", "[can]") {
  std::mt19937_64 random{7};
  for (int i = 0; i < 200'000; ++i) {
    const CanFrame frame = draw_frame(random);
    const FrameLength length = calc_frame_length(frame);
    const FrameLength longest = calc_longest_frame(frame);
    if (length.nominal_bits > longest.nominal_bits || length.data_bits > longest.data_bits) {
      FAIL(to_candump(frame) << ": " << length.nominal_bits << " + " << length.data_bits << " bits, bound "
                             << longest.nominal_bits << " + " << longest.data_bits);
    }
  }
  // Davis et al. 2007, Eq. (1): 55 + 10 n with 3 bits of interframe space, 80 + 10 n extended.
  CHECK(calc_longest_frame(*parse_candump("000#0000000000000000")).nominal_bits + 3 == 135);
  CHECK(calc_longest_frame(*parse_candump("00000000#0000000000000000")).nominal_bits + 3 == 160);
}

TEST_CASE("Frame length: frames as can-utils counts them", "[can]") {
  // Rows "frame,bits": exact lengths with interframe space by can-utils' canframelen.c, CFL_EXACT, see the file's head.
  std::ifstream table{MELTBENCH_SOURCE_DIR "/fixtures/reference/can_frame_length.csv"};
  REQUIRE(table);
  std::string line;
  int rows = 0;
  while (std::getline(table, line)) {
    if (line.starts_with('#') || line.starts_with("frame")) continue;
    std::istringstream row{line};
    std::string text;
    unsigned bits = 0;
    std::getline(row, text, ',');
    row >> bits;
    const auto frame = parse_candump(text.substr(1, text.size() - 2));
    REQUIRE(frame);
    INFO(text);
    REQUIRE(calc_frame_length(*frame).nominal_bits + kIntermissionBits == bits);
    ++rows;
  }
  CHECK(rows > 1000);
}

TEST_CASE("Arbitration key: orders frames as the bits of their arbitration fields do", "[can]") {
  const auto key = [](const char* text) { return arbitration_key(*parse_candump(text)); };
  CHECK(key("123#00") < key("124#00"));
  CHECK(key("123#00") < key("123#R"));            // Data before remote.
  CHECK(key("123#R") < key("048C0000#00"));       // Standard before extended with the same base, remote or not.
  CHECK(key("048C0000#00") < key("124#00"));      // The base decides first.
  CHECK(key("048C0001#00") > key("048C0000#R"));  // Extended part before RTR,
  CHECK(key("048C0000#00") < key("048C0000#R"));  // which comes last.
  CHECK(key("123##0") == key("123#00"));          // FD and classic differ only behind the arbitration field.
}
