#include "bench/cli/prepare_run.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <stdexcept>

#include "bench/cli/fault_limits.hpp"
#include "bench/cli/run_info.hpp"
#include "controller/machine/controller.hpp"
#include "plant_emulator/emulator.hpp"
#include "protocols/config/line_ports.hpp"
#include "protocols/participant/restartable.hpp"
#include "protocols/runtime/real_time_driver.hpp"

namespace meltbench::cli {
namespace {

void append(std::vector<SignalInfo>& signals, std::span<const SignalInfo> more) {
  signals.insert(signals.end(), more.begin(), more.end());
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
    prepared.controller = std::make_unique<Restartable>(
        [settings = machine::read_settings(root)] { return std::make_unique<machine::Controller>(settings); });
    append(signals, prepared.controller->signals());
  }
  if (rig.has_emulated_board()) {
    prepared.plant = std::make_unique<emulator::Emulator>(emulator::read_settings(root, rig), prepared.run.seed);
    append(signals, prepared.plant->signals());
  }
  assign_ports(prepared, request);
  prepared.info = make_info(prepared, request);
  require_readers(prepared);
  prepared.faults = fault::read_faults(root, fault::make_scope(root, rig));
  for (const fault::Fault& fault : prepared.faults) require_possible(fault, find_limits(prepared, request));
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

}  // namespace meltbench::cli
