#include "bench/cli/single_run.hpp"

#include <fmt/format.h>
#include <sched.h>
#include <unistd.h>

#include <array>
#include <chrono>
#include <fstream>
#include <system_error>

#include "bench/bus/broker.hpp"
#include "bench/bus/virtual_time.hpp"
#include "bench/bus/wall_clock_relay.hpp"
#include "bench/cli/child_process.hpp"
#include "bench/cli/progress.hpp"
#include "bench/cli/version.hpp"
#include "bench/record/run_recorder.hpp"
#include "controller/machine/controller.hpp"
#include "plant_emulator/emulator.hpp"
#include "protocols/link/socketcan_link.hpp"
#include "protocols/runtime/stop_signal.hpp"

namespace meltbench::cli {
namespace {

using Clock = std::chrono::steady_clock;

/// Participant numbers: who goes first at one instant. The controller's SYNC then finds the boards not yet woken.
constexpr std::array<std::string_view, 2> kParticipants{"controller", "plant"};

/// Hands what happens to the recorder, and the time to the progress line.
class Observer final : public bus::RunObserver {
 public:
  Observer(record::RunRecorder& recorder, Progress& progress) : recorder_{recorder}, progress_{progress} {}

  void on_frame(const can::StampedFrame& frame, std::size_t sender) override {
    recorder_.frame(frame, static_cast<std::uint8_t>(sender));
  }
  void on_row(Instant at, std::span<const double> values) override {
    recorder_.row(at, values);
    if (++rows_ % kRowsPerLook == 0) progress_.at(at);
  }
  void on_event(std::size_t participant, const Event& event) override {
    recorder_.event(participant < kParticipants.size() ? kParticipants[participant] : "bench", event);
  }

 private:
  static constexpr std::uint64_t kRowsPerLook = 64;
  record::RunRecorder& recorder_;
  Progress& progress_;
  std::uint64_t rows_ = 0;
};

record::RunInfo make_info(const scenario::ResolvedRun& run, const RunRequest& request) {
  record::RunInfo info;
  info.scenario = run.name;
  info.variant = run.variant;
  info.title = run.variant.empty() ? run.title : run.title + ": " + run.variant_title;
  info.seed = run.seed;
  info.duration = run.duration;
  info.pace = request.pace.text();
  info.participants.assign(kParticipants.begin(), kParticipants.end());
  info.nodes.push_back({run.rig.controller_node_id, "controller"});
  for (const config::RigBoard& board : run.rig.boards) info.nodes.push_back({board.node_id, board.name});
  info.bit_rate_bit_per_s = run.rig.bus.bit_rate_bit_per_s;
  info.version = kProgramVersion;
  info.repeat_command = fmt::format("meltbench run {} --seed {}", run.file.string(), run.seed);
  return info;
}

std::vector<SignalInfo> join_signals(std::span<const SignalInfo> first, std::span<const SignalInfo> second) {
  std::vector<SignalInfo> signals{first.begin(), first.end()};
  signals.insert(signals.end(), second.begin(), second.end());
  return signals;
}

record::EndReason to_end_reason(bus::RunOutcome::Kind kind) {
  switch (kind) {
    case bus::RunOutcome::Kind::kInterrupted:
      return record::EndReason::kInterrupted;
    case bus::RunOutcome::Kind::kParticipantLost:
      return record::EndReason::kParticipantLost;
    case bus::RunOutcome::Kind::kCompleted:
      break;
  }
  return record::EndReason::kCompleted;
}

record::Ending to_ending(const bus::RunOutcome& outcome) {
  record::Ending ending;
  ending.reason = to_end_reason(outcome.kind);
  ending.text = outcome.text;
  ending.at = outcome.at;
  ending.lost_frames = outcome.lost_frames;
  return ending;
}

/// The one file that the run needs, and that repeats it. Written once the bus is open: a run that cannot begin leaves
/// nothing.
void write_repro_file(const PreparedRun& prepared) {
  std::filesystem::create_directories(prepared.folder);
  const std::filesystem::path path = prepared.folder / "repro.toml";
  std::ofstream file{path};
  file << scenario::write_repro(prepared.run, kProgramVersion);
  file.close();
  if (!file) throw std::system_error{errno, std::generic_category(), "cannot write " + path.string()};
}

record::Recording run_in_process(PreparedRun& prepared, const RunRequest& request) {
  write_repro_file(prepared);
  runtime::InProcessPort controller{*prepared.controller};
  runtime::InProcessPort plant{*prepared.plant};
  const std::array<runtime::ParticipantPort*, 2> ports{&controller, &plant};
  record::RunRecorder recorder{make_info(prepared.run, request), join_signals(controller.signals(), plant.signals()),
                               prepared.folder};
  Progress progress{prepared.run.label(), prepared.run.duration, request.quiet};
  Observer observer{recorder, progress};
  const bus::RunOutcome outcome =
      bus::VirtualTime{ports, prepared.run.record_period, observer}.run(prepared.run.duration);
  return recorder.finish(to_ending(outcome));
}

/// Keeps this process on one processor, together with the children that are told the same: in lockstep they never run
/// at once, and a message between two processors takes ten times as long.
class OneProcessor {
 public:
  OneProcessor() : cpu_{::sched_getcpu()} {
    ::sched_getaffinity(0, sizeof(before_), &before_);
    cpu_set_t set;
    CPU_ZERO(&set);
    CPU_SET(static_cast<std::size_t>(cpu_), &set);
    ::sched_setaffinity(0, sizeof(set), &set);
  }
  ~OneProcessor() { ::sched_setaffinity(0, sizeof(before_), &before_); }
  OneProcessor(const OneProcessor&) = delete;
  OneProcessor& operator=(const OneProcessor&) = delete;
  [[nodiscard]] int cpu() const { return cpu_; }

