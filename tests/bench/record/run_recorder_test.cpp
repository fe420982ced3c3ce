#include "bench/record/run_recorder.hpp"

#include <sys/wait.h>
#include <unistd.h>

#include <catch2/catch.hpp>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <iterator>
#include <limits>
#include <string>

#include "bench/record/load_recording.hpp"
#include "tests/tools/temporary_folder.hpp"

namespace meltbench::record {
namespace {

namespace fs = std::filesystem;

RunInfo make_info() {
  RunInfo info;
  info.scenario = "step";
  info.variant = "exact";
  info.title = "A step, with \"quotes\" and é";
  info.seed = 18'446'744'073'709'551'615U;
  info.duration = 60s;
  info.participants = {"plant", "controller"};
  info.nodes = {{5, "feeder"}, {7, "screw_drive"}};
  info.bit_rate_bit_per_s = 500'000;
  info.version = "meltbench 0.1.0";
  info.repeat_command = "meltbench run repro.toml --seed 1";
  return info;
}

std::vector<SignalInfo> make_signals() {
  return {{"plant.x_m"}, {"plant.rejected_feed_count", SignalKind::kErrorCounter}, {"controller.P_m"}};
}

const std::vector<double> kAwkward{0.1,          -0.0,          1.0 / 3.0, 5e-324, 1.7976931348623157e308,
                                   0.16 + 1e-17, 123456789.125, 1e22};

/// Two seconds of a run with frames of every kind.
Recording record_run(const fs::path& folder) {
  RunRecorder recorder{make_info(), make_signals(), folder};
  can::CanFrame fd = can::make_frame(0x155, {1, 2, 3});
  fd.fd = true;
  fd.brs = true;
  fd.length = 24;
  for (std::uint8_t i = 0; i < 24; ++i) fd.bytes[i] = i;
  can::CanFrame extended = can::make_frame(0x1, {9});
  extended.extended = true;
  extended.id = 0x12345678;
  can::CanFrame error;
  error.kind = can::FrameKind::kError;
  error.id = 0x4;
  error.length = 8;
  for (int i = 0; i < 200; ++i) {
    const Instant at{Nanos{i * 10'000'000LL + 7}};
    recorder.frame({at, can::make_frame(0x80, {})}, 1);
    recorder.frame({at, i % 3 == 0 ? fd : extended}, 0);
    const double value = kAwkward[static_cast<std::size_t>(i) % kAwkward.size()];
    recorder.row(at, std::vector<double>{value, i < 100 ? 0.0 : 1.0, i == 5 ? std::nan("") : value * 1.1});
  }
  recorder.frame({Instant{2s}, error}, kUnknownSender);
  recorder.event("controller", {Instant{1500ms}, Severity::kWarning, "heartbeat-lost", "node 5\nsecond line"});
  Ending ending;
  ending.at = Instant{2s};
  ending.lost_frames = 3;
  return recorder.finish(ending);
}

bool same_bits(double a, double b) {
  return std::memcmp(&a, &b, sizeof a) == 0 || (std::isnan(a) && std::isnan(b));
}

}  // namespace

TEST_CASE("Run folder: what was recorded is read back to the last bit", "[record]") {
  const test::TemporaryFolder scratch;
  const Recording written = record_run(scratch.path());
  const Recording read = load_recording(scratch.path());

  CHECK(read.notes.empty());
  CHECK(read.info.label() == "step.exact");
  CHECK(read.info.title == written.info.title);
  CHECK(read.info.seed == written.info.seed);
  CHECK(read.info.duration == 60s);
  CHECK(read.info.participants == written.info.participants);
  REQUIRE(read.info.nodes.size() == 2);
  CHECK(read.info.nodes[1].name == "screw_drive");
  CHECK(read.info.bit_rate_bit_per_s == 500'000U);
  CHECK(read.ending.reason == EndReason::kCompleted);
  CHECK(read.ending.at == Instant{2s});
  CHECK(read.ending.lost_frames == 3);

  REQUIRE(read.signals.size() == 3);
  CHECK(read.signals[1].kind == SignalKind::kErrorCounter);
  CHECK(read.row_times == written.row_times);
  REQUIRE(read.values.size() == written.values.size());
  for (std::size_t i = 0; i < read.values.size(); ++i) CHECK(same_bits(read.values[i], written.values[i]));

  REQUIRE(read.frames.size() == written.frames.size());
  for (std::size_t i = 0; i < read.frames.size(); ++i) {
    CHECK(read.frames[i].at == written.frames[i].at);
    CHECK(read.frames[i].frame == written.frames[i].frame);
  }
  CHECK(written.frames[1].sender == 0);
  REQUIRE(read.events.size() == 1);
  CHECK(read.events[0].source == "controller");
  CHECK(read.events[0].event.text == "node 5\nsecond line");
  CHECK(read.events[0].event.at == Instant{1500ms});
}

TEST_CASE("Run folder: what a bit-timed bus has counted is read back", "[record]") {
  const test::TemporaryFolder scratch;
  BusTiming timing;
  timing.load = 0.1018902;
  timing.responses.push_back({0x185, false, "feeder", 5992, 6e-6, 7e-6, 0.000242, 0.000644});
  timing.responses.push_back({0x12345678, true, "stranger", 1, 0, 0, 1e-3, std::nullopt});
  NodeTiming node;
  node.name = "feeder";
  node.state = "error-passive";
  node.tec = 128;
  node.arbit_lost = 60;
  node.re_started = 2;
  timing.nodes.push_back(node);
  RunRecorder recorder{make_info(), make_signals(), scratch.path()};
  recorder.bus_timing(timing);
  static_cast<void>(recorder.finish({}));
  const Recording read = load_recording(scratch.path());
  REQUIRE(read.bus_timing);
  CHECK(read.bus_timing->load == timing.load);
  REQUIRE(read.bus_timing->responses.size() == 2);
  CHECK(read.bus_timing->responses[0].node == "feeder");
  CHECK(read.bus_timing->responses[0].worst_response_s == 0.000242);
  CHECK(read.bus_timing->responses[0].bound_s == std::optional{0.000644});
  CHECK_FALSE(read.bus_timing->responses[1].bound_s);
  CHECK(read.bus_timing->responses[1].extended);
  REQUIRE(read.bus_timing->nodes.size() == 1);
  CHECK(read.bus_timing->nodes[0].state == "error-passive");
  CHECK(read.bus_timing->nodes[0].tec == 128);
  CHECK(read.bus_timing->nodes[0].arbit_lost == 60);
  CHECK(read.bus_timing->nodes[0].re_started == 2);
}

TEST_CASE("Run folder: two equal runs leave equal bytes", "[record]") {
  const test::TemporaryFolder first;
  const test::TemporaryFolder second;
  record_run(first.path());
  record_run(second.path());
  for (const char* name : {"bus.log", "signals.csv", "events.jsonl"}) {
    CHECK(test::read_file(first.path() / name) == test::read_file(second.path() / name));
  }
}

TEST_CASE("Run folder: its files are the text that other tools read", "[record]") {
  const test::TemporaryFolder scratch;
  record_run(scratch.path());
  const std::string csv = test::read_file(scratch.path() / "signals.csv");
  CHECK(csv.starts_with("t_s,plant.x_m,plant.rejected_feed_count,controller.P_m\n0.000000007,0.1,0,"));
  const std::string log = test::read_file(scratch.path() / "bus.log");
  CHECK(log.find("(0000000000.010000) bench 080#\n(0000000000.010000) bench 12345678#09\n") != std::string::npos);
  // python-can and Wireshark give up at a line that is no frame.
  CHECK(log.front() == '(');
  for (std::size_t end = log.find('\n'); end + 1 < log.size(); end = log.find('\n', end + 1))
    CHECK(log[end + 1] == '(');
}

TEST_CASE("Run folder: a frame from outside keeps its mark, in the log and when it is read back", "[record]") {
  const test::TemporaryFolder scratch;
  {
    RunRecorder recorder{make_info(), make_signals(), scratch.path()};
    recorder.frame({Instant{1ms}, can::make_frame(0x605, {0x40})}, kTapSender);
    recorder.frame({Instant{2ms}, can::make_frame(0x585, {0x43})}, 1);
    static_cast<void>(recorder.finish({}));
  }
  CHECK(test::read_file(scratch.path() / "bus.log") ==
        "(0000000000.001000) tap 605#40\n(0000000000.002000) bench 585#43\n");
  const Recording loaded = load_recording(scratch.path());
  REQUIRE(loaded.frames.size() == 2);
  CHECK(loaded.frames[0].sender == kTapSender);
  CHECK(loaded.frames[1].sender == kUnknownSender);
}

TEST_CASE("Run folder: a bench killed in the middle leaves whole lines and is read as cut short", "[record]") {
  const test::TemporaryFolder scratch;
  const pid_t child = ::fork();
  if (child == 0) {
    RunRecorder recorder{make_info(), make_signals(), scratch.path()};
    for (int i = 0; i < 20'000; ++i) {
      const Instant at{Nanos{i * 10'000'000LL}};
      recorder.frame({at, can::make_frame(0x185, {1, 2, 3, 4})}, 0);
      recorder.row(at, std::vector<double>{0.1 * i, 0, 0.3 * i});
    }
    ::_exit(9);  // No destructor runs: what is in memory is lost, as under kill -9.
  }
  int status = 0;
  REQUIRE(::waitpid(child, &status, 0) == child);

  const Recording read = load_recording(scratch.path());
  CHECK(read.ending.reason == EndReason::kCutShort);
  REQUIRE(read.notes.size() == 1);
  // At most one block of 64 KiB, about 1500 of these lines, is lost of each file.
  CHECK(read.row_count() > 18'000);
  CHECK(read.frames.size() > 18'000);
  CHECK(read.ending.at == std::max(read.row_times.back(), read.frames.at(read.frames.size() - 1)));
}

TEST_CASE("Run folder: a torn last line is dropped with a note", "[record]") {
  const test::TemporaryFolder scratch;
  record_run(scratch.path());
  const fs::path csv = scratch.path() / "signals.csv";
  fs::resize_file(csv, fs::file_size(csv) - 4);
  const Recording read = load_recording(scratch.path());
  CHECK(read.row_count() == 199);
  REQUIRE(read.notes.size() == 1);
  CHECK(read.notes[0].find("signals.csv: the last line is torn") != std::string::npos);
}

TEST_CASE("Run folder: a line that no recorder writes is refused with its place", "[record]") {
  const test::TemporaryFolder scratch;
  record_run(scratch.path());
  const auto damage = [&](const char* name, const std::string& line) {
    std::ofstream{scratch.path() / name, std::ios::app} << line << '\n';
  };
  SECTION("signals") {
    damage("signals.csv", "2.500000000,1,two,3");
    CHECK_THROWS_WITH(load_recording(scratch.path()),
                      Catch::EndsWith("signals.csv:202: the value of plant.rejected_feed_count is not a number"));
  }
  SECTION("time") {
    damage("signals.csv", "0.500000000,1,2,3");
    CHECK_THROWS_WITH(load_recording(scratch.path()), Catch::EndsWith("signals.csv:202: time runs backwards"));
  }
  SECTION("frames") {
    damage("bus.log", "(0000000003.000000) bench 123#1");
    CHECK_THROWS_AS(load_recording(scratch.path()), LoadError);
  }
  SECTION("events") {
    damage("events.jsonl", "{\"type\": ");
    CHECK_THROWS_AS(load_recording(scratch.path()), LoadError);
  }
  SECTION("nothing there") {
    fs::remove(scratch.path() / "events.jsonl");
    CHECK_THROWS_WITH(load_recording(scratch.path()), Catch::EndsWith("events.jsonl: cannot be read"));
  }
}

TEST_CASE("Recorder: an older verdict does not survive beside a new recording", "[record]") {
  const test::TemporaryFolder scratch;
  std::ofstream{scratch.path() / "result.json"} << "{\"held\": true}";
  const RunRecorder recorder{make_info(), make_signals(), scratch.path()};
  CHECK_FALSE(fs::exists(scratch.path() / "result.json"));
}

TEST_CASE("Recorder: a full disk does not stop the run, and is a fault in the recording", "[record]") {
  if (!fs::exists("/dev/full")) return;
  const test::TemporaryFolder scratch;
  fs::create_symlink("/dev/full", scratch.path() / "signals.csv");
  const Recording recording = record_run(scratch.path());
  CHECK(recording.row_count() == 200);
  REQUIRE_FALSE(recording.events.empty());
  CHECK(recording.events.back().event.code == "recording-failed");
  CHECK(recording.events.back().event.severity == Severity::kFault);
}

TEST_CASE("Recorder: signal names that would break the table are refused", "[record]") {
  CHECK_THROWS_AS(RunRecorder({}, {{"a,b"}}), std::invalid_argument);
  CHECK_THROWS_AS(RunRecorder({}, {{"a"}, {"a"}}), std::invalid_argument);
  CHECK_THROWS_AS(RunRecorder({}, {{""}}), std::invalid_argument);
}

TEST_CASE("Recorder: without a folder it keeps the run in memory and writes nothing", "[record]") {
  RunRecorder recorder{make_info(), make_signals()};
  recorder.row(Instant{}, std::vector<double>{1, 0, 2});
  recorder.event("bench", {Instant{}, Severity::kInfo, "start", ""});
  const Recording recording = recorder.finish({});
  CHECK(recording.row_count() == 1);
  CHECK(recording.value(0, 2) == 2.0);
}

TEST_CASE("Signal units: read from the end of the name", "[record]") {
  CHECK(unit_of_signal("plant.x_m") == "m");
  CHECK(unit_of_signal("plant.flow_kg_per_s") == "kg/s");
  CHECK(unit_of_signal("feeder.set_point_kg_per_h") == "kg/h");
  CHECK(unit_of_signal("plant.pressure_Pa") == "Pa");
  CHECK(unit_of_signal("plant.heat_W_per_m2") == "W/m2");
  CHECK(unit_of_signal("plant.U") == "");
  CHECK(unit_of_signal("plant.delay_rate") == "");
  CHECK(unit_of_signal("controller.U_command") == "");
  CHECK(unit_of_signal("s") == "");
}

TEST_CASE("Recorder: bytes on serial lines have a file of their own, if the rig has lines", "[record]") {
  const test::TemporaryFolder folder;
  RunInfo info = make_info();
  info.has_serial_lines = true;
  RunRecorder recorder{info, make_signals(), folder.path()};
  recorder.serial("hopper", "controller", Instant{1s + 2345us + 999ns}, std::array<std::uint8_t, 3>{0x01, 0xAB, 0xFF});
  recorder.serial("hopper", "plant", Instant{2s}, std::array<std::uint8_t, 1>{0});
  static_cast<void>(recorder.finish({}));
  CHECK(test::read_file(folder.path() / "serial.log") ==
        "(0000000001.002345) hopper controller 01ABFF\n(0000000002.000000) hopper plant 00\n");

  RunRecorder next{make_info(), make_signals(), folder.path()};
  CHECK_FALSE(fs::exists(folder.path() / "serial.log"));  // That of the older run.
}

}  // namespace meltbench::record
