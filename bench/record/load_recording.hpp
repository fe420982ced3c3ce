#pragma once
/// Reads a run's folder back, for reports and for judging again.

#include <filesystem>
#include <stdexcept>
#include <string>

#include "bench/record/recording.hpp"

namespace meltbench::record {

/// A run folder that cannot be read. what() is "<path>[:line]: <why>"; hint() says what to do.
class LoadError : public std::runtime_error {
 public:
  LoadError(const std::string& message, std::string hint) : std::runtime_error{message}, hint_{std::move(hint)} {}
  [[nodiscard]] const std::string& hint() const { return hint_; }

 private:
  std::string hint_;
};

/// Reads what RunRecorder wrote. A torn folder (bench killed, disk full) is read as far as it goes: a last line without
/// a line end is dropped, a missing end record gives EndReason::kCutShort, and Recording::notes says so.
/// @throws LoadError if bus.log, signals.csv or events.jsonl is missing or holds a line that no recorder writes.
[[nodiscard]] Recording load_recording(const std::filesystem::path& folder);

/// The scenario that a run folder is of; empty if it is no run folder.
[[nodiscard]] std::string read_scenario_name(const std::filesystem::path& folder);

/// Removes the files of a run from its folder, and the folder if nothing else is in it. What is not ours stays.
void remove_run(const std::filesystem::path& folder);

}  // namespace meltbench::record
