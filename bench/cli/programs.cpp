#include "bench/cli/programs.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <filesystem>
#include <stdexcept>
#include <thread>

#include "bench/cli/run_info.hpp"
#include "protocols/link/can_link.hpp"
#include "protocols/runtime/stop_signal.hpp"

namespace meltbench::cli {
namespace {

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

/// Names of the pseudo-terminals that a program makes: "pty:NAME".
std::vector<std::filesystem::path> pseudo_terminals(const std::vector<std::string>& lines) {
  std::vector<std::filesystem::path> names;
  for (const std::string& line : lines) {
    const std::size_t at = line.find("=pty:");
    if (at != std::string::npos) names.emplace_back(line.substr(at + 5));
  }
  return names;
}

void remove_pseudo_terminals(const std::vector<std::string>& lines) {
  for (const auto& name : pseudo_terminals(lines)) {
    if (std::filesystem::is_symlink(name)) std::filesystem::remove(name);
  }
}

}  // namespace

Programs::Programs(const PreparedRun& prepared, const RunRequest& request, const std::string& bus_name,
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

std::vector<bus::Joined> Programs::wait_until_joined(bus::Broker& broker, std::span<const std::string> names) {
  auto joined = broker.wait_for(names, [this] { return runtime::stop_requested() || !describe_ends().empty(); });
  if (joined) return std::move(*joined);
  if (runtime::stop_requested()) throw std::runtime_error{"interrupted before the run began"};
  const std::string ends = describe_ends() + " before the run began";
  if (std::ranges::any_of(children_, &ChildProcess::has_refused)) {
    throw link::LinkError{ends, "why, and what to do about it, is what it says above"};
  }
  throw std::runtime_error{ends};
}

std::string Programs::describe_ends() {
  std::string text;
  for (ChildProcess& child : children_) {
    const auto end = child.find_end();
    if (end) text += fmt::format("{}{} {}", text.empty() ? "" : ", ", child.name(), *end);
  }
  return text;
}

void Programs::finish() {
  for (ChildProcess& child : children_) child.finish();
}

/// The controller may be told to open what the emulator makes. One that ends instead is told of later.
void Programs::wait_for_pseudo_terminals(const std::vector<std::string>& lines) {
  for (const auto& name : pseudo_terminals(lines)) {
    while (!std::filesystem::is_symlink(name) && describe_ends().empty() && !runtime::stop_requested()) {
      std::this_thread::sleep_for(1ms);
    }
  }
}

bus::RunOutcome end_programs(bus::RunOutcome outcome, std::span<bus::Joined> joined, Programs& programs) {
  const std::string ends = programs.describe_ends();
  for (bus::Joined& program : joined) bus::stop(program);
  if (outcome.kind == bus::RunOutcome::Kind::kParticipantLost && !ends.empty())
    outcome.text += fmt::format(" ({})", ends);
  programs.finish();
  return outcome;
}

}  // namespace meltbench::cli
