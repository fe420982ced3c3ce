#pragma once

#include <filesystem>
#include <memory>
#include <optional>
#include <vector>

#include "bench/check/read_checks.hpp"
#include "bench/cli/run_request.hpp"
#include "bench/decode/wire_signals.hpp"
#include "bench/record/recording.hpp"
#include "bench/scenario/scenario.hpp"
#include "protocols/fault/fault.hpp"
#include "protocols/participant/participant.hpp"

namespace meltbench::cli {

/// One run, read and checked as far as that is possible before it starts.
struct PreparedRun {
  scenario::ResolvedRun run;
  std::filesystem::path folder;
  Pace pace;
  record::RunInfo info;
  check::CheckSet checks;
  std::vector<fault::Fault> faults;
  std::unique_ptr<Participant> controller;    ///< Null: external.
  std::unique_ptr<Participant> plant;         ///< Null: every board is real.
  std::vector<std::string> plant_lines;       ///< LINE=PORT, of serial lines that are ports of this machine.
  std::vector<std::string> controller_lines;  ///< The same.
  std::optional<decode::WireSignals> wire;    ///< Recorded where parts are not ours, or a check asks for it.
};

/// Reads everything that the run's programs will read, so that every mistake in a file is told before anything starts.
/// @throws config::ConfigError, link::LinkError.
[[nodiscard]] PreparedRun prepare(scenario::ResolvedRun run, std::filesystem::path folder, const RunRequest& request);

}  // namespace meltbench::cli
