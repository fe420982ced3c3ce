#pragma once
/// Makes a scenario of a recorded failure.

#include <filesystem>
#include <string>

#include "bench/cli/exit_status.hpp"

namespace meltbench::cli {

struct ExtractRequest {
  std::filesystem::path log;       ///< A log, or a run's folder.
  std::filesystem::path scenario;  ///< Rig and settings. Default: repro.toml in the run's folder, or beside the log.
  std::string channel;             ///< Default: that of the first frame.
  std::filesystem::path serial;    ///< What went over serial lines meanwhile. Default: serial.log beside the log.
  std::filesystem::path out;       ///< The scenario to write.
  bool minimise = false;           ///< Leave faults out as long as the failure still shows.
};

/// @throws log::LogError, config::ConfigError, std::invalid_argument, std::system_error.
[[nodiscard]] ExitStatus extract_scenario(const ExtractRequest& request);

}  // namespace meltbench::cli
