#pragma once
/// What the commands on a recorded log have in common.

#include <filesystem>
#include <functional>
#include <memory>
#include <string>

#include "bench/log/chosen_channel.hpp"
#include "bench/log/log_reader.hpp"
#include "bench/log/serial_log.hpp"
#include "bench/scenario/scenario.hpp"

namespace meltbench::cli {

/// The log that is meant: the file, or bus.log of a run's folder. @throws log::LogError if it is not there.
[[nodiscard]] std::filesystem::path find_log(const std::filesystem::path& path);

/// What went over serial lines meanwhile: NAME.serial.log beside NAME.log, or serial.log; empty if neither is there.
[[nodiscard]] std::filesystem::path find_serial_log(const std::filesystem::path& log);

/// Hands over every piece of a serial log, its time since `zero` if the log has dates.
/// @throws log::LogError
void read_serial_log(const std::filesystem::path& path, Instant zero,
                     const std::function<void(Instant at, const log::SerialEntry& entry)>& take);

/// The one run that a scenario describes; without a scenario, repro.toml beside the log.
/// @throws std::invalid_argument if there is none or several, config::ConfigError.
[[nodiscard]] scenario::ResolvedRun load_run_of(const std::filesystem::path& scenario,
                                                const std::filesystem::path& log);

/// Frames of one channel of a log, their time since the log's beginning.
class ChannelLog {
 public:
  /// @param channel  if empty, that of the first frame. @throws log::LogError
  ChannelLog(const std::filesystem::path& log, std::string channel);

  /// @returns false at the end. The instant counts from zero(). @throws log::LogError
  [[nodiscard]] bool next(log::LogEntry& entry);
  /// At the end: tells the user if there were other channels, which were left out.
  void warn_of_other_channels() const;
  /// What the entries count from: the beginning of the run, or, of a log with dates, its first frame.
  [[nodiscard]] Instant zero() const { return zero_; }
  [[nodiscard]] const log::LogReader& reader() const { return *reader_; }

 private:
  std::unique_ptr<log::LogReader> reader_;
  log::ChosenChannel channel_;
  bool begun_ = false;
  Instant zero_{};
};

}  // namespace meltbench::cli
