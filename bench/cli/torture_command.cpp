#include "bench/cli/torture_command.hpp"

#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <charconv>
#include <chrono>
#include <cmath>
#include <csignal>
#include <cstring>
#include <fstream>
#include <mutex>
#include <optional>
#include <stdexcept>
#include <thread>

#include "bench/cli/memory_run.hpp"
#include "bench/cli/version.hpp"
#include "bench/fault/torture.hpp"
#include "controller/machine/controller.hpp"
#include "protocols/runtime/stop_signal.hpp"

namespace meltbench::cli {
namespace {

using machine::ControllerState;

constexpr unsigned kMostJobs = 64;
/// Longest time from the safe state, or from the end of the controller, to heaters without power: a heater that hangs
/// is reset after 3 s, and its watchdog takes 1 s.
constexpr Nanos kHeatersOff = 6s;
constexpr double kMostResidual_m =
    1e-6;  // A hundred times what the solver promises: speeds swing faster than it steps.

/// What is asked of every run, row by row. Text of the first thing that is wrong, or empty.
class Examiner final : public bus::RunObserver {
 public:
  explicit Examiner(std::span<const SignalInfo> signals, double length_m) : length_m_{length_m} {
    for (std::size_t i = 0; i < signals.size(); ++i) {
      const std::string& name = signals[i].name;
      if (name == "plant.x_m") x_ = i;
      if (name == "plant.mass_residual_m") residual_ = i;
      if (name == "controller.U_command") U_ = i;
      if (name == "controller.flow_command_kg_per_h") flow_ = i;
      if (name == "controller.state") state_ = i;
      if (name.starts_with("barrel.power_")) powers_.push_back(i);
    }
  }

  void on_frame(const can::StampedFrame& /*frame*/, std::size_t /*sender*/) override {}
  void on_event(std::size_t /*participant*/, const Event& /*event*/) override {}
  void on_row(Instant at, std::span<const double> values) override {
    if (!wrong_.empty()) return;
    require(at, values, x_, "filled length", 0, length_m_ + 1e-9);
    require(at, values, residual_, "mass residual", -kMostResidual_m, kMostResidual_m);
    const bool killed = state_ && std::isnan(values[*state_]);  // A program that is not there has no values.
    if (!killed) require(at, values, U_, "filling ratio asked for", 0, 1);
    if (!killed) require(at, values, flow_, "flow asked for", 0, 1e4);
    if (state_) examine_state(at, values, killed ? ControllerState::kOff : to_state(values[*state_]));
  }

  [[nodiscard]] const std::string& wrong() const { return wrong_; }
  [[nodiscard]] ControllerState last_state() const { return last_; }

 private:
  void require(Instant at, std::span<const double> values, std::optional<std::size_t> index, std::string_view what,
               double low, double high) {
    if (!index) return;
    const double value = values[*index];
    if (value >= low && value <= high) return;
    wrong_ = fmt::format("{} is {} at {:.3f} s", what, value, to_s(at));
  }

  static ControllerState to_state(double value) { return static_cast<ControllerState>(static_cast<int>(value)); }

  /// Off is one that has been killed: then the boards' own watchdogs must do it.
  void examine_state(Instant at, std::span<const double> values, ControllerState state) {
    if (state != last_) since_ = at;
    last_ = state;
    const bool let_go =
        state == ControllerState::kSafe || state == ControllerState::kFault || state == ControllerState::kOff;
    if (!let_go || at - since_ < kHeatersOff) return;
    for (const std::size_t power : powers_) require(at, values, power, "a heater's power in the safe state", 0, 0);
  }

  double length_m_;
  std::optional<std::size_t> x_, residual_, U_, flow_, state_;
  std::vector<std::size_t> powers_;
  ControllerState last_ = ControllerState::kOff;
  Instant since_;
  std::string wrong_;
};

struct Seeds {
  std::uint64_t first = 1;
  std::uint64_t last = 1;
};

std::uint64_t parse_number(std::string_view text) {
  std::uint64_t value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc{} || end != text.data() + text.size() || value > (std::uint64_t{1} << 62U)) {
    throw std::invalid_argument{fmt::format("\"{}\" is no seed: --seeds takes N or FIRST..LAST", text)};
  }
  return value;
}

Seeds parse_seeds(std::string_view text) {
  const std::size_t dots = text.find("..");
  if (dots == std::string_view::npos) return {parse_number(text), parse_number(text)};
  const Seeds seeds{parse_number(text.substr(0, dots)), parse_number(text.substr(dots + 2))};
  if (seeds.first > seeds.last) throw std::invalid_argument{"--seeds: the first is larger than the last"};
  return seeds;
}

/// The run of a seed: the scenario, its faults, and for every other one somebody who starts the controller again.
scenario::ResolvedRun make_run(const scenario::ResolvedRun& base, std::uint64_t seed) {
  const fault::Scope scope = fault::make_scope(base.root, base.rig);
  config::Array events;
  if (seed % 2 == 0) {
    config::Table start;
    start.set("at_s", config::Value{0.6 * to_s(base.duration), {}});
    start.set("target", config::Value{std::string{"controller"}, {}});
    start.set("action", config::Value{std::string{"start"}, {}});
    events.push_back({std::move(start), {}});
  }
  scenario::ResolvedRun run = scenario::extend(base, events, fault::draw_faults(seed, scope, base.duration));
  run.seed = seed;
  return run;
}

double length_of(const config::Section& root) {
  constexpr double kPublished_m = 0.2;
  const config::Section plant = root.peek("plant");
  return plant.has("length_m") ? plant.number("length_m") : kPublished_m;
}

/// What a thread is at, for the one who looks at the remains of a crash.
std::array<std::atomic<std::uint64_t>, kMostJobs> running_seeds{};

void tell_crash(int signal) {
  // Only what is allowed in a signal handler.
  const auto say = [](const char* text, std::size_t size) { static_cast<void>(!::write(2, text, size)); };
  constexpr std::string_view kText = "crashed; seeds that were running:";
  say(kText.data(), kText.size());
  for (const auto& seed : running_seeds) {
    if (seed == 0) continue;
    std::array<char, 24> digits{' '};
    const auto end = std::to_chars(digits.data() + 1, digits.data() + digits.size(), seed.load());
    say(digits.data(), static_cast<std::size_t>(end.ptr - digits.data()));
  }
  say("\n", 1);
  std::signal(signal, SIG_DFL);
  std::raise(signal);
}

struct Verdict {
  std::string wrong;
  ControllerState state = ControllerState::kOff;
};

Verdict run_seed(const scenario::ResolvedRun& run) {
  MemoryRun memory{run};
  Examiner examiner{memory.signals(), length_of(run.root)};
  const bus::RunOutcome outcome = memory.play(examiner);
  Verdict verdict{examiner.wrong(), examiner.last_state()};
  if (outcome.kind == bus::RunOutcome::Kind::kParticipantLost) verdict.wrong = outcome.text;
  return verdict;
}

/// All runs of one request, shared by the threads that carry them out.
class Torture {
 public:
  Torture(const TortureRequest& request, std::vector<scenario::ResolvedRun> bases, Seeds seeds)
      : request_{request}, bases_{std::move(bases)}, seeds_{seeds}, next_{seeds.first} {}