 private:
  int cpu_;
  cpu_set_t before_{};
};

std::filesystem::path program_folder() {
  return std::filesystem::read_symlink("/proc/self/exe").parent_path();
}

/// The programs of a run and their connections.
class Programs {
 public:
  Programs(const PreparedRun& prepared, const RunRequest& request, const std::string& bus_name,
           std::optional<int> cpu) {
    const std::string folder = program_folder().string();
    const std::string own_bus = "virtual:" + bus_name;
    const std::string can = request.can.empty() ? own_bus : request.can;
    const std::string rig = (prepared.folder / "repro.toml").string();
    std::vector<std::string> controller{folder + "/controller", "--rig", rig, "--can", can};
    std::vector<std::string> plant{folder + "/plant_emulator",       "--rig", rig, "--can", can, "--seed",
                                   std::to_string(prepared.run.seed)};
    if (can != own_bus) {
      for (auto* command : {&controller, &plant}) command->insert(command->end(), {"--bench", own_bus});
    }
    children_.emplace_back("controller", controller, cpu);
    children_.emplace_back("plant_emulator", plant, cpu);
  }

  /// @throws std::runtime_error naming the program that ended before it joined.
  [[nodiscard]] std::vector<bus::Joined> wait_until_joined(bus::Broker& broker) {
    const std::vector<std::string> names{kParticipants.begin(), kParticipants.end()};
    auto joined = broker.wait_for(names, [this] { return runtime::stop_requested() || !describe_ends().empty(); });
    if (joined) return std::move(*joined);
    throw std::runtime_error{runtime::stop_requested() ? "interrupted before the run began"
                                                       : describe_ends() + " before the run began"};
  }

  /// "plant_emulator was killed by signal 9"; empty if all run.
  [[nodiscard]] std::string describe_ends() {
    std::string text;
    for (ChildProcess& child : children_) {
      const auto end = child.find_end();
      if (end) text += fmt::format("{}{} {}", text.empty() ? "" : ", ", child.name(), *end);
    }
    return text;
  }

  void finish() {
    for (ChildProcess& child : children_) child.finish();
  }

