#include <zlib.h>

#include <catch2/catch.hpp>
#include <filesystem>
#include <fstream>
#include <random>

#include "bench/log/asc_reader.hpp"
#include "bench/log/log_error.hpp"
#include "bench/log/log_reader.hpp"
#include "bench/log/log_writer.hpp"
#include "tests/tools/temporary_folder.hpp"

using namespace meltbench;
using namespace meltbench::log;
using Catch::Matchers::Contains;

namespace {

struct Log {
  std::vector<LogEntry> entries;
  std::vector<std::string> channels;
  std::vector<LogWarning> warnings;
  std::uint64_t dropped = 0;
};

Log read_all(std::unique_ptr<LogReader> reader) {
  Log log;
  LogEntry entry;
  while (reader->next(entry)) log.entries.push_back(entry);
  log.channels = reader->channels();
  log.warnings = reader->warnings();
  log.dropped = reader->dropped();
  return log;
}

Log read_text(std::string_view text) {
  return read_all(open_log(std::make_unique<MemorySource>(std::span{text.data(), text.size()}, "some.log")));
}

/// What a reader says of a text that it refuses.
std::string complaint_about(std::string_view text) {
  try {
    static_cast<void>(read_text(text));
  } catch (const LogError& error) {
    CHECK_FALSE(error.hint().empty());
    return error.what();
  }
  return "no complaint";
}

can::CanFrame make_random_frame(std::mt19937& draw) {
  can::CanFrame frame;
  frame.extended = draw() % 2 == 0;
  frame.id = static_cast<std::uint32_t>(draw()) & (frame.extended ? can::kMaxExtendedId : can::kMaxStandardId);
  const auto kind = draw() % 8;
  if (kind == 0) {
    frame.kind = can::FrameKind::kRemote;
    frame.length = static_cast<std::uint8_t>(draw() % 9);
    return frame;
  }
  if (kind == 1) {
    frame.fd = true;
    frame.brs = draw() % 2 == 0;
    frame.esi = draw() % 2 == 0;
    frame.length = can::round_up_to_fd_length(draw() % 65);
  } else {
    frame.length = static_cast<std::uint8_t>(draw() % 9);
  }
  for (std::size_t i = 0; i < frame.length; ++i) frame.bytes[i] = static_cast<std::uint8_t>(draw());
  return frame;
}

std::vector<LogEntry> make_random_log(Instant start, std::size_t count) {
  std::mt19937 draw{11};
  std::vector<LogEntry> entries;
  Instant at = start;
  for (std::size_t i = 0; i < count; ++i) {
    at += Nanos{1000} * static_cast<std::int64_t>(draw() % 5000);
    entries.push_back({at, draw() % 2, Direction::kReceived, make_random_frame(draw)});
  }
  return entries;
}

void write_all(const std::filesystem::path& path, const std::vector<LogEntry>& entries) {
  auto writer = create_log(create_file(path), format_by_name(path));
  for (const LogEntry& entry : entries) writer->write(entry, entry.channel == 0 ? "can0" : "can1");
  writer->finish();
}

/// The frames of two logs, their instants and channels by name.
void require_equal(const Log& log, const std::vector<LogEntry>& expected, std::array<std::string, 2> names) {
  REQUIRE(log.entries.size() == expected.size());
  for (std::size_t i = 0; i < expected.size(); ++i) {
    INFO("frame " << i);
    REQUIRE(log.entries[i].at == expected[i].at);
    REQUIRE(log.entries[i].frame == expected[i].frame);
    REQUIRE(log.channels[log.entries[i].channel] == names[expected[i].channel]);
  }
}

constexpr Instant kMarch2026{Nanos{1'772'368'496'789'123'000}};  // 2026-03-01 12:34:56.789123 UTC.

}  // namespace

