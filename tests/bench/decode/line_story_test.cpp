#include "bench/decode/line_story.hpp"

#include <catch2/catch.hpp>
#include <random>

#include "protocols/config/toml.hpp"
#include "protocols/modbus/pdu.hpp"

using namespace meltbench;
using namespace meltbench::decode;
using Catch::Contains;

namespace {

using Bytes = std::vector<std::uint8_t>;

Bytes frame(std::uint8_t unit, std::span<const std::uint8_t> pdu) {
  Bytes bytes;
  modbus::append_frame(unit, pdu, bytes);
  return bytes;
}

const Bytes kAsk = frame(1, modbus::make_read(modbus::Function::kReadInputRegisters, 0, 2).bytes());
const Bytes kAnswer = frame(1, Bytes{4, 4, 0, 1, 0, 2});

/// A line on which unit 1 is asked every 20 ms.
struct Dosing {
  void talk(Instant from, Instant to, bool answers = true) {
    for (Instant at = from; at < to; at += 20ms) {
      story.take(at, "dosing", kAsk);
      if (answers) story.take(at + 5ms, "dosing", kAnswer);
    }
  }
  std::vector<std::string> tell(Instant end) {
    story.finish(end);
    std::vector<std::string> lines;
    for (const LineFinding& finding : story.findings()) lines.push_back(finding.text);
    return lines;
  }

  config::Section root{config::read_toml_file(std::string{MELTBENCH_SOURCE_DIR} + "/fixtures/rigs/bizone_serial.toml")};
  config::Rig rig = config::read_rig(root);
  LineStory story{rig};
};

}  // namespace

TEST_CASE("Line story: a poll that is answered every time is one line, with its name and period", "[decode]") {
  Dosing line;
  line.talk(Instant{}, Instant{2s});
  const auto told = line.tell(Instant{2s});
  REQUIRE(told.size() == 1);
  CHECK(told[0] == "dosing: feeder is asked to read 2 input registers from 0, 100 times to 1.980000 s, every 20 ms");
}

TEST_CASE("Line story: who does not answer is told from the first request to the next answer", "[decode]") {
  Dosing line;
  line.talk(Instant{}, Instant{1s});
  line.talk(Instant{1s}, Instant{2s}, false);
  line.talk(Instant{2s}, Instant{3s});
  const auto told = line.tell(Instant{3s});
  REQUIRE(told.size() == 2);
  CHECK(told[1] == "dosing: feeder does not answer 50 requests, to 2.005000 s");
  CHECK(line.story.findings()[1].at == Instant{1s});
}

TEST_CASE("Line story: an answer that does not fit, or whose checksum is wrong, is no answer and no frame",
          "[decode]") {
  Dosing line;
  line.talk(Instant{}, Instant{1s});
  Bytes wrong = kAnswer;
  wrong[4] ^= 1;
  for (int i = 0; i < 3; ++i) {
    line.story.take(Instant{1s + i * 20ms}, "dosing", kAsk);
    line.story.take(Instant{1s + i * 20ms + 5ms}, "dosing", wrong);
  }
  const auto told = line.tell(Instant{1060ms});
  REQUIRE(told.size() == 2);
  CHECK(told[1] == "dosing: 9 bytes that are no frame: cut short, or a wrong checksum; 3 of them to 1.045000 s");
}

TEST_CASE("Line story: a request and its answer in one piece are two frames", "[decode]") {
  Dosing line;
  Bytes both = kAsk;
  both.insert(both.end(), kAnswer.begin(), kAnswer.end());
  for (int i = 0; i < 10; ++i) line.story.take(Instant{i * 20ms}, "dosing", both);
  const auto told = line.tell(Instant{200ms});
  REQUIRE(told.size() == 1);
  CHECK_THAT(told[0], Contains("10 times"));
}

TEST_CASE("Line story: a refusal says of what, and why", "[decode]") {
  Dosing line;
  const Bytes ask = frame(1, modbus::make_write_register(99, 7).bytes());
  const Bytes refusal = frame(1, Bytes{6 | modbus::kExceptionBit, 2});
  for (int i = 0; i < 3; ++i) {
    line.story.take(Instant{i * 20ms}, "dosing", ask);
    line.story.take(Instant{i * 20ms + 5ms}, "dosing", refusal);
  }
  const auto told = line.tell(Instant{100ms});
  REQUIRE(told.size() == 2);
  CHECK_THAT(told[1], Contains("feeder refuses to write register 99: illegal address; 3 of them"));
}

TEST_CASE("Line story: silence of a line that used to be busy is told, also to the end", "[decode]") {
  Dosing line;
  line.talk(Instant{}, Instant{1s});
  line.talk(Instant{3s}, Instant{4s});
  const auto told = line.tell(Instant{10s});
  REQUIRE(told.size() == 3);
  CHECK(told[1] == "dosing: silence from here to 3.000000 s, 2.015 s");
  CHECK(told[2] == "dosing: silence from here to the end of the log, 6.015 s");
}

TEST_CASE("Line story: a unit that the rig does not have, and one that is not the first of its board, have a name",
          "[decode]") {
  Dosing line;
  const Bytes ask = frame(9, modbus::make_read(modbus::Function::kReadHoldingRegisters, 5, 1).bytes());
  line.story.take(Instant{}, "elsewhere", ask);
  line.story.take(Instant{}, "dosing", ask);
  const auto told = line.tell(Instant{10ms});
  REQUIRE(told.size() == 2);
  CHECK(told[0] == "elsewhere: unit 9 is asked to read 1 holding register from 5");
  CHECK(told[1] == "dosing: feeder (unit 9) is asked to read 1 holding register from 5");
}

TEST_CASE("Line story: frames of any content and length are told, with a good checksum or without", "[decode]") {
  std::minstd_rand random{7};
  Dosing line;
  Instant at{};
  for (int i = 0; i < 20'000; ++i) {
    Bytes bytes(1 + random() % 12);
    for (std::uint8_t& byte : bytes) byte = static_cast<std::uint8_t>(random() % 4 == 0 ? random() : random() % 24);
    at += 5ms;
    line.story.take(at, "dosing", random() % 8 == 0 ? bytes : frame(static_cast<std::uint8_t>(random() % 3), bytes));
  }
  CHECK(line.tell(at).size() > 100);
}
