#pragma once
/// Records a bus and serial lines.

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "bench/cli/exit_status.hpp"

namespace meltbench::cli {

struct RecordRequest {
  std::string can;                 ///< "can0", "slcan:PORT@BIT_RATE", "virtual:NAME" or "none".
  std::vector<std::string> lines;  ///< "NAME=PORT", "NAME=PORT@BAUD_RATE:FORMAT"; "NAME": a line of the embedded bus.
  std::filesystem::path rig;       ///< Goes into the head, and says the settings of lines; may be empty.
  std::filesystem::path out;       ///< Default: the bus and the time in the folder where we are.
  std::optional<double> rotate_MB;
  std::optional<double> rotate_min;
};

/// Until Ctrl-C or SIGTERM, or until the run on the embedded bus is over. The bus goes to NAME.log, the lines go to
/// NAME.serial.log beside it.
/// @throws link::LinkError, config::ConfigError, std::system_error, std::invalid_argument.
[[nodiscard]] ExitStatus record_log(const RecordRequest& request);

}  // namespace meltbench::cli
