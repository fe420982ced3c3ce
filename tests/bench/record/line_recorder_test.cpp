#include "bench/record/line_recorder.hpp"

#include <fcntl.h>
#include <sched.h>
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <catch2/catch.hpp>
#include <deque>
#include <sstream>

#include "tests/tools/temporary_folder.hpp"

using namespace meltbench;
using namespace meltbench::record;

namespace {

/// A port that hears what it is told to, a piece at each read.
class ScriptedLine final : public link::SerialLink {
 public:
  std::size_t write(std::span<const std::uint8_t>) noexcept override { return 0; }
  std::optional<link::ReceivedBytes> receive() noexcept override {
    if (next_ == script.size()) return std::nullopt;
    const auto& [at, bytes] = script[next_++];
    return link::ReceivedBytes{at, bytes};
  }
  bool is_up() const noexcept override { return up; }
  bool reopen() noexcept override { return up = true; }
  int fd() const noexcept override { return -1; }

  std::deque<std::pair<Nanos, std::vector<std::uint8_t>>> script;  ///< All of it long ago.
  bool up = true;

 private:
  std::size_t next_ = 0;
};

constexpr serial::LineSettings kFast{115'200, serial::Parity::kEven, 1};  // A byte takes 95.5 us, t3.5 is 1.75 ms.

std::vector<std::string> lines_of(const std::string& text) {
  std::vector<std::string> lines;
  std::istringstream stream{text};
  for (std::string line; std::getline(stream, line);) {
    if (line.find_first_not_of(' ') != std::string::npos) lines.push_back(line);
  }
  return lines;
}

std::vector<std::string> record_script(std::vector<HeardLine> lines) {
  const test::TemporaryFolder folder;
  LogFiles files{{folder / "a.log", "", {}, {}}};
  LineRecorder recorder{std::move(lines), files, 1000s};
  recorder.take();
  recorder.finish(3600s);
  return lines_of(test::read_file(folder / "a.log"));
}

}  // namespace

TEST_CASE("a serial line's piece ends where the silence of Modbus RTU follows, with the time of its last byte",
          "[record]") {
  ScriptedLine line;
  // Four bytes that an adapter hands over in two halves; the second began 0.4 ms after the first ended. Then 5 ms.
  line.script = {{10'000us, {1, 3}}, {10'600us, {0xAB, 0xCD}}, {15'700us, {1}}};
  const auto lines = record_script({{"dosing", &line, kFast}});
  REQUIRE(lines.size() == 2);
  CHECK(lines[0] == "(0000001000.010600) dosing wire 0103ABCD");
  CHECK(lines[1] == "(0000001000.015700) dosing wire 01");
}

TEST_CASE("bytes without end are cut into pieces, and none is lost", "[record]") {
  ScriptedLine line;
  line.script = {{20ms, std::vector<std::uint8_t>(2 * LineRecorder::kMaxPiece + 1, 0x55)}};
  const auto lines = record_script({{"dosing", &line, kFast}});
  REQUIRE(lines.size() == 3);
  CHECK(lines[0].size() == std::string{"(0000001000.020000) dosing wire "}.size() + 2 * LineRecorder::kMaxPiece);
  CHECK_THAT(lines[2], Catch::EndsWith(" 55"));
}

TEST_CASE("pieces of several lines stand in the order of time", "[record]") {
  ScriptedLine slow;
  ScriptedLine fast;
  slow.script = {{10ms, {1}}, {100ms, {2}}};  // At 1200 baud t3.5 is 29 ms.
  fast.script = {{20ms, {3}}, {30ms, {4}}};
  const auto lines = record_script({{"slow", &slow, {1200, serial::Parity::kNone, 1}}, {"fast", &fast, kFast}});
  REQUIRE(lines.size() == 4);
  CHECK_THAT(lines[0], Catch::EndsWith("slow wire 01"));
  CHECK_THAT(lines[1], Catch::EndsWith("fast wire 03"));
  CHECK_THAT(lines[2], Catch::EndsWith("fast wire 04"));
  CHECK_THAT(lines[3], Catch::EndsWith("slow wire 02"));
}

TEST_CASE("a port that goes away is in the recording, and what came before it, too", "[record]") {
  const test::TemporaryFolder folder;
  ScriptedLine line;
  line.script = {{10ms, {7}}};
  LogFiles files{{folder / "a.log", "", {}, {}}};
  LineRecorder recorder{{{"dosing", &line, kFast}}, files, 1000s};
  line.up = false;
  recorder.take();
  // It is looked for again 100 ms later.
  while (!line.up) recorder.take();
  recorder.finish(3600s);
  const auto lines = lines_of(test::read_file(folder / "a.log"));
  REQUIRE(lines.size() == 3);
  CHECK_THAT(lines[0], Catch::EndsWith("dosing wire 07"));
  CHECK_THAT(lines[1], Catch::StartsWith("# ") && Catch::EndsWith("line dosing is down"));
  CHECK_THAT(lines[2], Catch::StartsWith("# ") && Catch::EndsWith("line dosing is back"));
  CHECK(recorder.result().downs == 1);
}

TEST_CASE("what a serial recorder has heard is soon in the file, and whole lines of it after kill -9", "[record]") {
  const test::TemporaryFolder folder;
  const auto file = folder / "a.log";
  const std::string pty = "pty:" + (folder / "line").string();
  const auto far_end = folder / "line";
  const pid_t child = ::fork();
  REQUIRE(child >= 0);
  if (child == 0) {
    link::SerialPort port{pty, kFast};
    LogFiles files{{file, "", {}, {}}};
    LineRecorder recorder{{{"dosing", &port, kFast}}, files, 0s};
    WireRecorder* const all[] = {&recorder};
    record_until(all, [] { return false; });
    ::_exit(1);
  }
  int fd = -1;
  while ((fd = ::open(far_end.c_str(), O_WRONLY | O_NOCTTY | O_CLOEXEC)) < 0) ::sched_yield();
  const link::UniqueFd talker{fd};
  const auto say = [&](std::uint8_t byte) { return ::write(talker.get(), &byte, 1) == 1; };
  REQUIRE(say(0x42));
  // On a line that is quiet again: nothing but time brings it into the file.
  while (lines_of(test::read_file(file)).empty()) ::sched_yield();
  std::error_code none;
  while (std::filesystem::file_size(file, none) < 20'000) say(0x55);
  ::kill(child, SIGKILL);
  REQUIRE(::waitpid(child, nullptr, 0) == child);
  const std::string text = test::read_file(file);
  CHECK(text.back() == '\n');
  for (const std::string& line : lines_of(text)) {
    CAPTURE(line);
    CHECK(line.find_first_not_of("(0123456789.) dosingwireABCDEF") == std::string::npos);
    CHECK_THAT(line, Catch::StartsWith("(") && Catch::Contains(" dosing wire ") &&
                         (Catch::EndsWith("42") || Catch::EndsWith("55")));
  }
}
