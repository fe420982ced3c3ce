#pragma once
/// Records a bus.

#include <filesystem>
#include <optional>
#include <string>

#include "bench/cli/exit_status.hpp"

namespace meltbench::cli {

struct RecordRequest {
  std::string can;            ///< "can0", or "slcan:PORT@BIT_RATE".
  std::filesystem::path out;  ///< Default: the bus and the time in the folder where we are.
  std::optional<double> rotate_MB;
  std::optional<double> rotate_min;
};

/// Until Ctrl-C or SIGTERM. @throws link::LinkError, std::system_error, std::invalid_argument.
[[nodiscard]] ExitStatus record_log(const RecordRequest& request);

}  // namespace meltbench::cli
