#include "bench/cli/single_run.hpp"

#include <fmt/format.h>
#include <sched.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <deque>
#include <fstream>
#include <stdexcept>
#include <system_error>
#include <thread>

#include "bench/bus/broker.hpp"
#include "bench/bus/virtual_time.hpp"
#include "bench/bus/wall_clock_relay.hpp"
#include "bench/cli/bus_timing.hpp"
#include "bench/cli/child_process.hpp"
#include "bench/cli/injection.hpp"
#include "bench/cli/progress.hpp"
#include "bench/cli/run_tap.hpp"
#include "bench/cli/version.hpp"
#include "bench/record/run_recorder.hpp"
#include "controller/machine/controller.hpp"
#include "plant_emulator/emulator.hpp"
#include "protocols/config/line_ports.hpp"
#include "protocols/link/can_link.hpp"
#include "protocols/runtime/real_time_driver.hpp"
#include "protocols/runtime/real_time_process.hpp"
#include "protocols/runtime/stop_signal.hpp"

namespace meltbench::cli {
namespace {

using Clock = std::chrono::steady_clock;

constexpr const char* kController = "controller";
constexpr const char* kPlant = "plant";

/// Hands what happens to the recorder, and the time to the progress line.
class Observer final : public bus::RunObserver {
 public:
  /// @param wire  null: its signals are not recorded.
  Observer(record::RunRecorder& recorder, decode::WireSignals* wire, Progress& progress)
      : recorder_{recorder},
        names_{recorder.recording().info.participants},
        wire_{wire},
        progress_{progress},
        next_flush_{recorder.recording().info.in_virtual_time() ? Instant::never() : Instant{kFlushPeriod}} {}

  void on_frame(const can::StampedFrame& frame, std::size_t sender) override {
    recorder_.frame(frame, static_cast<std::uint8_t>(sender));
    if (wire_ != nullptr) not_in_a_row_.push_back(frame);
  }
  void on_serial(std::string_view line, std::size_t sender, Instant at, std::span<const std::uint8_t> bytes) override {
    recorder_.serial(line, name_of(sender), at, bytes);
  }
  void on_row(Instant at, std::span<const double> values) override {
    recorder_.row(at, wire_ == nullptr ? values : append_wire(at, values));
    if (++rows_ % kRowsPerLook == 0) progress_.at(at);
    if (at < next_flush_) return;
    next_flush_ = at + kFlushPeriod;
    recorder_.flush();
  }
  void on_event(std::size_t participant, const Event& event) override { recorder_.event(name_of(participant), event); }
  void on_join(std::string_view name) override { names_.emplace_back(name); }

 private:
  [[nodiscard]] std::string_view name_of(std::size_t participant) const {
    return participant < names_.size() ? std::string_view{names_[participant]} : "bench";
  }

  /// At wall-clock pace a row comes later than the frames of its instant.
  std::span<const double> append_wire(Instant at, std::span<const double> values) {
    for (; !not_in_a_row_.empty() && not_in_a_row_.front().at <= at; not_in_a_row_.pop_front()) {
      wire_->on_frame(not_in_a_row_.front().frame);
    }
    row_.assign(values.begin(), values.end());
    row_.resize(values.size() + wire_->signals().size());
    wire_->read(std::span{row_}.subspan(values.size()));
    return row_;
  }

