#pragma once

#include <string>

#include "bench/log/log_reader.hpp"

namespace meltbench::log {

/// The one channel of a log that a command is about.
class ChosenChannel {
 public:
  /// @param name  empty: the channel of the first frame.
  explicit ChosenChannel(std::string name) : name_{std::move(name)} {}

  /// As asked for, or that of the first frame once there was one.
  [[nodiscard]] const std::string& name() const { return name_; }
  /// Whether an entry that the log has just given is of that channel.
  [[nodiscard]] bool takes(const LogReader& log, const LogEntry& entry);
  /// To be asked at the log's end. @throws LogError telling which channels there are, if this is none of them.
  void check_found(const LogReader& log) const;

 private:
  std::string name_;
};

}  // namespace meltbench::log
