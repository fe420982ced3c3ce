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

}  // namespace

ExitStatus make_report(const std::vector<std::filesystem::path>& folders, std::filesystem::path page) {
  std::vector<record::Recording> recordings;
  std::vector<check::CheckResults> results;
  for (const std::filesystem::path& folder : folders) {
    recordings.push_back(record::load_recording(folder));
    results.push_back(report::load_run_results(folder));
  }
  std::vector<report::Run> runs;
  for (std::size_t i = 0; i < recordings.size(); ++i) runs.push_back({&recordings[i], &results[i]});
  if (page.empty()) page = folders.front() / "report.html";
  report::write_report(page, runs);
  fmt::print("report: {}\n", page.string());
  return ExitStatus::kHeld;
}

ExitStatus check_again(const std::vector<std::filesystem::path>& folders, const std::filesystem::path& scenario) {
  Tally tally;
  for (const std::filesystem::path& folder : folders) {
    const record::Recording recording = record::load_recording(folder);
    const auto file = scenario.empty() ? folder / "repro.toml" : scenario;
    const check::CheckResults results = load_checks(file, recording.info).judge(recording);
    report::write_run_results(folder, recording, results);
    print_verdict(recording, results, 0.0, false);
    tally.add(results);
  }
  print_tally(tally);
  return tally.failed == 0 ? ExitStatus::kHeld : ExitStatus::kFailed;
}

}  // namespace meltbench::cli
