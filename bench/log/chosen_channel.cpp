#include "bench/log/chosen_channel.hpp"

#include <fmt/format.h>

#include <algorithm>

#include "bench/log/log_error.hpp"

namespace meltbench::log {

bool ChosenChannel::takes(const LogReader& log, const LogEntry& entry) {
  const std::string& name = log.channels()[entry.channel];
  if (name_.empty()) name_ = name;
  return name == name_;
}

void ChosenChannel::check_found(const LogReader& log) const {
  if (name_.empty() || std::ranges::find(log.channels(), name_) != log.channels().end()) return;
  throw LogError{fmt::format("no channel \"{}\" in the log", name_),
                 log.channels().empty() ? "the log has no frame at all"
                                        : fmt::format("it has {}", fmt::join(log.channels(), ", "))};
}

}  // namespace meltbench::log
