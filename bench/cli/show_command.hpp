#pragma once
/// Tells what happened on a recorded bus.

#include <filesystem>
#include <string>

#include "bench/cli/exit_status.hpp"

namespace meltbench::cli {

struct ShowRequest {
  std::filesystem::path log;       ///< A log, or a run's folder.
  std::filesystem::path scenario;  ///< Whose rig it is. Default: repro.toml in the run's folder, or beside the log.
                                   ///< Not needed beside a DBC.
  std::filesystem::path dbc;       ///< Names what is not the rig's. Empty: nothing does.
  std::string channel;             ///< Default: that of the first frame.
  std::filesystem::path serial;    ///< What went over serial lines meanwhile. Default: as find_serial_log().
  bool frames = false;             ///< Every frame, decoded, in place of the story.
  std::filesystem::path html;      ///< Write the story as this page, in place of text.
};

/// @throws log::LogError, config::ConfigError, report::ReportError, std::invalid_argument without a scenario.
[[nodiscard]] ExitStatus show_log(const ShowRequest& request);

}  // namespace meltbench::cli
