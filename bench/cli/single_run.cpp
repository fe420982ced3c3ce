#include "bench/cli/single_run.hpp"

#include <fmt/format.h>
#include <unistd.h>

#include <atomic>
#include <chrono>

#include "bench/bus/broker.hpp"
#include "bench/bus/virtual_time.hpp"
#include "bench/bus/wall_clock_relay.hpp"
#include "bench/cli/bus_timing.hpp"
#include "bench/cli/injection.hpp"
#include "bench/cli/live_faults.hpp"
#include "bench/cli/observer.hpp"
#include "bench/cli/one_processor.hpp"
#include "bench/cli/programs.hpp"
#include "bench/cli/progress.hpp"
#include "bench/cli/repro_file.hpp"
#include "bench/cli/run_tap.hpp"
#include "controller/machine/controller.hpp"
#include "protocols/link/can_link.hpp"
#include "protocols/runtime/real_time_process.hpp"

namespace meltbench::cli {
namespace {

using Clock = std::chrono::steady_clock;

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

void note_bus_timing(const PreparedRun& prepared, bus::BitTimedMedium* medium, Instant end,
                     record::RunRecorder& recorder) {
  if (medium == nullptr) return;
  ResponseBounds bounds;
  if (prepared.controller) bounds = calc_bounds(prepared.run.rig.bus, machine::read_settings(prepared.run.root));
  recorder.bus_timing(describe(*medium, end.since_start, bounds));
}

/// @param broker  where faults may come in from; null: from nowhere.
/// @returns how it ended; the recording is not yet finished.
bus::RunOutcome run_in_virtual_time(PreparedRun& prepared, const RunRequest& request, const Ports& ports,
                                    bus::Outside* outside, bus::Broker* broker,
                                    std::optional<record::RunRecorder>& recorder) {
  std::vector<SignalInfo> signals;
  for (const auto& port : ports) append(signals, port->signals());
  open_recorder(recorder, prepared, std::move(signals));
  Progress progress{prepared.run.label(), prepared.run.duration, request.quiet};
  Observer observer{*recorder, wire_of(prepared), progress};
  Injection faults{prepared.faults, prepared.run.seed, to_pointers(ports), observer};
  std::optional<LiveFaults> live;
  if (broker != nullptr) live.emplace(faults.injector(), *broker, prepared, find_limits(prepared, request), observer);
  bus::RunMedia media = bus::make_media(prepared.run.rig);
  media.outside = outside;
  media.intervention = &faults.injector();
  if (live) media.intervention = &*live;
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
  const bus::RunOutcome outcome = run_in_virtual_time(prepared, request, ports, tap.outside(), nullptr, recorder);
  return recorder->finish(to_ending(outcome));
}

/// The name the user gave to the embedded bus, or one that no other run has.
std::string choose_bus_name(const RunRequest& request) {
  const auto uri = request.can.empty() ? std::nullopt : std::optional{link::parse_bus_uri(request.can)};
  const bool named = uri && uri->kind == link::BusUri::Kind::kVirtual;
  static std::atomic<int> runs = 0;  // A suite has several at once.
  return named ? uri->name : fmt::format("run-{}-{}", ::getpid(), ++runs);
}

/// For who looks for a running bench: where its results go, and what it is.
std::string describe_run(const PreparedRun& prepared) {
  return fmt::format("{}\n{}", std::filesystem::absolute(prepared.folder).lexically_normal().string(),
                     prepared.run.label());
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
  bus::Broker broker{choose_bus_name(request), describe_run(prepared)};
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
  bus::RunOutcome outcome = run_in_virtual_time(prepared, request, ports, tap.outside(), &broker, recorder);
  return recorder->finish(to_ending(end_programs(std::move(outcome), joined, programs)));
}

/// The programs of a run at wall-clock pace, as its faults know them.
std::vector<Member> members_of(std::span<const bus::Joined> joined) {
  std::vector<Member> members;
  for (const bus::Joined& program : joined) {
    members.push_back({program.hello.name, bus::WallClockRelay::signals_of({&program, 1}), program.hello.lines});
  }
  return members;
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
  bus::Broker broker{choose_bus_name(request), describe_run(prepared)};
  write_repro_file(prepared);
  Programs programs{prepared, request, broker.bus_name(), std::nullopt};
  if (!kernel_bus) print_invitation(prepared, broker);
  std::vector<bus::Joined> joined = programs.wait_until_joined(broker, prepared.info.participants);
  std::optional<record::RunRecorder> recorder;
  open_recorder(recorder, prepared, bus::WallClockRelay::signals_of(joined));
  Progress progress{prepared.run.label(), prepared.run.duration, request.quiet};
  Observer observer{*recorder, wire_of(prepared), progress};
  const auto faults = make_injector(prepared.faults, prepared.run.seed, members_of(joined), observer);
  LiveFaults live{*faults, broker, prepared, find_limits(prepared, request), observer};
  bus::RunMedia media = bus::make_media(prepared.run.rig);
  media.outside = tap.outside();
  media.adapter = adapter.get();
  media.intervention = &live;
  bus::WallClockRelay relay{joined, broker, kernel_bus.get(), prepared.run.record_period, media};
  const auto started = Clock::now();
  const bus::RunOutcome outcome = relay.run(prepared.run.duration, prepared.pace.speed, observer);
  const double elapsed_s = std::chrono::duration<double>(Clock::now() - started).count();
  record::Ending ending = to_ending(end_programs(outcome, joined, programs));
  ending.real_time_factor = to_s(ending.at) / elapsed_s;
  note_bus_timing(prepared, relay.medium(), ending.at, *recorder);
  for (auto& [name, lateness] : relay.collect_lateness()) ending.wakeups.push_back({name, lateness});
  return recorder->finish(std::move(ending));
}

}  // namespace

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
