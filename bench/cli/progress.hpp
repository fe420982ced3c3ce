#pragma once

#include <chrono>
#include <string>

#include "protocols/time/instant.hpp"

namespace meltbench::cli {

/// One line on the terminal that follows a run: how far, and how many times faster than the wall clock.
/// Silent when standard error is no terminal, or when told so.
class Progress {
 public:
  Progress(std::string label, Nanos duration, bool quiet);
  ~Progress();
  Progress(const Progress&) = delete;
  Progress& operator=(const Progress&) = delete;

  /// Called often: draws at most ten times per second.
  void at(Instant now);
  /// Wipes the line.
  void clear();

 private:
  std::string label_;
  Nanos duration_;
  bool shown_ = false;
  bool enabled_;
  std::chrono::steady_clock::time_point start_;
  std::chrono::steady_clock::time_point next_draw_;
};

}  // namespace meltbench::cli