TEST_CASE("Logs: every format gives back what was written, whole microseconds, both channels, all kinds of frames",
          "[log]") {
  const test::TemporaryFolder folder;
  const char* name = GENERATE("a.log", "a.log.gz", "a.asc", "a.asc.gz", "a.blf");
  const Instant start = GENERATE(Instant{}, kMarch2026);
  const std::vector<LogEntry> entries = make_random_log(start, 5000);
  write_all(folder / name, entries);
  const Log log = read_all(open_log(folder / name));
  const bool has_names = std::string_view{name}.find(".log") != std::string_view::npos;
  require_equal(log, entries,
                has_names ? std::array<std::string, 2>{"can0", "can1"} : std::array<std::string, 2>{"1", "2"});
  CHECK(log.warnings.empty());
}

TEST_CASE("Logs: an error frame keeps its class in candump text and BLF, and is a bus error in ASC", "[log]") {
  const test::TemporaryFolder folder;
  can::CanFrame error;
  error.kind = can::FrameKind::kError;
  error.id = 0x204;
  error.length = 8;
  error.bytes[1] = 0x10;
  error.bytes[6] = 136;
  for (const char* name : {"a.log", "a.blf", "a.asc"}) {
    INFO(name);
    write_all(folder / name, {{kMarch2026, 0, Direction::kUnknown, error}});
    const Log log = read_all(open_log(folder / name));
    REQUIRE(log.entries.size() == 1);
    if (std::string_view{name} == "a.asc") {
      CHECK(log.entries[0].frame.kind == can::FrameKind::kError);
      CHECK(log.entries[0].frame.id == 0x80);
    } else {
      CHECK(log.entries[0].frame == error);
    }
  }
}