  void work(std::size_t thread) {
    for (std::uint64_t seed = next_++; seed <= seeds_.last && !runtime::stop_requested(); seed = next_++) {
      running_seeds.at(thread) = seed;
      const scenario::ResolvedRun run = make_next(seed);
      const Verdict verdict = run_seed(run);
      note(run, verdict);
    }
    running_seeds.at(thread) = 0;
  }

  /// One thread at a time: a section notes what is read of it.
  [[nodiscard]] scenario::ResolvedRun make_next(std::uint64_t seed) {
    const std::lock_guard lock{making_};
    return make_run(bases_[seed % bases_.size()], seed);
  }

  [[nodiscard]] std::size_t failed() const { return failed_; }
  [[nodiscard]] std::size_t done() const { return done_; }
  void print(double elapsed_s) const {
    fmt::print(
        "{} runs in {:.1f} s: {} failed; at their ends {} ran, {} were safe, {} in fault, {} booting or killed\n",
        done_, elapsed_s, failed_, running_, safe_, fault_, done_ - running_ - safe_ - fault_);
  }

 private:
  void note(const scenario::ResolvedRun& run, const Verdict& verdict) {
    const std::lock_guard lock{mutex_};
    ++done_;
    safe_ += verdict.state == ControllerState::kSafe ? 1U : 0U;
    fault_ += verdict.state == ControllerState::kFault ? 1U : 0U;
    running_ += verdict.state == ControllerState::kReady || verdict.state == ControllerState::kRunning ||
                        verdict.state == ControllerState::kHolding
                    ? 1U
                    : 0U;
    if (verdict.wrong.empty()) return;
    ++failed_;
    std::filesystem::create_directories(request_.out);
    const std::filesystem::path file = request_.out / fmt::format("{}_{}.toml", run.name, run.seed);
    std::ofstream{file} << scenario::write_repro(run, kProgramVersion);
    fmt::print("seed {}: {}\n  meltbench run {} --in-process\n", run.seed, verdict.wrong, file.string());
  }

  std::mutex making_;
  const TortureRequest& request_;
  std::vector<scenario::ResolvedRun> bases_;
  Seeds seeds_;
  std::atomic<std::uint64_t> next_;
  std::mutex mutex_;
  std::size_t done_ = 0, failed_ = 0, running_ = 0, safe_ = 0, fault_ = 0;
};

}  // namespace

ExitStatus torture(const TortureRequest& request) {
  const Seeds seeds = parse_seeds(request.seeds);
  std::vector<scenario::ResolvedRun> bases;
  for (const auto& file : request.scenarios) {
    for (scenario::ResolvedRun& run : scenario::load(file)) bases.push_back(std::move(run));
  }
  runtime::catch_stop_signals();
  for (const int signal : {SIGSEGV, SIGABRT, SIGFPE}) std::signal(signal, tell_crash);
  Torture all{request, std::move(bases), seeds};
  const auto started = std::chrono::steady_clock::now();
  const unsigned jobs =
      std::clamp(request.jobs != 0 ? request.jobs : std::thread::hardware_concurrency(), 1U, kMostJobs);
  std::vector<std::thread> threads;
  for (unsigned i = 1; i < jobs; ++i) threads.emplace_back([&all, i] { all.work(i); });
  all.work(0);
  for (std::thread& thread : threads) thread.join();
  all.print(std::chrono::duration<double>(std::chrono::steady_clock::now() - started).count());
  if (runtime::stop_requested()) return ExitStatus::kLost;
  return all.failed() == 0 ? ExitStatus::kHeld : ExitStatus::kFailed;
}

}  // namespace meltbench::cli
