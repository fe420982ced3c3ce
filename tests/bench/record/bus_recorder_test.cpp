#include "bench/record/bus_recorder.hpp"

#include <sched.h>
#include <signal.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

#include <catch2/catch.hpp>
#include <fstream>
#include <sstream>

#include "protocols/can/candump.hpp"
#include "protocols/link/socketcan_link.hpp"
#include "tests/tools/socket_pair.hpp"
#include "tests/tools/temporary_folder.hpp"

using namespace meltbench;
using namespace meltbench::record;

namespace {

std::vector<std::string> lines_of(const std::string& text) {
  std::vector<std::string> lines;
  std::istringstream stream{text};
  for (std::string line; std::getline(stream, line);) {
    if (line.find_first_not_of(' ') != std::string::npos) lines.push_back(line);
  }
  return lines;
}

/// A socket pair keeps datagrams whole, as a CAN socket does: one end is the link, the other one the bus.
struct FakeBus {
  FakeBus() {
    auto ends = test::make_socket_pair(SOCK_DGRAM | SOCK_NONBLOCK);
    link_end = std::move(ends[0]);
    bus_end = std::move(ends[1]);
  }
  bool say(const can::CanFrame& frame) const {
    canfd_frame kernel;
    const std::size_t size = link::to_kernel_frame(frame, kernel);
    return ::send(bus_end.get(), &kernel, size, 0) == static_cast<ssize_t>(size);
  }
  link::UniqueFd link_end;
  link::UniqueFd bus_end;
};

can::CanFrame numbered(std::uint32_t number) {
  return can::make_frame(0x123, {static_cast<std::uint8_t>(number), static_cast<std::uint8_t>(number >> 8U),
                                 static_cast<std::uint8_t>(number >> 16U)});
}

/// A link that says what a kernel may say.
class ScriptedLink final : public link::CanLink {
 public:
  link::SendStatus send(const can::CanFrame&) noexcept override { return link::SendStatus::kUnsupported; }
  std::optional<link::ReceivedFrame> receive() noexcept override {
    if (next_ == frames.size()) return std::nullopt;
    counters_.dropped = frames[next_].dropped;
    return frames[next_++].received;
  }
  bool is_up() noexcept override { return looks++ != 1; }
  int fd() const noexcept override { return -1; }
  const link::LinkCounters& counters() const noexcept override { return counters_; }

  struct Step {
    link::ReceivedFrame received;
    std::uint64_t dropped = 0;
  };
  std::vector<Step> frames;
  int looks = 0;

 private:
  std::size_t next_ = 0;
  link::LinkCounters counters_;
};

BusRecorderResult record_bus(link::CanLink& link, LogFiles& files, const BusRecorderRequest& request,
                             const std::function<bool()>& stop) {
  BusRecorder recorder{link, files, request};
  WireRecorder* const all[] = {&recorder};
  record_until(all, stop);
  return recorder.result();
}

}  // namespace

TEST_CASE("a recorder writes every frame of the bus, in order, under its head", "[record]") {
  const test::TemporaryFolder folder;
  FakeBus bus;
  link::SocketCanLink link{std::move(bus.link_end), "test0", true};
  LogFiles files{{folder / "a.log", "# head\n", {}, {}}};
  constexpr std::uint32_t kFrames = 2000;
  std::uint32_t sent = 0;
  // Says ten at a time, and stops when the recorder has had the chance to take the last of them.
  const auto stop = [&] {
    if (sent == kFrames) return true;
    for (int i = 0; i < 10; ++i) REQUIRE(bus.say(numbered(sent++)));
    return false;
  };
  const BusRecorderResult result = record_bus(link, files, {"test0", 0ns}, stop);
  CHECK(result.frames == kFrames);
  CHECK(result.dropped == 0);
  const auto lines = lines_of(test::read_file(folder / "a.log"));
  REQUIRE(lines.size() == kFrames + 1);
  CHECK(lines[0] == "# head");
  Instant before{};
  for (std::uint32_t i = 0; i < kFrames; ++i) {
    const can::ParsedLogLine parsed = can::parse_log_line(lines[i + 1]);
    REQUIRE(parsed.kind == can::LogLineKind::kFrame);
    REQUIRE(parsed.line.frame == numbered(i));
    REQUIRE(parsed.line.at >= before);
    before = parsed.line.at;
  }
}