 private:
  std::vector<ChildProcess> children_;
};

/// What the outcome says, and how the processes ended, if one was lost.
bus::RunOutcome end_programs(bus::RunOutcome outcome, std::span<bus::Joined> joined, Programs& programs) {
  const std::string ends = programs.describe_ends();
  for (bus::Joined& program : joined) bus::stop(program);
  if (outcome.kind == bus::RunOutcome::Kind::kParticipantLost && !ends.empty())
    outcome.text += fmt::format(" ({})", ends);
  programs.finish();
  return outcome;
}

/// The name the user gave to the embedded bus, or one that no other run has.
std::string choose_bus_name(const RunRequest& request) {
  const auto uri = request.can.empty() ? std::nullopt : std::optional{link::parse_bus_uri(request.can)};
  const bool named = uri && uri->kind == link::BusUri::Kind::kVirtual;
  return named ? uri->name : fmt::format("run-{}", ::getpid());
}

record::Recording run_in_lockstep(const PreparedRun& prepared, const RunRequest& request) {
  const OneProcessor pinned;
  bus::Broker broker{choose_bus_name(request)};
  write_repro_file(prepared);
  Programs programs{prepared, request, broker.bus_name(), pinned.cpu()};
  std::vector<bus::Joined> joined = programs.wait_until_joined(broker);
  for (bus::Joined& program : joined) {
    static_cast<void>(bus::welcome(program, {link::Pace::kLockstep, 1.0, Nanos{}, prepared.run.record_period}));
  }
  bus::SocketPort controller{joined[0]};
  bus::SocketPort plant{joined[1]};
  const std::array<runtime::ParticipantPort*, 2> ports{&controller, &plant};
  record::RunRecorder recorder{make_info(prepared.run, request), join_signals(controller.signals(), plant.signals()),
                               prepared.folder};
  Progress progress{prepared.run.label(), prepared.run.duration, request.quiet};
  Observer observer{recorder, progress};
  const bus::RunOutcome outcome =
      bus::VirtualTime{ports, prepared.run.record_period, observer}.run(prepared.run.duration);
  return recorder.finish(to_ending(end_programs(outcome, joined, programs)));
}

record::Recording run_at_wall_clock(const PreparedRun& prepared, const RunRequest& request) {
  std::optional<link::SocketCanLink> kernel_bus;
  if (!request.can.empty()) {
    const link::BusUri uri = link::parse_bus_uri(request.can);
    if (uri.kind == link::BusUri::Kind::kSocketCan) kernel_bus.emplace(uri.name);
  }
  bus::Broker broker{choose_bus_name(request)};
  write_repro_file(prepared);
  Programs programs{prepared, request, broker.bus_name(), std::nullopt};
  std::vector<bus::Joined> joined = programs.wait_until_joined(broker);
  Progress progress{prepared.run.label(), prepared.run.duration, request.quiet};
  bus::WallClockRelay relay{joined, kernel_bus ? &*kernel_bus : nullptr, prepared.run.record_period};
  record::RunRecorder recorder{make_info(prepared.run, request), relay.signals(), prepared.folder};
  Observer observer{recorder, progress};
  const auto started = Clock::now();
  const bus::RunOutcome outcome = relay.run(prepared.run.duration, request.pace.speed, observer);
  const double elapsed_s = std::chrono::duration<double>(Clock::now() - started).count();
  record::Ending ending = to_ending(end_programs(outcome, joined, programs));
  ending.real_time_factor = to_s(ending.at) / elapsed_s;
  return recorder.finish(std::move(ending));
}

/// An event that nobody reads would be a fault that never happens.
void require_readers(const scenario::ResolvedRun& run) {
  for (const config::TimelineEvent& event : run.events) {
    if (event.target != "controller" && event.target != "plant") {
      event.section.fail("target", "has no actions", "events are for target = \"controller\" or \"plant\"");
    }
  }
}

}  // namespace

PreparedRun prepare(scenario::ResolvedRun run, std::filesystem::path folder, const RunRequest& request) {
  if (request.seed) run.seed = *request.seed;
  PreparedRun prepared{std::move(run), std::move(folder), {}, nullptr, nullptr};
  const config::Section& root = prepared.run.root;
  const config::Rig& rig = prepared.run.rig;
  prepared.controller = std::make_unique<machine::Controller>(machine::read_settings(root));
  prepared.plant = std::make_unique<emulator::Emulator>(emulator::read_settings(root, rig), prepared.run.seed);
  require_readers(prepared.run);
  prepared.checks = check::read_checks(prepared.run.root);
  prepared.checks.require_signals(join_signals(prepared.controller->signals(), prepared.plant->signals()), false);
  prepared.run.root.finish();
  return prepared;
}

record::Recording execute(PreparedRun& prepared, const RunRequest& request) {
  switch (request.pace.kind) {
    case Pace::Kind::kInProcess:
      return run_in_process(prepared, request);
    case Pace::Kind::kLockstep:
      return run_in_lockstep(prepared, request);
    case Pace::Kind::kRealTime:
      break;
  }
  return run_at_wall_clock(prepared, request);
}

}  // namespace meltbench::cli
