#include "bench/cli/report_command.hpp"

#include <fmt/format.h>

#include <algorithm>

#include "bench/check/read_checks.hpp"
#include "bench/cli/verdict.hpp"
#include "bench/record/load_recording.hpp"
#include "bench/report/report.hpp"
#include "bench/report/results.hpp"
#include "bench/scenario/scenario.hpp"

namespace meltbench::cli {
namespace {

/// The checks for a recording: those of the scenario's variant that it is a run of.
check::CheckSet load_checks(const std::filesystem::path& scenario, const record::RunInfo& info) {
  const std::vector<scenario::ResolvedRun> runs = scenario::load(scenario);
  const auto run = std::ranges::find(runs, info.variant, &scenario::ResolvedRun::variant);
  return check::read_checks(run == runs.end() ? runs.front().root : run->root);
}

/// The run folders that are meant: each itself, or those below it (what a run of several variants leaves).
std::vector<std::filesystem::path> find_runs(const std::vector<std::filesystem::path>& folders) {
  const auto is_run = [](const std::filesystem::path& folder) {
    return std::filesystem::exists(folder / "events.jsonl");
  };
  std::vector<std::filesystem::path> runs;
  for (const std::filesystem::path& folder : folders) {
    const std::size_t before = runs.size();
    if (!is_run(folder) && std::filesystem::is_directory(folder)) {
      for (const auto& entry : std::filesystem::recursive_directory_iterator{folder}) {
        if (entry.is_directory() && is_run(entry.path())) runs.push_back(entry.path());
      }
      std::ranges::sort(runs.begin() + static_cast<std::ptrdiff_t>(before), runs.end());
    }
    if (runs.size() == before) runs.push_back(folder);  // Reading it will say what is missing.
  }
  return runs;
}

}  // namespace

ExitStatus make_report(const std::vector<std::filesystem::path>& folders, std::filesystem::path page) {
  std::vector<record::Recording> recordings;
  std::vector<check::CheckResults> results;
  for (const std::filesystem::path& folder : find_runs(folders)) {
    recordings.push_back(record::load_recording(folder));
    results.push_back(report::load_run_results(folder));
  }
  std::vector<report::Run> runs;
  for (std::size_t i = 0; i < recordings.size(); ++i) runs.push_back({&recordings[i], &results[i]});
  if (page.empty()) page = (folders.size() == 1 ? folders.front() : folders.front().parent_path()) / "report.html";
  report::write_report(page, runs);
  fmt::print("report: {}\n", page.string());
  return ExitStatus::kHeld;
}

ExitStatus check_again(const std::vector<std::filesystem::path>& folders, const std::filesystem::path& scenario) {
  Tally tally;
  for (const std::filesystem::path& folder : find_runs(folders)) {
    const record::Recording recording = record::load_recording(folder);
    const auto file = scenario.empty() ? folder / "repro.toml" : scenario;
    const check::CheckResults results = load_checks(file, recording.info).judge(recording);
    print_verdict(recording, results, 0.0, false);
    tally.add(results);
    if (!scenario.empty()) continue;  // The folder keeps the verdict of its own scenario.
    report::write_run_results(folder, recording, results);
    const report::Run run{&recording, &results};
    report::write_report(folder / "report.html", std::span{&run, 1});
    fmt::print("written anew: result.json, junit.xml, report.html in {}\n", folder.string());
  }
  print_tally(tally);
  return tally.failed == 0 ? ExitStatus::kHeld : ExitStatus::kFailed;
}

}  // namespace meltbench::cli
