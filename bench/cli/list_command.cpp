#include "bench/cli/list_command.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <stdexcept>
#include <vector>

#include "bench/cli/prepare_run.hpp"
#include "bench/scenario/scenario.hpp"

namespace meltbench::cli {

std::filesystem::path find_scenarios() {
  const std::filesystem::path here{"fixtures/scenarios"};
  if (std::filesystem::is_directory(here)) return here;
  // build/<preset>/bin/meltbench
  const auto program = std::filesystem::read_symlink("/proc/self/exe");
  return program.parent_path().parent_path().parent_path().parent_path() / here;
}

ExitStatus list_scenarios(const std::filesystem::path& folder) {
  std::vector<std::filesystem::path> files;
  for (const auto& entry : std::filesystem::recursive_directory_iterator{folder}) {
    if (entry.path().extension() == ".toml") files.push_back(entry.path());
  }
  if (files.empty()) throw std::invalid_argument{folder.string() + " holds no scenario"};
  std::ranges::sort(files);
  for (const std::filesystem::path& file : files) {
    const std::vector<scenario::ResolvedRun> runs = scenario::load(file);
    fmt::print("{}\n    {}\n", file.string(), runs.front().title);
    if (runs.front().variant.empty()) continue;
    std::string variants;
    for (const auto& run : runs) variants += (variants.empty() ? "" : ", ") + run.variant;
    fmt::print("    variants: {}\n", variants);
  }
  return ExitStatus::kHeld;
}

ExitStatus list_signals(const std::filesystem::path& scenario) {
  const PreparedRun prepared = prepare(std::move(scenario::load(scenario).front()), {}, {});
  const auto print = [](std::span<const SignalInfo> signals) {
    for (const SignalInfo& signal : signals) {
      fmt::print("{}{}\n", signal.name, signal.kind == SignalKind::kErrorCounter ? "   (error counter)" : "");
    }
  };
  if (prepared.controller) print(prepared.controller->signals());
  if (prepared.plant) print(prepared.plant->signals());
  print(decode::WireSignals{prepared.run.rig.boards, {}}.signals());
  return ExitStatus::kHeld;
}

}  // namespace meltbench::cli