  static constexpr std::uint64_t kRowsPerLook = 64;
  static constexpr Nanos kFlushPeriod = 1s;
  record::RunRecorder& recorder_;
  std::vector<std::string> names_;
  decode::WireSignals* wire_;
  std::deque<can::StampedFrame> not_in_a_row_;
  std::vector<double> row_;
  Progress& progress_;
  std::uint64_t rows_ = 0;
  Instant next_flush_;  ///< never: the recorder's own blocks do, in virtual time a second is nothing.
};

/// Participants by number: who goes first at one instant. The controller's SYNC then finds the boards not yet woken.
/// At wall-clock pace those that the bench starts; in virtual time also a controller that is started by hand.
std::vector<std::string> name_participants(const PreparedRun& prepared) {
  std::vector<std::string> names;
  if (prepared.controller || prepared.pace.kind == Pace::Kind::kLockstep) names.emplace_back(kController);
  if (prepared.plant) names.emplace_back(kPlant);
  return names;
}

/// First words of what the bench cannot record in this run.
std::vector<std::string> name_unseen(const PreparedRun& prepared) {
  std::vector<std::string> unseen;
  const std::vector<std::string>& there = prepared.info.participants;
  if (std::ranges::find(there, kController) == there.end()) unseen.emplace_back(kController);
  if (!prepared.run.rig.has_real_board()) return unseen;
  unseen.insert(unseen.end(), {kPlant, "melt", "barrel"});
  for (const config::RigBoard& board : prepared.run.rig.boards) {
    if (board.is_real) unseen.push_back(board.name);
  }
  return unseen;
}

/// What to type for the same run; everything that the user gave but where its results go.
std::string make_repeat_command(const PreparedRun& prepared, const RunRequest& request) {
  std::string command = fmt::format("meltbench run {} --seed {}", prepared.run.file.string(), prepared.run.seed);
  if (prepared.pace.kind == Pace::Kind::kInProcess) {
    command += " --in-process";
  } else if (request.pace_given || !prepared.pace.is_virtual()) {
    command += " --pace " + prepared.pace.text();
  }
  if (!request.can.empty()) command += " --can " + request.can;
  if (!request.controller_can.empty()) command += " --controller-can " + request.controller_can;
  if (request.rt_priority) command += fmt::format(" --rt {}", *request.rt_priority);
  return command;
}

record::RunInfo make_info(const PreparedRun& prepared, const RunRequest& request) {
  const scenario::ResolvedRun& run = prepared.run;
  record::RunInfo info;
  info.scenario = run.name;
  info.variant = run.variant;
  info.title = run.variant.empty() ? run.title : run.title + ": " + run.variant_title;
  info.text = run.text;
  info.seed = run.seed;
  info.duration = run.duration;
  info.pace = prepared.pace.text();
  info.participants = name_participants(prepared);
  info.nodes.push_back({run.rig.controller_node_id, "controller"});
  for (const config::RigBoard& board : run.rig.boards) {
    if (!board.is_on_line()) info.nodes.push_back({board.node_id, board.name});
  }
  info.has_serial_lines = !run.rig.lines.empty();
  info.bit_rate_bit_per_s = run.rig.bus.bit_rate_bit_per_s;
  info.version = kProgramVersion;
  info.repeat_command = make_repeat_command(prepared, request);
  return info;
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

/// The ports of a run in virtual time, in the order of their numbers.
std::vector<runtime::ParticipantPort*> to_pointers(std::span<const std::unique_ptr<runtime::ParticipantPort>> ports) {
  std::vector<runtime::ParticipantPort*> pointers;
  for (const auto& port : ports) pointers.push_back(port.get());
  return pointers;
}

void append(std::vector<SignalInfo>& signals, std::span<const SignalInfo> more) {
  signals.insert(signals.end(), more.begin(), more.end());
}

/// A recorder for the participants' signals, and those of the wire behind them.
void open_recorder(std::optional<record::RunRecorder>& recorder, const PreparedRun& prepared,
                   std::vector<SignalInfo> signals) {
  if (prepared.wire) append(signals, prepared.wire->signals());
  recorder.emplace(prepared.info, std::move(signals), prepared.folder);
}

decode::WireSignals* wire_of(PreparedRun& prepared) {
  return prepared.wire ? &*prepared.wire : nullptr;
}

using Ports = std::vector<std::unique_ptr<runtime::ParticipantPort>>;

std::optional<bus::BitTimedSettings> bit_timing_of(const config::RigBus& can) {
  if (can.fidelity == config::BusFidelity::kIdeal) return std::nullopt;
  return bus::to_settings(can);
}

void note_bus_timing(const PreparedRun& prepared, bus::BitTimedMedium* medium, Instant end,
                     record::RunRecorder& recorder) {
  if (medium == nullptr) return;
  ResponseBounds bounds;
  if (prepared.controller) bounds = calc_bounds(prepared.run.rig.bus, machine::read_settings(prepared.run.root));
  recorder.bus_timing(describe(*medium, end.since_start, bounds));
}

/// @returns how it ended; the recording is not yet finished.
bus::RunOutcome run_in_virtual_time(PreparedRun& prepared, const RunRequest& request, const Ports& ports,
                                    bus::Outside* outside, std::optional<record::RunRecorder>& recorder) {
  std::vector<SignalInfo> signals;
  for (const auto& port : ports) append(signals, port->signals());
  open_recorder(recorder, prepared, std::move(signals));
  Progress progress{prepared.run.label(), prepared.run.duration, request.quiet};
  Observer observer{*recorder, wire_of(prepared), progress};
  Injection faults{prepared.faults, prepared.run.seed, to_pointers(ports), observer};
  bus::RunMedia media{.lines = prepared.run.rig.lines, .outside = outside, .intervention = &faults.injector()};
  media.bit_timed = bit_timing_of(prepared.run.rig.bus);
  bus::VirtualTime time{faults.ports(), prepared.run.record_period, observer, media};
  const bus::RunOutcome outcome = time.run(prepared.run.duration);
  note_bus_timing(prepared, time.medium(), outcome.at, *recorder);
  return outcome;
}

record::Recording run_in_process(PreparedRun& prepared, const RunRequest& request) {
  RunTap tap{request};
  write_repro_file(prepared);
  Ports ports;
  ports.push_back(std::make_unique<runtime::InProcessPort>(*prepared.controller));
  ports.push_back(std::make_unique<runtime::InProcessPort>(*prepared.plant));
  std::optional<record::RunRecorder> recorder;
  const bus::RunOutcome outcome = run_in_virtual_time(prepared, request, ports, tap.outside(), recorder);
  return recorder->finish(to_ending(outcome));
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

std::vector<std::string> line_options(const std::vector<std::string>& lines) {
  std::vector<std::string> options;
  for (const std::string& line : lines) options.insert(options.end(), {"--line", line});
  return options;
}

/// The controller before the boards, as at one instant of virtual time: its SYNC must not wait for their arithmetic.
int priority_of(std::string_view program, const RunRequest& request) {
  return std::max(*request.rt_priority - (program == kController ? 0 : 1), 1);
}

/// The programs of a run and their connections.
class Programs {
 public:
  Programs(const PreparedRun& prepared, const RunRequest& request, const std::string& bus_name,
           std::optional<int> cpu) {
    const std::string folder = program_folder().string();
    const std::string own_bus = "virtual:" + bus_name;
    // The bench has opened an adapter itself: nobody else can.
    const bool on_own_bus = request.can.empty() || link::parse_bus_uri(request.can).kind == link::BusUri::Kind::kSlcan;
    const std::string can = on_own_bus ? own_bus : request.can;
    const std::string rig = (prepared.folder / "repro.toml").string();
    const auto start = [&](const char* program, const std::string& bus, std::vector<std::string> more) {
      std::vector<std::string> command{fmt::format("{}/{}", folder, program), "--rig", rig, "--can", bus};
      command.insert(command.end(), more.begin(), more.end());
      if (bus != own_bus) command.insert(command.end(), {"--bench", own_bus});
      if (request.rt_priority) command.insert(command.end(), {"--rt", std::to_string(priority_of(program, request))});
      children_.emplace_back(program, command, cpu);
    };
    if (prepared.plant) {
      std::vector<std::string> more = line_options(prepared.plant_lines);
      more.insert(more.end(), {"--seed", std::to_string(prepared.run.seed)});
      remove_pseudo_terminals(prepared.plant_lines);
      start("plant_emulator", can, more);
      wait_for_pseudo_terminals(prepared.plant_lines);
    }
    if (prepared.controller) {
      start("controller", request.controller_can.empty() ? can : request.controller_can,
            line_options(prepared.controller_lines));
    }
  }

