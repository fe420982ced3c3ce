#pragma once
/// The verdict of a run as files: result.json for scripts, junit.xml for build servers.

#include <filesystem>
#include <string>

#include "bench/check/check.hpp"
#include "bench/record/recording.hpp"

namespace meltbench::report {

/// result.json: scenario, variant (if any), seed, held, real_time_factor (null in virtual time), end, checks, bus,
/// health, responses, signals. Same recording, same bytes. A margin that is not finite is null.
[[nodiscard]] std::string write_result_json(const record::Recording& recording, const check::CheckResults& results);

/// JUnit XML as Jenkins and GitLab read it: one suite per run, one test case per check, skipped ones marked.
[[nodiscard]] std::string write_junit_xml(const record::Recording& recording, const check::CheckResults& results);

/// Writes result.json and junit.xml into the run's folder, each whole or not at all.
/// @throws std::system_error naming the path.
void write_run_results(const std::filesystem::path& folder, const record::Recording& recording,
                       const check::CheckResults& results);

/// Reads result.json back, for `meltbench report FOLDER`.
/// @throws record::LoadError if it is missing or is not a result of ours.
[[nodiscard]] check::CheckResults load_run_results(const std::filesystem::path& folder);

}  // namespace meltbench::report
