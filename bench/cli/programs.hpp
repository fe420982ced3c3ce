#pragma once

#include <optional>
#include <span>
#include <string>
#include <vector>

#include "bench/bus/broker.hpp"
#include "bench/bus/run_observer.hpp"
#include "bench/cli/child_process.hpp"
#include "bench/cli/prepare_run.hpp"

namespace meltbench::cli {

/// The programs of a run that the bench starts.
class Programs {
 public:
  /// Starts them. @param bus_name  of the embedded bus. @param cpu  the processor that they all run on; nothing: any.
  /// @throws std::system_error if one cannot be started.
  Programs(const PreparedRun& prepared, const RunRequest& request, const std::string& bus_name, std::optional<int> cpu);

  /// @returns their connections, in the order of `names`.
  /// @throws std::runtime_error naming the program that ended before it joined; link::LinkError if that was because it
  ///         cannot use what it was given.
  [[nodiscard]] std::vector<bus::Joined> wait_until_joined(bus::Broker& broker, std::span<const std::string> names);

  /// "plant_emulator was killed by signal 9"; empty if all run.
  [[nodiscard]] std::string describe_ends();

  void finish();

 private:
  void wait_for_pseudo_terminals(const std::vector<std::string>& lines);

  std::vector<ChildProcess> children_;
};

/// Ends the programs of a run. @returns what the outcome says, and how the processes ended, if one was lost.
[[nodiscard]] bus::RunOutcome end_programs(bus::RunOutcome outcome, std::span<bus::Joined> joined, Programs& programs);

}  // namespace meltbench::cli
