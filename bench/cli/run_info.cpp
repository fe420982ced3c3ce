#include "bench/cli/run_info.hpp"

#include <fmt/format.h>

#include <algorithm>

#include "bench/cli/version.hpp"

namespace meltbench::cli {
namespace {

/// Participants by number: who goes first at one instant. The controller's SYNC then finds the boards not yet woken.
/// At wall-clock pace those that the bench starts; in virtual time also a controller that is started by hand.
std::vector<std::string> name_participants(const PreparedRun& prepared) {
  std::vector<std::string> names;
  if (prepared.controller || prepared.pace.kind == Pace::Kind::kLockstep) names.emplace_back(kController);
  if (prepared.plant) names.emplace_back(kPlant);
  return names;
}

/// First words of what the bench cannot record in this run.
std::vector<std::string> name_unseen(const PreparedRun& prepared, const std::vector<std::string>& there) {
  std::vector<std::string> unseen;
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

}  // namespace

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
  info.unseen = name_unseen(prepared, info.participants);
  return info;
}

}  // namespace meltbench::cli