TEST_CASE("Logs: candump text of all its versions is read", "[log]") {
  const Log log = read_text(
      "# bit rate 500000\r\n"
      "(1.000001) can0 123#11.22\r\n"
      "(1.500000002) vcan7 12345678#R8 T\n"
      "\n"
      "DROPCOUNT: dropped 12 CAN frames on 'can0' socket (total drops 12)\n"
      "(2.000000) can0 005##3AABB R\n"
      "(3.000000) can0 20000080#0000000000000000\n");
  REQUIRE(log.entries.size() == 4);
  CHECK(log.entries[0].at == Instant{Nanos{1'000'001'000}});
  CHECK(log.entries[0].frame == can::make_frame(0x123, {0x11, 0x22}));
  CHECK(log.entries[1].at == Instant{Nanos{1'500'000'002}});
  CHECK(log.entries[1].direction == Direction::kSent);
  CHECK(log.channels == std::vector<std::string>{"can0", "vcan7"});
  CHECK(log.entries[2].frame.brs);
  CHECK(log.entries[2].direction == Direction::kReceived);
  CHECK(log.entries[3].frame.kind == can::FrameKind::kError);
  CHECK(log.dropped == 12);
  REQUIRE(log.warnings.size() == 1);
  CHECK(log.warnings[0].line == 5);
}

TEST_CASE("Logs: nonsense is refused with file, line and what is wrong", "[log]") {
  CHECK_THAT(complaint_about("(1.000000) can0 123#11\n(1.0) can0 123#\n"), Contains("some.log:2:2: time stamp"));
  CHECK_THAT(complaint_about("(1.000000) can0 123#1\n(2.000000) can0 124#\n"), Contains("some.log:1:17: not a frame"));
  CHECK_THAT(complaint_about("  can0  123   [2]  11 22\n  can0  124   [0]\n"), Contains("no frame in 2 lines"));
  CHECK_THAT(complaint_about("(1.000000) can0 123#11\n\x01\x02\x7f\n"), Contains("some.log:2: control characters"));
  CHECK_THAT(complaint_about(std::string_view{"(1.000000) can0 123#11\n\0\0\n", 27}),
             Contains("some.log:2: a NUL byte"));
  CHECK_THAT(complaint_about(std::string(1'000'000, 'x')), Contains("some.log:1: a line of more than"));
  CHECK_THAT(complaint_about("date Sun Mar 1 12:34:56 2026\nbase hex timestamps absolute\n 0.1 1 8FF Rx d 0\n"),
             Contains("some.log:3: \"8FF\" is no identifier"));
  CHECK_THAT(complaint_about("base hex timestamps absolute\n 0.1 1 7FF Rx d 2 11 1FF\n"),
             Contains("some.log:2: data byte 2 of 2"));
  CHECK_THAT(complaint_about("LOGG"), Contains("some.log: object 1: the file's header is cut off"));
}

TEST_CASE("Logs: what can be lived with is a warning with its line", "[log]") {
  const Log torn = read_text("(1.000000) can0 123#11\n(2.000000) can0 12");
  CHECK(torn.entries.size() == 1);
  REQUIRE(torn.warnings.size() == 1);
  CHECK(torn.warnings[0].line == 2);
  CHECK_THAT(torn.warnings[0].text, Contains("cut off"));

  const Log whole = read_text("(1.000000) can0 123#11\n(2.000000) can0 123#11");  // Or of 123#1122; nobody knows.
  CHECK(whole.entries.size() == 2);
  REQUIRE(whole.warnings.size() == 1);
  CHECK_THAT(whole.warnings[0].text, Contains("has no end"));
  const Log torn_asc = read_text("base hex timestamps absolute\n 0.1 1 7FF Rx d 1 11\n 0.2 1 7FF ");
  CHECK(torn_asc.entries.size() == 1);
  REQUIRE(torn_asc.warnings.size() == 1);
  CHECK(torn_asc.warnings[0].line == 3);

  const Log marked = read_text("\xEF\xBB\xBF(1.000000) can0 123#11\n");  // As editors of another system save it.
  CHECK(marked.entries.size() == 1);
  CHECK(marked.warnings.empty());

  const Log back = read_text("(2.000000) can0 123#11\n(1.500000) can0 124#\n");
  CHECK(back.entries.size() == 2);
  REQUIRE(back.warnings.size() == 1);
  CHECK_THAT(back.warnings[0].text, Contains("goes back by 0.500000 s"));

  std::string many = "(9.000000) can0 123#\n";
  for (int i = 0; i < 1000; ++i) many += i % 2 == 0 ? "(1.000000) can0 123#\n" : "(2.000000) can0 123#\n";
  CHECK(read_text(many).warnings.size() == 20);
  CHECK(read_text("").entries.empty());
}

TEST_CASE("Logs: a packed log or a BLF that is cut off is read as far as it goes", "[log]") {
  const test::TemporaryFolder folder;
  const char* name = GENERATE("a.log.gz", "a.blf");
  const std::vector<LogEntry> entries = make_random_log(kMarch2026, 20000);
  write_all(folder / name, entries);
  std::filesystem::resize_file(folder / name, std::filesystem::file_size(folder / name) * 2 / 3);
  const Log log = read_all(open_log(folder / name));
  CHECK(log.entries.size() > entries.size() / 3);
  CHECK(log.entries.size() < entries.size());
  CHECK_FALSE(log.warnings.empty());
}

TEST_CASE("Logs: a packed log that is cut off at the end of a line, and a BLF behind its header, say so", "[log]") {
  const test::TemporaryFolder folder;
  const std::vector<LogEntry> entries = make_random_log(kMarch2026, 2000);
  write_all(folder / "a.blf", entries);
  std::filesystem::resize_file(folder / "a.blf", 144);
  const Log header = read_all(open_log(folder / "a.blf"));
  CHECK(header.entries.empty());
  REQUIRE(header.warnings.size() == 1);
  CHECK_THAT(header.warnings[0].text, Contains("144 of "));

  write_all(folder / "b.log.gz", entries);
  std::filesystem::resize_file(folder / "b.log.gz",
                               std::filesystem::file_size(folder / "b.log.gz") - 8);  // Its check sum.
  const Log packed = read_all(open_log(folder / "b.log.gz"));
  CHECK(packed.entries.size() == entries.size());
  REQUIRE(packed.warnings.size() == 1);
  CHECK_THAT(packed.warnings[0].text, Contains("cut off"));
}

TEST_CASE("Logs: BLF objects of Vector's own writers, unpacked, one of them across two containers", "[log]") {
  const Log log = read_all(open_log(std::string{MELTBENCH_SOURCE_DIR} + "/tests/fuzz/corpus/log/blf_unpacked"));
  const Instant start{Nanos{1'772'368'496'789'000'000}};
  REQUIRE(log.entries.size() == 7);
  CHECK(log.entries[0].at == start + 1us);
  CHECK(log.entries[0].frame == can::make_frame(0x185, {1, 2, 3}));
  CHECK(log.entries[1].at == start + 20ms);  // 2000 in units of 10 us.
  CHECK(log.entries[1].frame.kind == can::FrameKind::kRemote);
  CHECK(log.entries[1].direction == Direction::kSent);
  CHECK(log.entries[2].frame == log.entries[0].frame);  // CAN_MESSAGE2, with the second version of the header.
  CHECK(log.entries[3].frame.kind == can::FrameKind::kError);
  CHECK(log.entries[4].frame.length == 12);
  CHECK(log.entries[5].frame.id == 0x18FF00F0);
  CHECK(log.entries[5].frame.brs);
  CHECK(log.entries[5].frame.bytes[31] == 31);
  CHECK(log.entries[6].at == start + Nanos{500});
}

TEST_CASE("Logs: ASC in decimal numbers, with relative stamps, names and events that are no frames", "[log]") {
  const Log log = read_text(
      "date Sun Mar 1 12:34:56.789 pm 2026\n"
      "base dec  timestamps relative\n"
      "internal events logged\n"
      "// version 9.0.0\n"
      "Begin Triggerblock Sun Mar 1 12:34:56.789 pm 2026\n"
      "   0.000000 Start of measurement\n"
      "   0.500000 1  291             Rx   d 2 17 34  Length = 0 BitCount = 0\n"
      "   0.250000 1  Statistic: D 0 R 0 XD 0 XR 0 E 0 O 0 B 0.00%\n"
      "   0.250000 2  ErrorFrame\n"
      "   0.000001 CANFD   1 Rx        123  a_name 1 0 9 12 1 2 3 4 5 6 7 8 9 10 11 12 0 0 3000 0 0 0 0 0\n"
      "End TriggerBlock\n");
  REQUIRE(log.entries.size() == 3);
  const Instant start{Nanos{1'772'368'496'789'000'000}};
  CHECK(log.entries[0].at == start + 500ms);
  CHECK(log.entries[0].frame == can::make_frame(291, {17, 34}));
  CHECK(log.entries[1].at == start + 1s);
  CHECK(log.entries[1].frame.kind == can::FrameKind::kError);
  CHECK(log.entries[2].at == start + 1s + 1us);
  CHECK(log.entries[2].frame.length == 12);
  CHECK(log.warnings.empty());
}

TEST_CASE("Logs: dates of ASC files in the forms that are met", "[log]") {
  CHECK(parse_asc_date("Thu Jan 01 12:00:00.000 am 1970") == Instant{});
  CHECK(parse_asc_date("Sun Mar 1 12:34:56.789 pm 2026") == Instant{Nanos{1'772'368'496'789'000'000}});
  CHECK(parse_asc_date("Sun Mar  1 12:34:56 2026") == Instant{Nanos{1'772'368'496'000'000'000}});
  CHECK_FALSE(parse_asc_date("Son Maer 1 12:34:56 2026").has_value());
  CHECK_FALSE(parse_asc_date("Mon Feb 30 12:34:56 2026").has_value());
  CHECK_FALSE(parse_asc_date("").has_value());
}
