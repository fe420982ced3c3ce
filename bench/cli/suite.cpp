#include "bench/cli/suite.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cmath>
#include <exception>
#include <mutex>
#include <stdexcept>
#include <thread>
#include <utility>

#include "bench/cli/single_run.hpp"
#include "bench/cli/verdict.hpp"
#include "bench/report/matrix.hpp"
#include "bench/report/report.hpp"
#include "bench/report/results.hpp"
#include "protocols/runtime/stop_signal.hpp"

namespace meltbench::cli {
namespace {

/// A run of the suite, and what came of it.
struct SuiteRun {
  PreparedRun prepared;
  report::MatrixCell cell;
  bool lost = false;
};

std::vector<std::filesystem::path> list_scenario_files(const std::filesystem::path& folder) {
  std::vector<std::filesystem::path> files;
  for (const auto& entry : std::filesystem::directory_iterator{folder}) {
    if (entry.path().extension() == ".toml") files.push_back(entry.path());
  }
  std::sort(files.begin(), files.end());
  if (files.empty()) throw std::invalid_argument{folder.string() + " holds no scenario"};
  return files;
}

/// By its first fault; a run without one by its scenario.
report::MatrixCell make_cell(const PreparedRun& prepared, const std::filesystem::path& out) {
  report::MatrixCell cell;
  cell.name = prepared.run.label();
  cell.row = prepared.run.name;
  cell.column = prepared.run.variant;
  if (!prepared.faults.empty()) {
    const fault::Fault& fault = prepared.faults.front();
    cell.row = std::string{fault::name_of(fault.target)} + (fault.object.empty() ? "" : "." + fault.object);
    cell.column = fault.info->name;
  }
  cell.report = (prepared.folder / "report.html").lexically_relative(out);
  return cell;
}

std::vector<SuiteRun> prepare_suite(const RunRequest& request) {
  std::vector<SuiteRun> runs;
  for (const auto& file : list_scenario_files(request.scenarios.front())) {
    for (scenario::ResolvedRun& run : scenario::load(file)) {
      const std::filesystem::path folder = request.out / run.name / run.variant;
      PreparedRun prepared = prepare(std::move(run), folder, request);
      report::MatrixCell cell = make_cell(prepared, request.out);
      runs.push_back({std::move(prepared), std::move(cell), false});
    }
  }
  return runs;
}

/// What a run's verdict comes down to in one line.
std::string summarise(const check::CheckResults& results) {
  for (const check::CheckResult& result : results.checks) {
    if (!result.held && result.skipped.empty()) return fmt::format("{}: {}", result.name, result.text);
  }
  return fmt::format("{} checks held", results.checks.size());
}

class Suite {
 public:
  Suite(const RunRequest& request, std::vector<SuiteRun>& runs) : request_{request}, runs_{runs} {
    request_.quiet = true;
  }

  void work() {
    for (std::size_t i = next_++; i < runs_.size() && !runtime::stop_requested(); i = next_++) {
      try {
        carry_out(runs_[i]);
      } catch (...) {
        const std::lock_guard lock{mutex_};
        if (!failure_) failure_ = std::current_exception();
        next_ = runs_.size();
      }
    }
  }

  /// @throws what a run has thrown.
  [[nodiscard]] const Tally& finish() const {
    if (failure_) std::rethrow_exception(failure_);
    return tally_;
  }

 private:
  void carry_out(SuiteRun& run) {
    const auto started = std::chrono::steady_clock::now();
    const record::Recording recording = execute(run.prepared, request_);
    const double elapsed_s = std::chrono::duration<double>(std::chrono::steady_clock::now() - started).count();
    const check::CheckResults results = run.prepared.checks.judge(recording);
    report::write_run_results(run.prepared.folder, recording, results);
    const report::Run page{&recording, &results};
    report::write_report(run.prepared.folder / "report.html", std::span{&page, 1});
    run.cell.held = results.held() && recording.ending.reason == record::EndReason::kCompleted;
    run.cell.note = summarise(results);
    run.lost = recording.ending.reason != record::EndReason::kCompleted;
    run.prepared.controller.reset();
    run.prepared.plant.reset();
    const std::lock_guard lock{mutex_};
    tally_.add(results);
    print_verdict(recording, results, to_s(recording.ending.at) / elapsed_s, true);
  }

  RunRequest request_;
  std::vector<SuiteRun>& runs_;
  std::atomic<std::size_t> next_ = 0;
  std::mutex mutex_;
  Tally tally_;
  std::exception_ptr failure_;
};

/// One line per target: what was tried on it.
void print_matrix(std::span<const report::MatrixCell> cells) {
  std::vector<std::string> rows;
  std::size_t width = 0;
  for (const report::MatrixCell& cell : cells) {
    width = std::max(width, cell.row.size());
    if (std::find(rows.begin(), rows.end(), cell.row) == rows.end()) rows.push_back(cell.row);
  }
  for (const std::string& row : rows) {
    std::string line;
    for (const report::MatrixCell& cell : cells) {
      if (cell.row == row) line += fmt::format("{}{}  ", cell.held ? "" : "FAILED:", cell.column);
    }
    fmt::print("  {:<{}}  {}\n", row, width, line);
  }
}

}  // namespace

bool is_suite(const RunRequest& request) {
  return request.scenarios.size() == 1 && std::filesystem::is_directory(request.scenarios.front());
}

ExitStatus run_suite(const RunRequest& request) {
  std::vector<SuiteRun> runs = prepare_suite(request);
  runtime::catch_stop_signals();
  Suite suite{request, runs};
  std::vector<std::thread> threads;
  for (unsigned i = 1; i < std::thread::hardware_concurrency(); ++i) threads.emplace_back([&suite] { suite.work(); });
  suite.work();
  for (std::thread& thread : threads) thread.join();
  const Tally& tally = suite.finish();
  std::vector<report::MatrixCell> cells;
  for (const SuiteRun& run : runs) cells.push_back(run.cell);
  print_matrix(cells);
  print_tally(tally);
  const std::filesystem::path page = request.out / "suite.html";
  report::write_matrix(page, request.scenarios.front().filename().string(), cells);
  fmt::print("report: {}\n", page.string());
  if (runtime::stop_requested() || std::ranges::any_of(runs, &SuiteRun::lost)) return ExitStatus::kLost;
  return tally.failed == 0 ? ExitStatus::kHeld : ExitStatus::kFailed;
}

}  // namespace meltbench::cli