  /// @throws std::runtime_error naming the program that ended before it joined.
  [[nodiscard]] std::vector<bus::Joined> wait_until_joined(bus::Broker& broker, std::span<const std::string> names) {
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
  /// Names of the pseudo-terminals that a program makes: "pty:NAME".
  static std::vector<std::filesystem::path> pseudo_terminals(const std::vector<std::string>& lines) {
    std::vector<std::filesystem::path> names;
    for (const std::string& line : lines) {
      const std::size_t at = line.find("=pty:");
      if (at != std::string::npos) names.emplace_back(line.substr(at + 5));
    }
    return names;
  }
  static void remove_pseudo_terminals(const std::vector<std::string>& lines) {
    for (const auto& name : pseudo_terminals(lines)) {
      if (std::filesystem::is_symlink(name)) std::filesystem::remove(name);
    }
  }
  /// The controller may be told to open what the emulator makes. One that ends instead is told of later.
  void wait_for_pseudo_terminals(const std::vector<std::string>& lines) {
    for (const auto& name : pseudo_terminals(lines)) {
      while (!std::filesystem::is_symlink(name) && describe_ends().empty() && !runtime::stop_requested()) {
        std::this_thread::sleep_for(1ms);
      }
    }
  }

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
  static std::atomic<int> runs = 0;  // A suite has several at once.
  return named ? uri->name : fmt::format("run-{}-{}", ::getpid(), ++runs);
}

/// Tells how parts that are not ours get onto an embedded bus.
void print_invitation(const PreparedRun& prepared, const bus::Broker& broker) {
  if (prepared.controller && !prepared.run.rig.has_real_board()) return;
  fmt::print(stderr, "the bus is virtual:{}", broker.bus_name());
  if (!prepared.controller) {
    fmt::print(stderr, "; an external controller of ours joins it with: controller --rig {} --can virtual:{}",
               (prepared.folder / "repro.toml").string(), broker.bus_name());
  }
  fmt::print(stderr, "\n");
}

record::Recording run_in_lockstep(PreparedRun& prepared, const RunRequest& request) {
  const OneProcessor pinned;
  RunTap tap{request};
  bus::Broker broker{choose_bus_name(request)};
  write_repro_file(prepared);
  Programs programs{prepared, request, broker.bus_name(), pinned.cpu()};
  print_invitation(prepared, broker);
  std::vector<bus::Joined> joined = programs.wait_until_joined(broker, prepared.info.participants);
  Ports ports;
  for (bus::Joined& program : joined) {
    static_cast<void>(bus::welcome(program, {link::Pace::kLockstep, 1.0, Nanos{}, prepared.run.record_period}));
    ports.push_back(std::make_unique<bus::SocketPort>(program));
  }
  std::optional<record::RunRecorder> recorder;
  bus::RunOutcome outcome = run_in_virtual_time(prepared, request, ports, tap.outside(), recorder);
  return recorder->finish(to_ending(end_programs(std::move(outcome), joined, programs)));
}

record::Recording run_at_wall_clock(PreparedRun& prepared, const RunRequest& request) {
  std::unique_ptr<link::CanLink> kernel_bus;
  std::unique_ptr<link::CanLink> adapter;
  if (!request.can.empty()) {
    const link::BusUri uri = link::parse_bus_uri(request.can);
    if (uri.kind == link::BusUri::Kind::kSocketCan) kernel_bus = link::open_can_link(uri);
    if (uri.kind == link::BusUri::Kind::kSlcan) adapter = link::open_can_link(uri);
  }
  RunTap tap{request};
  // The relay is part of the way of a frame. On a kernel bus it only listens, and must not hold up those who speak.
  if (request.rt_priority && !kernel_bus) runtime::take_priority(*request.rt_priority);
  bus::Broker broker{choose_bus_name(request)};
  write_repro_file(prepared);
  Programs programs{prepared, request, broker.bus_name(), std::nullopt};
  if (!kernel_bus) print_invitation(prepared, broker);
  std::vector<bus::Joined> joined = programs.wait_until_joined(broker, prepared.info.participants);
  Progress progress{prepared.run.label(), prepared.run.duration, request.quiet};
  bus::WallClockRelay relay{joined,
                            broker,
                            kernel_bus.get(),
                            prepared.run.record_period,
                            {.lines = prepared.run.rig.lines,
                             .outside = tap.outside(),
                             .adapter = adapter.get(),
                             .bit_timed = bit_timing_of(prepared.run.rig.bus)}};
  std::optional<record::RunRecorder> recorder;
  open_recorder(recorder, prepared, relay.signals());
  Observer observer{*recorder, wire_of(prepared), progress};
  const auto started = Clock::now();
  const bus::RunOutcome outcome = relay.run(prepared.run.duration, prepared.pace.speed, observer);
  const double elapsed_s = std::chrono::duration<double>(Clock::now() - started).count();
  record::Ending ending = to_ending(end_programs(outcome, joined, programs));
  ending.real_time_factor = to_s(ending.at) / elapsed_s;
  note_bus_timing(prepared, relay.medium(), ending.at, *recorder);
  for (auto& [name, lateness] : relay.collect_lateness()) ending.wakeups.push_back({name, lateness});
  return recorder->finish(std::move(ending));
}

/// An event that nobody obeys would be a fault that never happens.
void require_readers(const PreparedRun& prepared) {
  for (const config::TimelineEvent& event : prepared.run.events) {
    if (event.target == kController) {
      if (std::ranges::find(prepared.info.participants, kController) != prepared.info.participants.end()) continue;
      event.section.fail("target", "takes no orders: it is external", "give the order by its own means");
    }
    if (event.target != kPlant) {
      event.section.fail("target", "has no actions", "events are for target = \"controller\" or \"plant\"");
    }
    if (prepared.run.rig.has_real_board()) {
      event.section.fail("target", "takes no orders: boards of this rig are real", "the model is not the machine");
    }
  }
}

/// Gives each port to the program that opens it.
/// @throws std::invalid_argument for words that name no line of the rig, or a program that is not ours.
void assign_ports(PreparedRun& prepared, const RunRequest& request) {
  const config::Rig& rig = prepared.run.rig;
  prepared.controller_lines = request.controller_lines;
  for (const serial::LinePort& port : config::read_line_ports(request.lines, rig)) {
    const bool emulated = std::ranges::any_of(
        rig.boards, [&](const config::RigBoard& board) { return board.line == port.line && !board.is_real; });
    auto& lines = emulated ? prepared.plant_lines : prepared.controller_lines;
    lines.push_back(fmt::format("{}={}", port.line, port.port));
  }
  static_cast<void>(config::read_line_ports(prepared.controller_lines, rig));
  if (!prepared.controller && !prepared.controller_lines.empty()) {
    throw std::invalid_argument{"the controller is external: give it its serial port by its own means"};
  }
}

/// How time passes in this run: real parts have a clock of their own.
/// @throws config::ConfigError if the user asked for virtual time.
Pace choose_pace(const scenario::ResolvedRun& run, const RunRequest& request) {
  Pace pace = request.pace;
  if (!pace.is_virtual() || (!run.rig.has_real_board() && !run.rig.controller_is_external)) return pace;
  if (!request.pace_given) {
    pace.kind = Pace::Kind::kRealTime;
    return pace;
  }
  constexpr const char* kHint = "use --pace realtime, or leave --pace away";
  if (run.rig.has_real_board()) run.root.fail_here("real boards have no virtual time", kHint);
  if (pace.kind == Pace::Kind::kInProcess) run.root.fail_here("an external controller is not in this process", kHint);
  return pace;
}

}  // namespace

PreparedRun prepare(scenario::ResolvedRun run, std::filesystem::path folder, const RunRequest& request) {
  if (request.seed) run.seed = *request.seed;
  const Pace pace = choose_pace(run, request);
  if (request.rt_priority && pace.is_virtual()) {
    throw std::invalid_argument{"--rt is for wall-clock pace: virtual time waits for everybody"};
  }
  PreparedRun prepared{std::move(run), std::move(folder), pace, {}, {}, {}, nullptr, nullptr, {}, {}, std::nullopt};
  const config::Section& root = prepared.run.root;
  const config::Rig& rig = prepared.run.rig;
  std::vector<SignalInfo> signals;
  if (!rig.controller_is_external) {
    prepared.controller = std::make_unique<machine::Controller>(machine::read_settings(root));
    append(signals, prepared.controller->signals());
  }
  if (rig.has_emulated_board()) {
    prepared.plant = std::make_unique<emulator::Emulator>(emulator::read_settings(root, rig), prepared.run.seed);
    append(signals, prepared.plant->signals());
  }
  assign_ports(prepared, request);
  prepared.info = make_info(prepared, request);
  prepared.info.unseen = name_unseen(prepared);
  require_readers(prepared);
  prepared.faults = fault::read_faults(root, fault::make_scope(root, rig));
  if (!prepared.faults.empty() && !pace.is_virtual()) {
    throw config::ConfigError{prepared.faults.front().table.origin, "faults need virtual time",
                              "drop --pace and --can"};
  }
  prepared.checks = check::read_checks(prepared.run.root);
  const std::vector<std::string> asked_for = prepared.checks.signal_names();
  const auto is_of_wire = [](const std::string& name) { return name.starts_with("wire."); };
  if (rig.has_real_board() || rig.controller_is_external || std::ranges::any_of(asked_for, is_of_wire)) {
    prepared.wire.emplace(rig.boards, asked_for);
    append(signals, prepared.wire->signals());
  }
  if (!pace.is_virtual()) {
    for (const std::string& name : prepared.info.participants) append(signals, runtime::real_time_signals(name));
  }
  record::RunInfo known = prepared.info;
  if (!prepared.controller) known.unseen.emplace_back(kController);  // Its signals are known when it has joined.
  prepared.checks.require_signals(signals, known);
  prepared.checks.require_times(prepared.run.duration);
  prepared.run.root.finish();
  return prepared;
}

record::Recording execute(PreparedRun& prepared, const RunRequest& request) {
  switch (prepared.pace.kind) {
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
