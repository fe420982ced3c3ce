/// How fast a whole run goes, beside what the machine's sockets can do at best.

#include <benchmark/benchmark.h>
#include <sched.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <filesystem>
#include <string>

#include "bench/cli/list_command.hpp"
#include "bench/cli/single_run.hpp"

namespace {

using namespace meltbench;

void pin_to(int cpu) {
  cpu_set_t set;
  CPU_ZERO(&set);
  CPU_SET(static_cast<std::size_t>(cpu), &set);
  ::sched_setaffinity(0, sizeof(set), &set);
}

/// One message of 64 bytes to another process and back: what every wake-up of a participant costs at least.
void seqpacket_ping_pong(benchmark::State& state) {
  std::array<int, 2> ends{};
  if (::socketpair(AF_UNIX, SOCK_SEQPACKET, 0, ends.data()) != 0) return state.SkipWithError("no socket pair");
  std::array<char, 64> message{};
  cpu_set_t before;
  ::sched_getaffinity(0, sizeof(before), &before);
  const pid_t child = ::fork();
  if (child == 0) {
    ::close(ends[0]);
    pin_to(static_cast<int>(state.range(0)));
    ssize_t size = 0;
    while ((size = ::recv(ends[1], message.data(), message.size(), 0)) > 0) {
      if (::send(ends[1], message.data(), static_cast<std::size_t>(size), 0) != size) break;
    }
    ::_exit(0);
  }
  ::close(ends[1]);
  pin_to(0);
  for (auto _ : state) {
    static_cast<void>(_);
    if (::send(ends[0], message.data(), message.size(), 0) < 0 ||
        ::recv(ends[0], message.data(), message.size(), 0) <= 0) {
      state.SkipWithError("the other end has gone");
      break;
    }
  }
  ::close(ends[0]);
  ::waitpid(child, nullptr, 0);
  ::sched_setaffinity(0, sizeof(before), &before);
}
BENCHMARK(seqpacket_ping_pong)->ArgName("other_cpu")->Arg(0)->Arg(1)->UseRealTime();

/// 60 s of the extruder under the exact predictor, boards, bus, controller and recording: x_real_time is the figure.
void whole_run(benchmark::State& state, cli::Pace::Kind pace) {
  const auto folder = std::filesystem::temp_directory_path() / ("meltbench-benchmark-" + std::to_string(::getpid()));
  cli::RunRequest request;
  request.quiet = true;
  request.pace.kind = pace;
  double virtual_s = 0;
  for (auto _ : state) {
    static_cast<void>(_);
    state.PauseTiming();
    auto runs = scenario::load(cli::find_scenarios() / "delay_compensation.toml");
    cli::PreparedRun prepared = cli::prepare(std::move(runs.back()), folder, request);
    state.ResumeTiming();
    const record::Recording recording = cli::execute(prepared, request);
    virtual_s += to_s(recording.ending.at);
    if (recording.ending.reason != record::EndReason::kCompleted) state.SkipWithError(recording.ending.text.c_str());
  }
  state.counters["x_real_time"] = benchmark::Counter(virtual_s, benchmark::Counter::kIsRate);
  std::filesystem::remove_all(folder);
}
BENCHMARK_CAPTURE(whole_run, in_process_60s, cli::Pace::Kind::kInProcess)->UseRealTime()->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(whole_run, lockstep_60s, cli::Pace::Kind::kLockstep)->UseRealTime()->Unit(benchmark::kMillisecond);

}  // namespace
