#include "bench/cli/run_command.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <stdexcept>

#include "bench/cli/single_run.hpp"
#include "bench/cli/suite.hpp"
#include "bench/cli/verdict.hpp"
#include "bench/record/load_recording.hpp"
#include "bench/report/report.hpp"
#include "bench/report/results.hpp"
#include "protocols/runtime/stop_signal.hpp"

namespace meltbench::cli {
namespace {

struct JudgedRun {
  record::Recording recording;
  check::CheckResults results;
};

/// Reads all files, and gives each run a folder below `out`: a single run that folder itself.
std::vector<PreparedRun> prepare_all(const RunRequest& request) {
  std::vector<PreparedRun> prepared;
  for (const std::filesystem::path& file : request.scenarios) {
    std::vector<scenario::ResolvedRun> runs = scenario::load(file);
    for (scenario::ResolvedRun& run : runs) {
      std::filesystem::path folder = request.out;
      if (request.scenarios.size() > 1) folder /= run.name;
      if (runs.size() > 1) folder /= run.variant;
      if (std::ranges::find(prepared, folder, &PreparedRun::folder) != prepared.end()) {
        throw std::invalid_argument{
            fmt::format("two scenarios are named \"{}\": rename one, or run it apart", run.label())};
      }
      prepared.push_back(prepare(std::move(run), folder, request));
    }
  }
  return prepared;
}

/// Removes what earlier runs of these scenarios have left below `out` and this one will not replace: a variant that has
/// another name now would else be found by "meltbench report".
void remove_old_runs(const std::filesystem::path& out, const std::vector<PreparedRun>& prepared) {
  std::vector<std::filesystem::path> old;
  const auto look_at = [&](const std::filesystem::path& folder) {
    if (std::ranges::find(prepared, folder, &PreparedRun::folder) != prepared.end()) return;
    const std::string scenario = record::read_scenario_name(folder);
    const auto is_of_it = [&](const PreparedRun& run) { return run.run.name == scenario; };
    if (std::ranges::any_of(prepared, is_of_it)) old.push_back(folder);
  };
  if (!std::filesystem::is_directory(out)) return;
  look_at(out);
  constexpr int kDeepest = 1;  // OUT/SCENARIO/VARIANT
  for (auto entry = std::filesystem::recursive_directory_iterator{out};
       entry != std::filesystem::recursive_directory_iterator{}; ++entry) {
    if (!entry->is_directory()) continue;
    look_at(entry->path());
    if (entry.depth() >= kDeepest) entry.disable_recursion_pending();
  }
  for (const std::filesystem::path& folder : old) record::remove_run(folder);
}

JudgedRun run_and_judge(PreparedRun& prepared, const RunRequest& request) {
  const auto started = std::chrono::steady_clock::now();
  JudgedRun judged{execute(prepared, request), {}};
  const double elapsed_s = std::chrono::duration<double>(std::chrono::steady_clock::now() - started).count();
  judged.results = prepared.checks.judge(judged.recording);
  // Told first: a disk that is full has no room for the files of the verdict either.
  print_verdict(judged.recording, judged.results, to_s(judged.recording.ending.at) / elapsed_s, request.quiet);
  report::write_run_results(prepared.folder, judged.recording, judged.results);
  const report::Run run{&judged.recording, &judged.results};
  report::write_report(prepared.folder / "report.html", std::span{&run, 1});
  return judged;
}

/// One page over all runs; that of a single run is there already.
void write_common_report(const RunRequest& request, const std::vector<JudgedRun>& judged) {
  if (judged.size() > 1) {
    std::vector<report::Run> runs;
    for (const JudgedRun& run : judged) runs.push_back({&run.recording, &run.results});
    report::write_report(request.out / "report.html", runs);
  }
  fmt::print("report: {}\n", (request.out / "report.html").string());
}

}  // namespace

ExitStatus run_scenarios(const RunRequest& request) {
  if (is_suite(request)) return run_suite(request);
  std::vector<PreparedRun> prepared = prepare_all(request);
  remove_old_runs(request.out, prepared);
  runtime::catch_stop_signals();
  std::vector<JudgedRun> judged;
  Tally tally;
  bool lost = false;
  for (PreparedRun& run : prepared) {
    judged.push_back(run_and_judge(run, request));
    tally.add(judged.back().results);
    lost = judged.back().recording.ending.reason != record::EndReason::kCompleted;
    if (lost) break;
  }
  print_tally(tally);
  write_common_report(request, judged);
  if (lost) return ExitStatus::kLost;
  return tally.failed == 0 ? ExitStatus::kHeld : ExitStatus::kFailed;
}

}  // namespace meltbench::cli
