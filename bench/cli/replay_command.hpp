#pragma once
/// Commands that play a recording.

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "bench/cli/exit_status.hpp"

namespace meltbench::cli {

struct ReplayRequest {
  std::filesystem::path log;  ///< A log, or a run's folder.
  std::string channel;
  std::string can;  ///< Where the frames go; with `to`: where who answers is.
  // Raw:
  double speed = 1.0;
  std::uint64_t loops = 1;
  std::vector<std::string> only;     ///< "185" or "180/780", hexadecimal.
  std::vector<std::string> renames;  ///< "185=186".
  // To a live side:
  std::string to;                  ///< "controller" or "boards".
  std::filesystem::path scenario;  ///< Default: repro.toml in the run's folder, or beside the log.
  double time_tolerance_ms = 1.0;
  std::vector<std::string> value_tolerances;  ///< "feeder.6130:1=0.01".
  std::filesystem::path update_reference;
  std::filesystem::path html;  ///< Page of the differences.
};

/// Sends the log's frames over a bus at their times, or plays one side of it to a controller or to boards
/// and compares the answers: to ours in virtual time, or to those of somebody else on `can` at wall-clock pace.
/// @returns kFailed if an answer differs.
/// @throws log::LogError, config::ConfigError, link::LinkError, std::invalid_argument for what cannot go together.
[[nodiscard]] ExitStatus replay_log(const ReplayRequest& request);

}  // namespace meltbench::cli