TEST_CASE("frames that the kernel dropped and a bus that went away are in the recording", "[record]") {
  const test::TemporaryFolder folder;
  ScriptedLink link;
  link.frames = {{{1s, numbered(1)}, 0}, {{2s, numbered(2)}, 3}, {{3s, numbered(3)}, 4}};
  LogFiles files{{folder / "a.log", "", {}, {}}};
  const BusRecorderResult result = record_bus(link, files, {"can0", 100s}, [&] { return link.looks == 3; });
  CHECK(result.dropped == 4);
  CHECK(result.downs == 1);
  const auto lines = lines_of(test::read_file(folder / "a.log"));
  REQUIRE(lines.size() == 7);
  CHECK(lines[0] == "(0000000101.000000) can0 123#010000");
  CHECK(lines[1] == "DROPCOUNT: dropped 3 CAN frames on 'can0' socket (total drops 3)");
  CHECK(lines[2] == "(0000000102.000000) can0 123#020000");
  CHECK(lines[3] == "DROPCOUNT: dropped 1 CAN frame on 'can0' socket (total drops 4)");
  CHECK_THAT(lines[5], Catch::Matchers::EndsWith("can0 is down"));
  CHECK_THAT(lines[6], Catch::Matchers::EndsWith("can0 is back"));
}

TEST_CASE("a file that is large or old is followed by another with the same head", "[record]") {
  const test::TemporaryFolder folder;
  const std::string line(100, 'x');
  SECTION("by size") {
    LogFiles files{{folder / "a.log", "# head\n", 10'000, {}}};
    for (int i = 0; i < 250; ++i) files.append(Instant{i * 1s}, line + "\n");
    files.flush();
    CHECK(files.files() == 3);
  }
  SECTION("by age") {
    LogFiles files{{folder / "a.log", "# head\n", {}, 60s}};
    for (int i = 0; i < 180; ++i) files.append(Instant{i * 1s}, line + "\n");
    files.flush();
    CHECK(files.files() == 3);
  }
  std::size_t lines = 0;
  for (const char* name : {"a.log", "a.2.log", "a.3.log"}) {
    const auto read_lines = lines_of(test::read_file(folder / name));
    REQUIRE_FALSE(read_lines.empty());
    CHECK(read_lines[0] == "# head");
    CHECK(std::filesystem::file_size(folder / name) <= 20'000);
    lines += read_lines.size() - 1;
  }
  CHECK((lines == 250 || lines == 180));
}

TEST_CASE("a recording is never written over", "[record]") {
  const test::TemporaryFolder folder;
  std::ofstream{folder / "a.log"} << "precious\n";
  CHECK_THROWS_AS((LogFiles{{folder / "a.log", "", {}, {}}}), std::system_error);
  CHECK(test::read_file(folder / "a.log") == "precious\n");
}

TEST_CASE("no line lies across a page of the file", "[record]") {
  const test::TemporaryFolder folder;
  LogFiles files{{folder / "a.log", "# head\n", {}, {}}};
  for (std::size_t i = 0; i < 2000; ++i) files.append(Instant{}, std::string(30 + i % 41, 'x') + "\n");
  files.flush();
  const std::string text = test::read_file(folder / "a.log");
  CHECK(lines_of(text).size() == 2001);
  REQUIRE(text.size() > 10 * 4096);
  for (std::size_t page = 4096; page < text.size(); page += 4096) REQUIRE(text[page - 1] == '\n');
}

TEST_CASE("what a recorder has received is soon in the file, and whole lines of it after kill -9", "[record]") {
  const test::TemporaryFolder folder;
  FakeBus bus;
  const auto file = folder / "a.log";
  const pid_t child = ::fork();
  REQUIRE(child >= 0);
  if (child == 0) {
    link::SocketCanLink link{std::move(bus.link_end), "test0", true};
    LogFiles files{{file, "", {}, {}}};
    (void)record_bus(link, files, {"test0", 0ns}, [] { return false; });
    ::_exit(1);
  }
  std::uint32_t sent = 0;
  while (sent < 5) sent += bus.say(numbered(sent)) ? 1U : 0U;
  // On a bus that is quiet again: nothing but time brings these lines into the file.
  while (lines_of(test::read_file(file)).size() < 5) ::sched_yield();
  std::error_code none;
  while (std::filesystem::file_size(file, none) < 300'000) sent += bus.say(numbered(sent)) ? 1U : 0U;
  ::kill(child, SIGKILL);
  REQUIRE(::waitpid(child, nullptr, 0) == child);
  const std::string text = test::read_file(file);
  CHECK(text.back() == '\n');
  const auto lines = lines_of(text);
  for (std::uint32_t i = 0; i < lines.size(); ++i) {
    const can::ParsedLogLine parsed = can::parse_log_line(lines[i]);
    REQUIRE(parsed.kind == can::LogLineKind::kFrame);
    REQUIRE(parsed.line.frame == numbered(i));
  }
}
