#include "bench/decode/line_trouble.hpp"

#include <catch2/catch.hpp>
#include <filesystem>

#include "bench/decode/extraction.hpp"
#include "bench/scenario/scenario.hpp"

using namespace meltbench;
using namespace meltbench::decode;

namespace {

constexpr Instant kStart{};
using Bytes = std::vector<std::uint8_t>;

/// Two lines; "zones" has 19200 baud, 8E1.
const config::Rig& rig() {
  static const scenario::ResolvedRun run = [] {
    const auto folder = std::filesystem::path{MELTBENCH_SOURCE_DIR} / "fixtures/scenarios";
    return std::move(scenario::load(folder / "coupled_serial.toml").front());
  }();
  return run.rig;
}

const Bytes kRequest{0x0B, 0x03, 0x00, 0x00, 0x00, 0x06, 0xC5, 0x62};
const Bytes kAnswer{0x0B, 0x03, 0x0C, 0x05, 0xAA, 0x05, 0xAA, 0x01, 0x25,
                    0x00, 0x03, 0x00, 0x00, 0x00, 0x01, 0x90, 0xD8};

Bytes with_wrong_bit(Bytes bytes) {
  bytes[3] ^= 0x10U;
  return bytes;
}

/// Polls every 50 ms from 0 to 1 s, as `answer` has it.
template <typename Answer>
LineReport listen(const Answer& answer) {
  LineListener listener{rig()};
  for (Nanos at{}; at < 1s; at += 50ms) {
    listener.take(kStart + at + 5ms, "zones", "controller", kRequest);
    const Bytes bytes = answer(at);
    if (!bytes.empty()) listener.take(kStart + at + 20ms, "zones", "plant", bytes);
  }
  for (LineReport& report : listener.finish()) {
    if (report.line == "zones") return report;
  }
  return {};
}

}  // namespace

TEST_CASE("a line on which every checksum is right has no trouble", "[decode]") {
  const LineReport report = listen([](Nanos) { return kAnswer; });
  CHECK(report.troubles.empty());
  CHECK(report.garbled == 0);
}

TEST_CASE("an answer with a wrong bit is garbled from before its first byte was sent", "[decode]") {
  const LineReport report = listen([](Nanos at) { return at == 500ms ? with_wrong_bit(kAnswer) : kAnswer; });
  REQUIRE(report.troubles.size() == 1);
  CHECK(report.troubles[0].kind == LineTrouble::Kind::kGarbled);
  // 17 characters of 11 bits at 19200 bit/s take 9.74 ms; the request ended at 505 ms.
  CHECK(report.troubles[0].at > kStart + 505ms);
  CHECK(report.troubles[0].at < kStart + 520ms - 9740us);
  CHECK(report.troubles[0].until > kStart + 520ms - 9740us);
  CHECK(report.garbled == 1);
}

TEST_CASE("garbled pieces without a good one between them are one trouble", "[decode]") {
  LineListener listener{rig()};
  listener.take(kStart + 5ms, "zones", "controller", with_wrong_bit(kRequest));
  listener.take(kStart + 60ms, "zones", "controller", with_wrong_bit(kRequest));
  listener.take(kStart + 120ms, "zones", "controller", kRequest);
  for (const LineReport& report : listener.finish()) {
    if (report.line == "zones") CHECK(report.troubles.size() == 1);
  }
}

TEST_CASE("three requests without an answer are a plug that was out, from the first to before the next answer",
          "[decode]") {
  const LineReport report = listen([](Nanos at) { return at >= 300ms && at < 600ms ? Bytes{} : kAnswer; });
  REQUIRE(report.troubles.size() == 1);
  CHECK(report.troubles[0].kind == LineTrouble::Kind::kSilent);
  CHECK(report.troubles[0].at == kStart + 305ms);
  CHECK(report.troubles[0].until > kStart + 600ms);
  CHECK(report.troubles[0].until < kStart + 620ms);
  CHECK(report.silent == 6);
  CHECK(listen([](Nanos at) { return at == 300ms ? Bytes{} : kAnswer; }).troubles.empty());
}

TEST_CASE("the share of wrong bytes follows from the share of frames that are garbled", "[decode]") {
  // Every second answer of those between the first and the last: 1 of 4 frames, of 12.5 bytes on the average.
  const LineReport report = listen([](Nanos at) { return (at / 50ms) % 2 == 0 ? with_wrong_bit(kAnswer) : kAnswer; });
  CHECK(report.garbled == 10);
  CHECK(report.byte_share == Approx(1 - std::pow(0.75, 1 / 12.5)).epsilon(0.1));
}

TEST_CASE("errors that the controller rode through are one fault of chance, others are repeated one by one",
          "[decode]") {
  const LineReport report = listen([](Nanos at) { return (at / 50ms) % 4 == 1 ? with_wrong_bit(kAnswer) : kAnswer; });
  Extraction calm;
  add_line_faults(calm, std::vector{report}, kStart + 2s);
  CHECK(calm.faults.size() == 1);
  Extraction lets_go;
  lets_go.reactions.push_back({Reaction::Kind::kSafeState, kStart + 900ms, 0, 0, 0, 0, {}});
  add_line_faults(lets_go, std::vector{report}, kStart + 2s);
  CHECK(lets_go.faults.size() == report.troubles.size());
  CHECK(report.troubles.size() == 5);
}
